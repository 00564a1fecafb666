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
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;

use super::shared::Shared;
use crate::access::digest;
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

/// Connections at a time; more are hung up on.
const MOST_PEERS: usize = 4096;
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
        let peers = Arc::new(AtomicUsize::new(0));
        let mut stopping = shared.stopping.subscribe();
        loop {
            tokio::select! {
                _ = stopping.wait_for(|s| *s) => break,
                accepted = self.listener.accept() => match accepted {
                    Ok((from, to)) => meet(&shared, &peers, from, to),
                    Err(e) => {
                        tracing::warn!("a connection to {} could not be taken: {e}", self.address);
                        tokio::time::sleep(Duration::from_millis(100)).await;
                    }
                },
            }
        }
        while peers.load(Ordering::SeqCst) > 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
}

impl Listener {
    async fn accept(&self) -> io::Result<(Reading, Writing)> {
        match self {
            Listener::Tcp(listener) => {
                let (stream, _) = listener.accept().await?;
                stream.set_nodelay(true)?;
                let (from, to) = stream.into_split();
                Ok((Box::new(from), Box::new(to)))
            }
            #[cfg(unix)]
            Listener::Unix(listener, _) => {
                let (from, to) = listener.accept().await?.0.into_split();
                Ok((Box::new(from), Box::new(to)))
            }
        }
    }
}

/// Serves a connection in a task of its own.
fn meet(shared: &Arc<Shared>, peers: &Arc<AtomicUsize>, from: Reading, mut to: Writing) {
    let place = Place(peers.clone());
    if peers.fetch_add(1, Ordering::SeqCst) >= MOST_PEERS {
        return;
    }
    let shared = shared.clone();
    tokio::spawn(async move {
        let _place = place;
        let greeted = tokio::time::timeout(PATIENCE, zmtp::handshake(from, &mut to)).await;
        match greeted {
            Ok(Ok((receiver, token))) => {
                peer::serve(shared, token.as_deref().map(digest), receiver, to).await
            }
            Ok(Err(e)) => tracing::info!("a connection that does not speak ZMTP: {e}"),
            Err(_) => tracing::info!("a connection that said nothing"),
        }
    });
}

/// One of the connections there are; given back when dropped.
struct Place(Arc<AtomicUsize>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
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
