//! ZeroMQ server: a ROUTER for DEALER clients, over TCP or a Unix socket. docs/zeromq.md describes the protocol.
//!
//! | module | responsibility |
//! |---|---|
//! | `zmtp` | the wire protocol: handshake, frames, limits |
//! | `message` | frames of a message: header and arrays |
//! | `peer` | one client: its requests, their order, cancellation |
//!
//! ZMTP is implemented here because the `zeromq` crate (0.7.0) allocates the length that a frame announces, so that a dozen bytes
//! from anybody end the process, and because it disconnects clients that send heartbeats.

pub mod message;
mod peer;
pub mod zmtp;

use std::io;
use std::net::IpAddr;
#[cfg(unix)]
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;

use super::client::Client;
use super::state::AppState;
use crate::access::{digest, now};
use crate::error::{Error, Result};
use peer::{ReadHalf, WriteHalf};

/// A bound address.
pub struct Endpoint {
    listener: Listener,
    address: String,
}

enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    /// With the guard that removes the socket file.
    Unix(UnixListener, #[expect(dead_code)] SocketFile),
}

/// Time that a connection has to complete the handshake.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);

impl Endpoint {
    /// Binds `tcp://HOST:PORT` (port `*` or 0 chooses a free one, host `*` is all interfaces) or `ipc://PATH`.
    pub async fn bind(address: &str) -> Result<Endpoint> {
        let unbound = |e: io::Error| Error::Io {
            path: address.to_string(),
            message: format!("cannot listen on this address: {e}; choose another"),
        };
        if let Some(place) = address.strip_prefix("tcp://") {
            let (host, port) = place.rsplit_once(':').ok_or_else(|| refuse(address))?;
            let port = if port == "*" { Some(0) } else { port.parse::<u16>().ok() };
            let port = port.filter(|_| !host.is_empty()).ok_or_else(|| refuse(address))?;
            let host = if host == "*" { "0.0.0.0" } else { host.trim_matches(['[', ']']) };
            let listener = TcpListener::bind((host, port)).await.map_err(unbound)?;
            let address = format!("tcp://{}", listener.local_addr().map_err(unbound)?);
            return Ok(Endpoint { listener: Listener::Tcp(listener), address });
        }
        #[cfg(unix)]
        if let Some(path) = address.strip_prefix("ipc://").filter(|p| !p.is_empty()) {
            let path = PathBuf::from(path);
            remove_stale_socket(&path, address)?;
            let listener = UnixListener::bind(&path).map_err(unbound)?;
            let identity = file_identity(&path);
            return Ok(Endpoint {
                listener: Listener::Unix(listener, SocketFile { path, identity }),
                address: address.into(),
            });
        }
        Err(refuse(address))
    }

    /// The bound address, as clients connect to it.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// The bound IP address; `None` for a Unix socket.
    pub fn ip(&self) -> Option<IpAddr> {
        match &self.listener {
            Listener::Tcp(listener) => listener.local_addr().ok().map(|at| at.ip()),
            #[cfg(unix)]
            Listener::Unix(..) => None,
        }
    }

    /// Serves until the server stops, then finishes the requests in flight.
    pub async fn run(self, shared: Arc<AppState>) {
        let mut stopping = shared.stopping.subscribe();
        loop {
            tokio::select! {
                _ = stopping.wait_for(|s| *s) => break,
                accepted = self.listener.accept() => match accepted {
                    Ok((client, from, to)) => accept_peer(&shared, client, from, to),
                    Err(e) => {
                        tracing::warn!("a connection to {} could not be accepted: {e}", self.address);
                        tokio::time::sleep(Duration::from_millis(100)).await;
                    }
                },
            }
        }
        while shared.zmq_connections.total() > 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
}

impl Listener {
    async fn accept(&self) -> io::Result<(Client, ReadHalf, WriteHalf)> {
        match self {
            Listener::Tcp(listener) => {
                let (stream, at) = listener.accept().await?;
                stream.set_nodelay(true)?;
                let (from, to) = stream.into_split();
                Ok((Client::at(at.ip()), Box::new(from), Box::new(to)))
            }
            #[cfg(unix)]
            Listener::Unix(listener, _) => {
                let (from, to) = listener.accept().await?.0.into_split();
                Ok((Client::local(), Box::new(from), Box::new(to)))
            }
        }
    }
}

/// Serves a connection in its own task; closes it if the client's or the total limit is reached.
fn accept_peer(shared: &Arc<AppState>, at: Client, from: ReadHalf, mut to: WriteHalf) {
    let Ok(mut permit) = shared.zmq_connections.acquire(&at) else { return };
    let shared = shared.clone();
    tokio::spawn(async move {
        let greeted = tokio::time::timeout(HANDSHAKE_TIMEOUT, zmtp::handshake(from, &mut to)).await;
        match greeted {
            Ok(Ok((receiver, token))) => {
                let token = token.as_deref().map(digest);
                let principal =
                    shared.keyring.authenticate(token.as_ref(), now()).ok().filter(|who| who.name.is_some());
                if let Some(who) = principal {
                    let client = Client::identify(&who, &at);
                    if shared.zmq_connections.count(&client) >= shared.limits().client_connections {
                        return;
                    }
                    permit.transfer(&client);
                }
                peer::serve(shared, at, token, receiver, to).await;
            }
            Ok(Err(e)) => tracing::info!("ZMTP handshake failed: {e}"),
            Err(_) => tracing::info!("ZMTP handshake timed out"),
        }
        drop(permit);
    });
}

/// A socket file, removed when dropped unless another file has taken its path.
#[cfg(unix)]
struct SocketFile {
    path: PathBuf,
    identity: Option<FileIdentity>,
}

#[cfg(unix)]
impl Drop for SocketFile {
    fn drop(&mut self) {
        if self.identity.is_some() && file_identity(&self.path) == self.identity {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Device and inode.
#[cfg(unix)]
type FileIdentity = (u64, u64);

#[cfg(unix)]
fn file_identity(path: &Path) -> Option<FileIdentity> {
    use std::os::unix::fs::MetadataExt;
    std::fs::symlink_metadata(path).ok().map(|m| (m.dev(), m.ino()))
}

/// Removes a socket without a listener, which an earlier process left; errors for any other file.
#[cfg(unix)]
fn remove_stale_socket(path: &Path, address: &str) -> Result<()> {
    use std::os::unix::fs::FileTypeExt;
    let Ok(file) = std::fs::symlink_metadata(path) else { return Ok(()) };
    if !file.file_type().is_socket() {
        let allowed = "the path of a new file or of an earlier socket; another file has this path";
        return Err(Error::input("--zmq", address, allowed));
    }
    let connected = std::os::unix::net::UnixStream::connect(path);
    if connected.is_err_and(|e| e.kind() == io::ErrorKind::ConnectionRefused) {
        std::fs::remove_file(path).map_err(|e| Error::io(path, e))?;
    }
    Ok(())
}

fn refuse(address: &str) -> Error {
    let allowed = "tcp://127.0.0.1:5555 (port 0 or * chooses a free one) or ipc:///path/of/a/socket";
    Error::input("--zmq", format!("{address:?}"), allowed)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn bind(path: &Path) -> Result<Endpoint> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(Endpoint::bind(&format!("ipc://{}", path.display())))
    }

    #[test]
    fn removes_stale_sockets_only() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        drop(std::os::unix::net::UnixListener::bind(at("stale")).unwrap());
        std::fs::write(at("notes"), "mine").unwrap();
        for (link, target) in [("link", "notes"), ("socket-link", "stale"), ("dangling", "nothing")] {
            std::os::unix::fs::symlink(at(target), at(link)).unwrap();
        }
        for other in ["notes", "link", "socket-link", "dangling"] {
            let error = bind(&at(other)).err().unwrap();
            assert!(matches!(&error, Error::Input(_)), "{other}: {error}");
            assert!(std::fs::symlink_metadata(at(other)).is_ok(), "{other} is still there");
        }
        assert_eq!(std::fs::read_to_string(at("notes")).unwrap(), "mine");

        let endpoint = bind(&at("stale")).unwrap();
        assert!(bind(&at("stale")).is_err(), "it has a listener");
        drop(endpoint);
        assert!(!at("stale").exists());

        let endpoint = bind(&at("socket")).unwrap();
        std::fs::remove_file(at("socket")).unwrap();
        std::fs::write(at("socket"), "mine").unwrap();
        drop(endpoint);
        assert_eq!(std::fs::read_to_string(at("socket")).unwrap(), "mine");
    }
}
