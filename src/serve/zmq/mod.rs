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
use std::path::PathBuf;
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
            // A socket without a listener was left by an earlier process.
            let left = std::os::unix::net::UnixStream::connect(&path)
                .is_err_and(|e| e.kind() == io::ErrorKind::ConnectionRefused);
            if left {
                std::fs::remove_file(&path).map_err(unbound)?;
            }
            let listener = UnixListener::bind(&path).map_err(unbound)?;
            return Ok(Endpoint {
                listener: Listener::Unix(listener, SocketFile(path)),
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

/// A socket file, removed when dropped.
#[cfg(unix)]
struct SocketFile(PathBuf);

#[cfg(unix)]
impl Drop for SocketFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn refuse(address: &str) -> Error {
    let allowed = "tcp://127.0.0.1:5555 (port 0 or * chooses a free one) or ipc:///path/of/a/socket";
    Error::input("--zmq", format!("{address:?}"), allowed)
}
