//! ZeroMQ: a ROUTER to which DEALERs connect, over TCP or a Unix socket. docs/zeromq.md tells clients the protocol.
//!
//! | file | what it does |
//! |---|---|
//! | `zmtp` | bytes on the connection: handshake, frames, limits |
//! | `message` | a message's frames: header and arrays |
//! | `peer` | one client: what it asks, in which order, what is under way |
//!
//! ZMTP is spoken here and not by a library: the `zeromq` crate (0.7.0) reserves whatever length a frame announces, so
//! that a dozen bytes from anybody end the process, and it drops clients that send heartbeats.

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
use super::shared::Shared;
use crate::access::{digest, now};
use crate::error::{Error, Result};
use peer::{Reading, Writing};

/// A place that clients connect to.
pub struct Endpoint {
    listener: Listener,
    address: String,
}

enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    /// With what removes its socket in the end.
    Unix(UnixListener, #[expect(dead_code)] Socket),
}

/// How long a connection may take to say what it is.
const PATIENCE: Duration = Duration::from_secs(10);

impl Endpoint {
    /// Listens at `tcp://HOST:PORT` (`*` or 0 takes a free port, `*` as host all interfaces) or `ipc://PATH`.
    pub async fn bind(address: &str) -> Result<Endpoint> {
        let unbound = |e: io::Error| Error::Io {
            path: address.to_string(),
            message: format!("cannot listen there: {e}; give another address"),
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
            // A socket that nobody answers at was left behind.
            let left = std::os::unix::net::UnixStream::connect(&path)
                .is_err_and(|e| e.kind() == io::ErrorKind::ConnectionRefused);
            if left {
                std::fs::remove_file(&path).map_err(unbound)?;
            }
            let listener = UnixListener::bind(&path).map_err(unbound)?;
            return Ok(Endpoint {
                listener: Listener::Unix(listener, Socket(path)),
                address: address.into(),
            });
        }
        Err(refuse(address))
    }

    /// Where it listens, as clients connect.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// The address of the network it listens at; none for a socket in the file system.
    pub fn ip(&self) -> Option<IpAddr> {
        match &self.listener {
            Listener::Tcp(listener) => listener.local_addr().ok().map(|at| at.ip()),
            #[cfg(unix)]
            Listener::Unix(..) => None,
        }
    }

    /// Serves until the server stops; then ends what is under way.
    pub async fn run(self, shared: Arc<Shared>) {
        let mut stopping = shared.stopping.subscribe();
        loop {
            tokio::select! {
                _ = stopping.wait_for(|s| *s) => break,
                accepted = self.listener.accept() => match accepted {
                    Ok((client, from, to)) => meet(&shared, client, from, to),
                    Err(e) => {
                        tracing::warn!("a connection to {} could not be taken: {e}", self.address);
                        tokio::time::sleep(Duration::from_millis(100)).await;
                    }
                },
            }
        }
        while shared.zmq.all() > 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
}

impl Listener {
    async fn accept(&self) -> io::Result<(Client, Reading, Writing)> {
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

/// Serves a connection in a task of its own; hangs up where its client, or all of them, have too many.
fn meet(shared: &Arc<Shared>, at: Client, from: Reading, mut to: Writing) {
    let Ok(mut place) = shared.zmq.enter(&at) else { return };
    let shared = shared.clone();
    tokio::spawn(async move {
        let greeted = tokio::time::timeout(PATIENCE, zmtp::handshake(from, &mut to)).await;
        match greeted {
            Ok(Ok((receiver, token))) => {
                let token = token.as_deref().map(digest);
                let known = shared.keyring.who(token.as_ref(), now()).ok().filter(|who| who.name.is_some());
                if let Some(who) = known {
                    let client = Client::of(&who, &at);
                    if shared.zmq.of(&client) >= shared.limits.client_connections {
                        return;
                    }
                    place.pass(&client);
                }
                peer::serve(shared, at, token, receiver, to).await;
            }
            Ok(Err(e)) => tracing::info!("a connection that does not speak ZMTP: {e}"),
            Err(_) => tracing::info!("a connection that said nothing"),
        }
        drop(place);
    });
}

/// A socket in the file system, removed when dropped.
#[cfg(unix)]
struct Socket(PathBuf);

#[cfg(unix)]
impl Drop for Socket {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn refuse(address: &str) -> Error {
    let allowed = "tcp://127.0.0.1:5555 (port 0 or * takes a free one) or ipc:///path/of/a/socket";
    Error::input("--zmq", format!("{address:?}"), allowed)
}
