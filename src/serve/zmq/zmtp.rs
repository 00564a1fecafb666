//! ZMTP 3.1, server side of a ROUTER: greeting, READY, frames, PING (rfc.zeromq.org/spec/37).
//!
//! Security is NULL, or PLAIN (rfc.zeromq.org/spec/24) with a token as the password. The handshake presents the token once a
//! connection, after a reconnection libzmq repeats it, and it is checked before large messages are read; a field of each message
//! would be checked only after reading it.
//!
//! *Differences from the source.* No CURVE, and no protocol before 3.0. Messages are bounded by [`MAX_MESSAGE_BYTES`] and
//! [`MAX_FRAMES`]; larger ones are read and discarded, so that they can be answered.
//!
//! The `zeromq` crate (0.7.0) is not used: it allocates the length that a frame announces and has no maximum message size, so that
//! a dozen bytes from anybody end the process. This file can be replaced once the crate bounds both.

use std::io::{self, ErrorKind};

use crate::serve::client_limiter::LimiterPermit;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};

/// Maximum size of a message, bytes.
pub const MAX_MESSAGE_BYTES: usize = 16 * 1024 * 1024;
/// Maximum frames of a message.
pub const MAX_FRAMES: usize = 256;
/// Amount of an oversized message that is read and discarded before the connection is closed, bytes.
const MAX_DRAINED_BYTES: usize = 8 * MAX_MESSAGE_BYTES;

/// The receiving half of a connection.
pub struct Receiver<R> {
    from: BufReader<R>,
    /// Maximum size of an accepted message, bytes.
    max_bytes: usize,
    /// Grows with the bytes of the message that is arriving.
    permit: Option<LimiterPermit>,
}

/// Data received from a peer.
#[derive(Debug, PartialEq)]
pub enum Received {
    /// Frames of one message.
    Message(Vec<Vec<u8>>),
    /// An oversized message: its first frames, as far as they are within the limits.
    TooLarge(Vec<Vec<u8>>),
    /// Context to be echoed in a PONG.
    Ping(Vec<u8>),
}

/// Performs the handshake; returns the token of PLAIN. An error ends the connection.
///
/// The client chooses the mechanism and the greeting repeats it, so that a client without a token can connect and is answered
/// with 401. The token itself is not checked here.
pub async fn handshake<R, W>(from: R, to: &mut W) -> io::Result<(Receiver<R>, Option<Vec<u8>>)>
where
    R: AsyncRead + Unpin,
    W: AsyncWrite + Unpin,
{
    let mut receiver = Receiver {
        from: BufReader::with_capacity(CHUNK_BYTES, from),
        max_bytes: MAX_MESSAGE_BYTES,
        permit: None,
    };
    to.write_all(&greeting()).await?;
    let mut theirs = [0; 64];
    // Other protocols are detected by the first byte.
    receiver.from.read_exact(&mut theirs[..1]).await?;
    if theirs[0] != 0xff {
        return Err(protocol_error("not a ZMTP greeting"));
    }
    receiver.from.read_exact(&mut theirs[1..]).await?;
    if theirs[9] & 1 == 0 || theirs[10] < 3 {
        return Err(protocol_error("a version before 3.0"));
    }
    let name = &theirs[12..32];
    let plain = match name.iter().position(|b| *b == 0).map(|end| &name[..end]) {
        Some(b"NULL") => false,
        Some(b"PLAIN") => true,
        _ => return Err(protocol_error("a mechanism other than NULL and PLAIN")),
    };
    let mut rest = [0; 64 - SIGNATURE_BYTES];
    rest[..20].copy_from_slice(name);
    // The as-server flag, which only PLAIN uses.
    rest[20] = u8::from(plain);
    to.write_all(&rest).await?;
    to.flush().await?;
    let token = if plain { Some(receiver.hello(to).await?) } else { None };
    if !plain {
        command(to, &ready()).await?;
    }
    let greeted = receiver.command().await?;
    let properties = greeted.strip_prefix(if plain { &b"\x08INITIATE"[..] } else { b"\x05READY" });
    match properties.and_then(|p| property_value(p, "Socket-Type")) {
        Some(b"DEALER" | b"REQ" | b"ROUTER") => {
            if plain {
                command(to, &ready()).await?;
            }
            Ok((receiver, token))
        }
        Some(_) => {
            refuse(to, "this is a ROUTER: connect a DEALER").await?;
            Err(protocol_error("a socket type that cannot connect to a ROUTER"))
        }
        None => Err(protocol_error("no READY")),
    }
}

async fn command<W: AsyncWrite + Unpin>(to: &mut W, body: &[u8]) -> io::Result<()> {
    to.write_all(&[&frame_head(COMMAND, body.len())[..], body].concat()).await?;
    to.flush().await
}

fn ready() -> Vec<u8> {
    let mut ready = b"\x05READY".to_vec();
    property(&mut ready, "Socket-Type", b"ROUTER");
    property(&mut ready, "Identity", b"");
    ready
}

async fn refuse<W: AsyncWrite + Unpin>(to: &mut W, reason: &str) -> io::Result<()> {
    let mut error = b"\x05ERROR".to_vec();
    error.push(reason.len() as u8);
    error.extend_from_slice(reason.as_bytes());
    command(to, &error).await
}

impl<R: AsyncRead + Unpin> Receiver<R> {
    /// Messages of more bytes are discarded from now on.
    pub fn set_max_bytes(&mut self, bytes: usize) {
        self.max_bytes = bytes;
    }

    /// The bytes of the next message are counted by this permit.
    pub fn set_permit(&mut self, permit: LimiterPermit) {
        self.permit = Some(permit);
    }

    /// The permit of the message that was received.
    pub fn take_permit(&mut self) -> Option<LimiterPermit> {
        self.permit.take()
    }

    /// Waits until something arrives; false at the end of the stream.
    pub async fn wait(&mut self) -> io::Result<bool> {
        Ok(!self.from.fill_buf().await?.is_empty())
    }

    /// First part of PLAIN (RFC 24): HELLO with a name and a password, which is the token; then WELCOME.
    async fn hello<W: AsyncWrite + Unpin>(&mut self, to: &mut W) -> io::Result<Vec<u8>> {
        let body = self.command().await?;
        let parts = body.strip_prefix(b"\x05HELLO").and_then(|rest| {
            let (length, rest) = rest.split_first()?;
            let (length, rest) = rest.get(usize::from(*length)..)?.split_first()?;
            rest.get(..usize::from(*length)).filter(|token| token.len() == rest.len())
        });
        let token = parts.ok_or_else(|| protocol_error("no HELLO"))?.to_vec();
        command(to, b"\x07WELCOME").await?;
        Ok(token)
    }

    /// A command of the handshake.
    async fn command(&mut self) -> io::Result<Vec<u8>> {
        let (flags, length) = self.head().await?;
        if flags & COMMAND == 0 || length > 4096 {
            return Err(protocol_error("no READY"));
        }
        self.body(length as usize).await
    }
}

impl<R: AsyncRead + Unpin> Receiver<R> {
    /// The next message or PING; `None` at the end of the stream. Protocol violations are errors.
    pub async fn receive(&mut self) -> io::Result<Option<Received>> {
        let (mut frames, mut bytes, mut too_large) = (Vec::new(), 0usize, false);
        loop {
            if frames.is_empty() && !too_large && !self.wait().await? {
                return Ok(None);
            }
            let (flags, length) = self.head().await?;
            if flags & COMMAND != 0 {
                if flags & MORE != 0 || length > 4096 {
                    return Err(protocol_error("a command of more than 4096 bytes"));
                }
                let body = self.body(length as usize).await?;
                // Other commands are ignored; PONG would answer a PING, and none is sent.
                match body.strip_prefix(b"\x04PING") {
                    Some(rest) if frames.is_empty() && !too_large => {
                        return Ok(Some(Received::Ping(rest.get(2..).unwrap_or_default().to_vec())));
                    }
                    _ => continue,
                }
            }
            let total = usize::try_from(length).ok().and_then(|n| bytes.checked_add(n));
            bytes = match total {
                Some(total) if total <= MAX_DRAINED_BYTES => total,
                _ => return Err(protocol_error("a message far above the size limit")),
            };
            too_large |= bytes > self.max_bytes || frames.len() >= MAX_FRAMES;
            if too_large {
                let dropped =
                    tokio::io::copy(&mut (&mut self.from).take(length), &mut tokio::io::sink()).await?;
                if dropped < length {
                    return Err(ErrorKind::UnexpectedEof.into());
                }
            } else {
                frames.push(self.body(length as usize).await?);
            }
            if flags & MORE == 0 {
                let received = if too_large { Received::TooLarge } else { Received::Message };
                return Ok(Some(received(frames)));
            }
        }
    }

    async fn head(&mut self) -> io::Result<(u8, u64)> {
        let flags = self.from.read_u8().await?;
        if flags & !(MORE | LONG | COMMAND) != 0 {
            return Err(protocol_error("a frame with unknown flags"));
        }
        let length = if flags & LONG != 0 {
            self.from.read_u64().await?
        } else {
            u64::from(self.from.read_u8().await?)
        };
        Ok((flags, length))
    }

    /// Memory grows with the bytes received, not with the announced length.
    async fn body(&mut self, length: usize) -> io::Result<Vec<u8>> {
        let mut body = Vec::with_capacity(length.min(CHUNK_BYTES));
        while body.len() < length {
            let rest = length - body.len();
            let part = self.from.fill_buf().await?;
            let part = &part[..part.len().min(rest)];
            if part.is_empty() {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            if self.permit.as_mut().is_some_and(|permit| permit.grow(part.len()).is_err()) {
                return Err(protocol_error("too many bytes in messages that are not answered yet"));
            }
            body.extend_from_slice(part);
            let taken = part.len();
            self.from.consume(taken);
        }
        Ok(body)
    }
}

/// Sends one message.
pub async fn send<W: AsyncWrite + Unpin>(to: &mut W, frames: &[impl AsRef<[u8]>]) -> io::Result<()> {
    let mut together = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let frame = frame.as_ref();
        let more = if i + 1 < frames.len() { MORE } else { 0 };
        together.extend_from_slice(&frame_head(more, frame.len()));
        if frame.len() <= COALESCE_BYTES {
            together.extend_from_slice(frame);
        } else {
            to.write_all(&together).await?;
            together.clear();
            to.write_all(frame).await?;
        }
    }
    to.write_all(&together).await?;
    to.flush().await
}

/// Answers a PING.
pub async fn pong<W: AsyncWrite + Unpin>(to: &mut W, context: &[u8]) -> io::Result<()> {
    let body = [b"\x04PONG", context].concat();
    to.write_all(&[&frame_head(COMMAND, body.len())[..], &body].concat()).await?;
    to.flush().await
}

const MORE: u8 = 1;
const LONG: u8 = 2;
const COMMAND: u8 = 4;
/// Bytes read at a time.
const CHUNK_BYTES: usize = 64 * 1024;
/// Frames up to this size are written together with their neighbours, bytes.
const COALESCE_BYTES: usize = 64 * 1024;

/// Size of the greeting before the mechanism: signature and version, bytes.
const SIGNATURE_BYTES: usize = 12;

fn greeting() -> [u8; SIGNATURE_BYTES] {
    let mut greeting = [0; SIGNATURE_BYTES];
    (greeting[0], greeting[9]) = (0xff, 0x7f);
    (greeting[10], greeting[11]) = (3, 1);
    greeting
}

fn frame_head(flags: u8, length: usize) -> Vec<u8> {
    match u8::try_from(length) {
        Ok(short) => vec![flags, short],
        Err(_) => {
            let mut head = vec![flags | LONG];
            head.extend_from_slice(&(length as u64).to_be_bytes());
            head
        }
    }
}

fn property(out: &mut Vec<u8>, name: &str, value: &[u8]) {
    out.push(name.len() as u8);
    out.extend_from_slice(name.as_bytes());
    out.extend_from_slice(&(value.len() as u32).to_be_bytes());
    out.extend_from_slice(value);
}

/// Value of a property; names are case-insensitive.
fn property_value<'a>(mut properties: &'a [u8], key: &str) -> Option<&'a [u8]> {
    while let Some((length, rest)) = properties.split_first() {
        let (name, rest) = rest.split_at_checked(*length as usize)?;
        let (size, rest) = rest.split_first_chunk::<4>()?;
        let (value, rest) = rest.split_at_checked(u32::from_be_bytes(*size) as usize)?;
        if name.eq_ignore_ascii_case(key.as_bytes()) {
            return Some(value);
        }
        properties = rest;
    }
    None
}

fn protocol_error(what: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, what)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run<T>(work: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(work)
    }

    async fn receive(bytes: &[u8]) -> io::Result<Option<Received>> {
        Receiver { from: BufReader::new(bytes), max_bytes: MAX_MESSAGE_BYTES, permit: None }.receive().await
    }

    #[test]
    fn message_round_trip() {
        let frames = [vec![], vec![7; 255], vec![8; 256], vec![9; COALESCE_BYTES + 1], vec![1]];
        run(async {
            let mut sent = Vec::new();
            send(&mut sent, &frames).await.unwrap();
            assert_eq!(receive(&sent).await.unwrap(), Some(Received::Message(frames.to_vec())));
            for cut in [1, 2, 200, sent.len() - 1] {
                assert!(receive(&sent[..cut]).await.is_err(), "{cut}");
            }
            assert_eq!(receive(&[]).await.unwrap(), None);
        });
    }

    #[test]
    fn bounds_messages_and_reports_pings() {
        run(async {
            let mut sent = Vec::new();
            send(&mut sent, &[vec![5; 3], vec![0; MAX_MESSAGE_BYTES]]).await.unwrap();
            assert_eq!(receive(&sent).await.unwrap(), Some(Received::TooLarge(vec![vec![5; 3]])));
            let announced = [&[LONG][..], &(1u64 << 62).to_be_bytes()].concat();
            assert!(receive(&announced).await.is_err());
            let mut many = Vec::new();
            send(&mut many, &vec![vec![1]; MAX_FRAMES + 1]).await.unwrap();
            assert!(matches!(receive(&many).await.unwrap(), Some(Received::TooLarge(_))));
            let ping = [&[COMMAND, 9][..], b"\x04PING\x00\x00hi"].concat();
            assert_eq!(receive(&ping).await.unwrap(), Some(Received::Ping(b"hi".to_vec())));
        });
    }
}
