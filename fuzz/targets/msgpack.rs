//! msgpack: a request body, and the first frame of a message.

use iplw::rng::Stream;
use iplw::serve::fuzz::msgpack;
use rand::RngExt;

use super::{MIB, Target, bytes};

pub const TARGET: Target = Target {
    name: "msgpack",
    short: 20_000,
    long: 100_000_000,
    work: 64 * MIB,
    seeds,
    mutate,
    check: |bytes| {
        // JSON of documents with many single numbers is much larger; 4 KiB of msgpack are enough.
        msgpack(&bytes[..bytes.len().min(4096)])
    },
};

fn mutate(seed: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Stream) {
    if draw.random_range(0..3) == 0 {
        seed.clear();
        value(seed, 0, draw);
    } else {
        bytes::mutate(seed, seeds, &WORDS, draw);
    }
}

const WORDS: [&[u8]; 16] = [
    b"\xc0",
    b"\xc1",
    b"\xca\x7f\xc0\x00\x00",
    b"\xcb\x7f\xf0\x00\x00\x00\x00\x00\x00",
    b"\xcb\x80\x00\x00\x00\x00\x00\x00\x00",
    b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\xd3\x80\x00\x00\x00\x00\x00\x00\x00",
    b"\xdb\xff\xff\xff\xff",
    b"\xdd\x00\x10\x00\x00",
    b"\xdf\x7f\xff\xff\xff",
    b"\xc6\x00\x00\x00\x02ab",
    b"\xc7\x0e\x4e\x93\xa3<f8\x91\x01\xc4\x08\x00\x00\x00\x00\x00\x00\xf0\x3f",
    b"\xc7\x0a\x4e\x93\xa3|u1\x91\x02\xc4\x02\x07\x08",
    b"\xd4\x4e\xc0",
    b"\x81\xa1k",
    b"\xa4op\xc3\xa4",
];

fn seeds() -> Vec<Vec<u8>> {
    let header = b"\x87\xa1v\x01\xa2id\xa3one\xa2op\xabstep_worlds\xa4args\x81\xa6worlds\x92\xa1a\xa1b\
        \xa3raw\xc3\xa8deadline\xcb\x40\x04\x00\x00\x00\x00\x00\x00\
        \xa6arrays\x92\x83\xa4name\xa7actions\xa5dtype\xa3<f8\xa5shape\x91\x01\
        \x83\xa4name\xa4body\xa5dtype\xa3|u1\xa5shape\x91\x03";
    let deep = b"\x85\xa1v\x01\xa2id\x07\xa2op\xa1x\xa4args\x81\xa1a\x80\xa6arrays\x92\
        \x83\xa4name\xa5a.b.c\xa5dtype\xa3<f8\xa5shape\x91\x01\x83\xa4name\xa1d\xa5dtype\xa3|u1\xa5shape\x91\x03";
    vec![
        header.to_vec(),
        deep.to_vec(),
        b"\x84\xa1v\x01\xa2id\x07\xa2op\xa6cancel\xa4args\x81\xa7request\x07".to_vec(),
        b"\x85\xa1v\x01\xa2id\xc4\x02ab\xa2op\xa4ping\xa3key\xa1k\xa4args\xc0".to_vec(),
        b"\x82\xa1a\x93\x01\xff\xcb\x3f\xb9\x99\x99\x99\x99\x99\x9a\xa1b\xc7\x0e\x4e\x93\xa3<f8\x91\x01\
            \xc4\x08\x00\x00\x00\x00\x00\x00\xf0\x3f"
            .to_vec(),
        b"\xdc\x00\x03\xcd\x01\x00\xd1\xff\x00\xca\x3f\x80\x00\x00".to_vec(),
        b"\x91".repeat(63).into_iter().chain([0xc0]).collect(),
        b"\xde\x00\x01\xd9\x01x\xc2".to_vec(),
    ]
}

/// Appends a valid value, with counts and lengths that are nearly always right.
fn value(out: &mut Vec<u8>, depth: u32, draw: &mut Stream) {
    let kind = draw.random_range(0..if depth < 6 { 12 } else { 8 });
    match kind {
        0 => out.push(draw.random()),
        1 => out.push([0xc0, 0xc2, 0xc3][draw.random_range(0..3)]),
        2 => {
            let (marker, wide) =
                [(0xcc, 1), (0xcd, 2), (0xce, 4), (0xcf, 8), (0xd0, 1), (0xd1, 2), (0xd2, 4), (0xd3, 8)]
                    [draw.random_range(0..8)];
            out.push(marker);
            out.extend((0..wide).map(|_| draw.random::<u8>()));
        }
        3 => {
            out.push(0xcb);
            out.extend(f64::from_bits(draw.random()).to_be_bytes());
        }
        4 => {
            out.push(0xca);
            out.extend(f32::from_bits(draw.random()).to_be_bytes());
        }
        5 | 6 => text(out, draw),
        7 => array(out, draw),
        8 | 9 => {
            let n = draw.random_range(0..6);
            out.push(0x90 | n);
            (0..n).for_each(|_| value(out, depth + 1, draw));
        }
        _ => {
            let n = draw.random_range(0..6);
            out.push(0x80 | n);
            for _ in 0..n {
                text(out, draw);
                value(out, depth + 1, draw);
            }
        }
    }
}

fn text(out: &mut Vec<u8>, draw: &mut Stream) {
    let words = [
        "v",
        "id",
        "op",
        "args",
        "arrays",
        "key",
        "raw",
        "name",
        "dtype",
        "shape",
        "body",
        "ä\u{10ffff}",
        "",
    ];
    let text = words[draw.random_range(0..words.len())];
    out.push(0xa0 | text.len() as u8);
    out.extend(text.bytes());
}

/// An array as extension type 78.
fn array(out: &mut Vec<u8>, draw: &mut Stream) {
    let (dtype, wide) =
        [("<f8", 8), ("<f4", 4), ("|b1", 1), ("<i8", 8), ("<u4", 4), (">f8", 8)][draw.random_range(0..6)];
    let shape: Vec<u8> = (0..draw.random_range(0..4)).map(|_| draw.random_range(0..4)).collect();
    let count: usize = shape.iter().map(|n| usize::from(*n)).product();
    let mut body = vec![0x93, 0xa3];
    body.extend(dtype.bytes());
    body.push(0x90 | shape.len() as u8);
    body.extend(&shape);
    let bytes = (count * wide).min(200) as u8;
    body.extend([0xc4, bytes]);
    body.extend((0..bytes).map(|_| draw.random::<u8>()));
    out.extend([0xc7, body.len().min(255) as u8, 78]);
    out.extend(body);
}
