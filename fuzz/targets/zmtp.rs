//! Bytes of a ZeroMQ client, from its greeting on.
//!
//! The first byte is the number of bytes read at a time.

use iplw::rng::Stream;
use iplw::serve::fuzz::{FuzzOutcome, zmq_connection};
use rand::RngExt;

use super::{MIB, Target, bytes};

pub const TARGET: Target =
    Target { name: "zmtp", short: 20_000, long: 100_000_000, work: 16 * MIB, seeds, mutate, check };

fn check(bytes: &[u8]) -> FuzzOutcome {
    bytes
        .split_first()
        .map_or(FuzzOutcome::Rejected, |(at_a_time, bytes)| zmq_connection(bytes, usize::from(*at_a_time)))
}

/// Bytes of a seed before its messages: the read size and the greeting.
const GREETING_BYTES: usize = 65;

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    if draw.random_range(0..4) > 0 && seed.len() > GREETING_BYTES {
        // The part after the greeting has the complexity.
        let mut rest = seed.split_off(GREETING_BYTES);
        bytes::mutate(&mut rest, seeds, &WORDS, draw);
        seed.extend(rest);
    } else {
        bytes::mutate(seed, seeds, &WORDS, draw);
    }
}

const WORDS: [&[u8]; 14] = [
    b"\x00\x00",
    b"\x01\x00",
    b"\x00\x05hello",
    b"\x01\x03abc",
    b"\x02\x00\x00\x00\x00\x00\x00\x00\x04long",
    b"\x02\x00\x00\x00\x00\x01\x00\x00\x01",
    b"\x03\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\x04\x0b\x04PING\x00\x0aabcd",
    b"\x04\x05\x04PONG",
    b"\x06\x00\x00\x00\x00\x00\x00\x10\x01",
    b"\x04\x1c\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER",
    b"\x05HELLO\x03abc\x05token",
    b"\x00\x1a\x84\xa1v\x01\xa2id\x07\xa2op\xa4ping\xa4args\x80",
    b"\xa6arrays\x91\x83\xa4name\xa1a\xa5dtype\xa3<f8\xa5shape\x91\x01",
];

fn seeds() -> Vec<Vec<u8>> {
    let ready = |kind: &str| {
        let mut body = b"\x05READY\x0bSocket-Type\x00\x00\x00".to_vec();
        body.push(kind.len() as u8);
        body.extend(kind.bytes());
        body.extend(b"\x08Identity\x00\x00\x00\x00");
        command(&body)
    };
    let messages = [
        b"\x00\x1a\x84\xa1v\x01\xa2id\x07\xa2op\xa9get_world\xa4args\x80".to_vec(),
        [&b"\x01\x00"[..], b"\x00\x0d\x83\xa1v\x01\xa2id\x07\xa2op\xa4ping"].concat(),
        [&command(b"\x04PING\x00\x0ahello")[..], b"\x01\x01a\x04\x05\x04PONG\x00\x01b"].concat(),
        [&[2][..], &300u64.to_be_bytes(), &[7; 300]].concat(),
        b"\x01\x01x".repeat(260),
        Vec::new(),
    ];
    let mut seeds = Vec::new();
    for (i, message) in messages.iter().enumerate() {
        let at_a_time = [255, 1, 7][i % 3];
        let null = [&[at_a_time][..], &greeting("NULL"), &ready("DEALER"), message].concat();
        let hello = command(b"\x05HELLO\x03ann\x05token");
        let initiate = command(b"\x08INITIATE\x0bSocket-Type\x00\x00\x00\x03REQ");
        let plain = [&[at_a_time][..], &greeting("PLAIN"), &hello, &initiate, message].concat();
        seeds.extend([null, plain]);
    }
    seeds.push([&[255][..], &greeting("NULL"), &ready("SUB")].concat());
    seeds
}

fn greeting(mechanism: &str) -> [u8; 64] {
    let mut greeting = [0; 64];
    (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
    greeting[12..12 + mechanism.len()].copy_from_slice(mechanism.as_bytes());
    greeting
}

fn command(body: &[u8]) -> Vec<u8> {
    [&[4, body.len() as u8][..], body].concat()
}
