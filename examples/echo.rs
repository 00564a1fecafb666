//! Echo server over HTTP and ZeroMQ, the baseline for benchmarks of the server.
//!
//! `cargo run --release --example echo -- --http 127.0.0.1:0 --zmq tcp://127.0.0.1:0`

use std::error::Error;

use axum::body::Bytes;
use axum::http::header;
use axum::routing::any;
use axum::serve::ListenerExt;
use zeromq::{RouterSocket, Socket, SocketRecv, SocketSend};

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str, usual: &str| {
        let at = given.iter().position(|a| a == name);
        at.and_then(|i| given.get(i + 1)).map_or(usual, |v| v.as_str()).to_string()
    };
    let listener = tokio::net::TcpListener::bind(after("--http", "127.0.0.1:0")).await?;
    println!("listening on http://{}", listener.local_addr()?);
    let mut router = RouterSocket::new();
    println!("listening on {}", router.bind(&after("--zmq", "tcp://127.0.0.1:0")).await?);
    tokio::spawn(async move {
        while let Ok(message) = router.recv().await {
            // Ignore clients that have disconnected.
            let _ = router.send(message).await;
        }
    });
    let answer = |body: Bytes| async { ([(header::CONTENT_TYPE, "application/json")], body) };
    let app = axum::Router::new().fallback(any(answer));
    let prompt = listener.tap_io(|stream| drop(stream.set_nodelay(true)));
    axum::serve(prompt, app).await?;
    Ok(())
}
