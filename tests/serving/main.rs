//! The server over real sockets: HTTP, ZeroMQ, the OpenAPI document, persistence.

#[path = "../discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

mod access;
mod branch;
mod data_directory;
mod design;
mod fair;
mod http;
mod kill;
mod likelihood;
mod limits;
mod log;
mod openapi;
mod page;
mod peer;
mod robust;
mod survive;
mod tls;
mod tokens;
mod transports;
mod watch;
