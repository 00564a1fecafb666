//! A minimal ZeroMQ client, written from docs/reference/zeromq.md and the ZMTP specification: greeting, NULL or PLAIN,
//! one request at a time.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use rmpv::Value as Packed;
use serde_json::Value;

pub struct Peer(pub TcpStream);

impl Peer {
    /// Connects to `tcp://HOST:PORT`, with PLAIN if there is a token.
    pub fn connect(address: &str, token: Option<&str>) -> Peer {
        let stream = TcpStream::connect(address.strip_prefix("tcp://").unwrap()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        stream.set_nodelay(true).unwrap();
        let mut peer = Peer(stream);
        let mut greeting = [0; 64];
        (greeting[0], greeting[9], greeting[10], greeting[11]) = (0xff, 0x7f, 3, 1);
        let mechanism: &[u8] = if token.is_some() { b"PLAIN" } else { b"NULL" };
        greeting[12..12 + mechanism.len()].copy_from_slice(mechanism);
        peer.0.write_all(&greeting).unwrap();
        let mut theirs = [0; 64];
        peer.0.read_exact(&mut theirs).unwrap();
        assert_eq!(&theirs[12..32], &greeting[12..32], "the mechanism is the client's");
        if let Some(token) = token {
            peer.command(&[&b"\x05HELLO\x04iplw"[..], &[token.len() as u8], token.as_bytes()].concat());
            assert_eq!(peer.frame().1, b"\x07WELCOME");
            peer.command(b"\x08INITIATE\x0bSocket-Type\x00\x00\x00\x06DEALER");
        } else {
            peer.command(b"\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER");
        }
        assert!(peer.frame().1.starts_with(b"\x05READY"));
        peer
    }

    fn command(&mut self, body: &[u8]) {
        self.0.write_all(&[&[4, body.len() as u8], body].concat()).unwrap();
    }

    /// Flags and body of the next frame.
    pub fn frame(&mut self) -> (u8, Vec<u8>) {
        self.try_frame().unwrap()
    }

    /// The same; fails if the server is gone.
    pub fn try_frame(&mut self) -> io::Result<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.0.read_exact(&mut head)?;
        let length = if head[0] & 2 == 0 {
            u64::from(head[1])
        } else {
            let mut rest = [0; 7];
            self.0.read_exact(&mut rest)?;
            rest.iter().fold(u64::from(head[1]), |n, b| n << 8 | u64::from(*b))
        };
        let mut body = vec![0; length as usize];
        self.0.read_exact(&mut body)?;
        Ok((head[0], body))
    }

    /// Sends a message of one frame.
    pub fn send(&mut self, body: &[u8]) {
        self.try_send(body).unwrap();
    }

    /// The same; fails if the server is gone.
    pub fn try_send(&mut self, body: &[u8]) -> io::Result<()> {
        let head = [&[2][..], &(body.len() as u64).to_be_bytes()].concat();
        self.0.write_all(&[&head, body].concat())
    }

    /// The response to one request as JSON; binary arrays are dropped.
    pub fn ask(&mut self, op: &str, args: &Value) -> Value {
        self.ask_within(op, args, None)
    }

    /// The same with a deadline, s.
    pub fn ask_within(&mut self, op: &str, args: &Value, deadline: Option<f64>) -> Value {
        let head = serde_json::json!({"v": 1, "id": 1, "op": op, "args": args, "deadline": deadline});
        self.send(&rmp_serde::to_vec_named(&head).unwrap());
        self.answer()
    }

    pub fn answer(&mut self) -> Value {
        self.try_answer().unwrap()
    }

    /// The same; fails if the server is gone.
    pub fn try_answer(&mut self) -> io::Result<Value> {
        let (mut flags, head) = self.try_frame()?;
        while flags & 1 != 0 {
            flags = self.try_frame()?.0;
        }
        let packed = rmpv::decode::read_value(&mut &head[..]).unwrap();
        Ok(json(&packed))
    }
}

fn json(packed: &Packed) -> Value {
    match packed {
        Packed::Map(entries) => {
            entries.iter().map(|(k, v)| (k.as_str().unwrap_or_default().to_string(), json(v))).collect()
        }
        Packed::Array(items) => items.iter().map(json).collect(),
        Packed::String(text) => text.as_str().unwrap_or_default().into(),
        Packed::Boolean(b) => (*b).into(),
        Packed::Integer(n) => n.as_i64().map_or_else(|| n.as_u64().into(), Value::from),
        Packed::F64(x) => (*x).into(),
        Packed::F32(x) => (*x).into(),
        _ => Value::Null,
    }
}
