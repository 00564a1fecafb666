//! ZMTP 3.1, the server's side of a ROUTER: greeting, READY, frames, PING (rfc.zeromq.org/spec/37).
//!
//! Security is NULL, or PLAIN (rfc.zeromq.org/spec/24) whose password is a token. A token in the handshake is shown once a
//! connection, by libzmq itself after every reconnection, and before anything large is taken; a field of each message would
//! be checked only after that message had been read.
//!
//! *Differences from the source.* No CURVE, and no older protocol than 3.0. What a peer may send is bounded:
//! a message has at most [`MOST_BYTES`] and [`MOST_FRAMES`]; more is read and dropped, so that it can be answered.
//!
//! Ours and no library's: the `zeromq` crate (0.7.0, its source read) reserves whatever length a frame announces and knows
//! no largest message, so that a dozen bytes from anybody end the process. Once it bounds both, this file can go.

use std::io::{self, ErrorKind};

use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};

/// Largest message, bytes.
pub const MOST_BYTES: usize = 16 * 1024 * 1024;
/// Most frames of a message.
pub const MOST_FRAMES: usize = 256;
/// How much of a message above the limit is read and dropped before the connection is, bytes.
const DRAINED: usize = 8 * MOST_BYTES;

/// The receiving half of a connection.
pub struct Receiver<R> {
    from: BufReader<R>,
    /// Largest message that is taken, bytes.
    most: usize,
}

/// What a peer sent.
#[derive(Debug, PartialEq)]
pub enum Received {
    /// Frames of one message.
    Message(Vec<Vec<u8>>),
    /// A message above the limits; its first frames as far as they were within them.
    TooLarge(Vec<Vec<u8>>),
    /// The body of a PONG to be sent.
    Ping(Vec<u8>),
}

/// Exchanges greetings and what the mechanism wants, by which a client shows its token; an error ends the connection.
///
/// The mechanism is the client's choice: the second half of our greeting repeats it, so that a client without a token is
/// met, and told what it lacks in answer to its request. Whether a token is good is not said here either.
pub async fn handshake<R, W>(from: R, to: &mut W) -> io::Result<(Receiver<R>, Option<Vec<u8>>)>
where
    R: AsyncRead + Unpin,
    W: AsyncWrite + Unpin,
{
    let mut receiver = Receiver { from: BufReader::with_capacity(64 * 1024, from), most: MOST_BYTES };
    to.write_all(&greeting()).await?;
    let mut theirs = [0; 64];
    // Whoever speaks something else is noticed at the first byte.
    receiver.from.read_exact(&mut theirs[..1]).await?;
    if theirs[0] != 0xff {
        return Err(bad("no greeting"));
    }
    receiver.from.read_exact(&mut theirs[1..]).await?;
    if theirs[9] & 1 == 0 || theirs[10] < 3 {
        return Err(bad("a version before 3.0"));
    }
    let name = &theirs[12..32];
    let plain = match name.iter().position(|b| *b == 0).map(|end| &name[..end]) {
        Some(b"NULL") => false,
        Some(b"PLAIN") => true,
        _ => return Err(bad("a mechanism other than NULL and PLAIN")),
    };
    let mut rest = [0; 64 - SIGNED];
    rest[..20].copy_from_slice(name);
    // As a server, which only PLAIN tells from a client.
    rest[20] = u8::from(plain);
    to.write_all(&rest).await?;
    to.flush().await?;
    let token = if plain { Some(receiver.hello(to).await?) } else { None };
    if !plain {
        command(to, &ready()).await?;
    }
    let greeted = receiver.command().await?;
    let told = greeted.strip_prefix(if plain { &b"\x08INITIATE"[..] } else { b"\x05READY" });
    match told.and_then(|p| value_of(p, "Socket-Type")) {
        Some(b"DEALER" | b"REQ" | b"ROUTER") => {
            if plain {
                command(to, &ready()).await?;
            }
            Ok((receiver, token))
        }
        Some(_) => {
            refuse(to, "a ROUTER is here: connect a DEALER").await?;
            Err(bad("a socket type that does not go with ROUTER"))
        }
        None => Err(bad("no READY")),
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
    /// From now on messages of more bytes are read and dropped.
    pub fn at_most(&mut self, bytes: usize) {
        self.most = bytes;
    }

    /// PLAIN's first half (RFC 24): HELLO with a name and a password, which is the token; then WELCOME.
    async fn hello<W: AsyncWrite + Unpin>(&mut self, to: &mut W) -> io::Result<Vec<u8>> {
        let body = self.command().await?;
        let parts = body.strip_prefix(b"\x05HELLO").and_then(|rest| {
            let (length, rest) = rest.split_first()?;
            let (length, rest) = rest.get(usize::from(*length)..)?.split_first()?;
            rest.get(..usize::from(*length)).filter(|token| token.len() == rest.len())
        });
        let token = parts.ok_or_else(|| bad("no HELLO"))?.to_vec();
        command(to, b"\x07WELCOME").await?;
        Ok(token)
    }

    /// A command of the handshake.
    async fn command(&mut self) -> io::Result<Vec<u8>> {
        let (flags, length) = self.head().await?;
        if flags & COMMAND == 0 || length > 4096 {
            return Err(bad("no READY"));
        }
        self.body(length as usize).await
    }
}

impl<R: AsyncRead + Unpin> Receiver<R> {
    /// The next thing the peer sent; `None` at its end. What breaks the protocol is an error.
    pub async fn receive(&mut self) -> io::Result<Option<Received>> {
        let (mut frames, mut bytes, mut too_large) = (Vec::new(), 0usize, false);
        loop {
            if frames.is_empty() && !too_large && self.from.fill_buf().await?.is_empty() {
                return Ok(None);
            }
            let (flags, length) = self.head().await?;
            if flags & COMMAND != 0 {
                if flags & MORE != 0 || length > 4096 {
                    return Err(bad("a command of more than 4096 bytes"));
                }
                let body = self.body(length as usize).await?;
                // Of other commands nothing is expected; PONG answers a ping that nobody sent.
                match body.strip_prefix(b"\x04PING") {
                    Some(rest) if frames.is_empty() && !too_large => {
                        return Ok(Some(Received::Ping(rest.get(2..).unwrap_or_default().to_vec())));
                    }
                    _ => continue,
                }
            }
            let total = usize::try_from(length).ok().and_then(|n| bytes.checked_add(n));
            bytes = match total {
                Some(total) if total <= DRAINED => total,
                _ => return Err(bad("a message far above the limit")),
            };
            too_large |= bytes > self.most || frames.len() >= MOST_FRAMES;
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
            return Err(bad("a frame with unknown flags"));
        }
        let length = if flags & LONG != 0 {
            self.from.read_u64().await?
        } else {
            u64::from(self.from.read_u8().await?)
        };
        Ok((flags, length))
    }

    /// Memory grows with what arrives, not with what is announced.
    async fn body(&mut self, length: usize) -> io::Result<Vec<u8>> {
        if let Some(body) = self.from.buffer().get(..length) {
            let body = body.to_vec();
            self.from.consume(length);
            return Ok(body);
        }
        let mut body = Vec::with_capacity(length.min(64 * 1024));
        let read = (&mut self.from).take(length as u64).read_to_end(&mut body).await?;
        if read < length { Err(ErrorKind::UnexpectedEof.into()) } else { Ok(body) }
    }
}

/// Sends one message.
pub async fn send<W: AsyncWrite + Unpin>(to: &mut W, frames: &[impl AsRef<[u8]>]) -> io::Result<()> {
    let mut together = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let frame = frame.as_ref();
        let more = if i + 1 < frames.len() { MORE } else { 0 };
        together.extend_from_slice(&frame_head(more, frame.len()));
        if frame.len() <= TOGETHER {
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
/// Frames up to this size go out in one piece with their neighbours, bytes.
const TOGETHER: usize = 64 * 1024;

/// Bytes of a greeting before the mechanism: signature and version.
const SIGNED: usize = 12;

fn greeting() -> [u8; SIGNED] {
    let mut greeting = [0; SIGNED];
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

/// The value of a property, names being told apart without regard to case.
fn value_of<'a>(mut properties: &'a [u8], wanted: &str) -> Option<&'a [u8]> {
    while let Some((length, rest)) = properties.split_first() {
        let (name, rest) = rest.split_at_checked(*length as usize)?;
        let (size, rest) = rest.split_first_chunk::<4>()?;
        let (value, rest) = rest.split_at_checked(u32::from_be_bytes(*size) as usize)?;
        if name.eq_ignore_ascii_case(wanted.as_bytes()) {
            return Some(value);
        }
        properties = rest;
    }
    None
}

fn bad(what: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, what)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run<T>(work: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(work)
    }

    async fn receive(bytes: &[u8]) -> io::Result<Option<Received>> {
        Receiver { from: BufReader::new(bytes), most: MOST_BYTES }.receive().await
    }

    #[test]
    fn what_is_sent_is_received() {
        let frames = [vec![], vec![7; 255], vec![8; 256], vec![9; TOGETHER + 1], vec![1]];
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
    fn too_much_is_dropped_or_refused_and_pings_are_seen() {
        run(async {
            let mut sent = Vec::new();
            send(&mut sent, &[vec![5; 3], vec![0; MOST_BYTES]]).await.unwrap();
            assert_eq!(receive(&sent).await.unwrap(), Some(Received::TooLarge(vec![vec![5; 3]])));
            let announced = [&[LONG][..], &(1u64 << 62).to_be_bytes()].concat();
            assert!(receive(&announced).await.is_err());
            let mut many = Vec::new();
            send(&mut many, &vec![vec![1]; MOST_FRAMES + 1]).await.unwrap();
            assert!(matches!(receive(&many).await.unwrap(), Some(Received::TooLarge(_))));
            let ping = [&[COMMAND, 9][..], b"\x04PING\x00\x00hi"].concat();
            assert_eq!(receive(&ping).await.unwrap(), Some(Received::Ping(b"hi".to_vec())));
        });
    }
}
