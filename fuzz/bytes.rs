//! Mutations of byte strings.

use iplw::rng::Stream;
use rand::RngExt;

/// Flips, cuts, duplicates, removes or inserts bytes, or splices in another seed; `words` are a dictionary of useful tokens.
pub fn mutate(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[&[u8]], draw: &mut Stream) {
    // Mostly one change: nearly valid inputs get furthest.
    let changes = [1, 1, 1, 2, 3, 6][draw.random_range(0..6)];
    for _ in 0..changes {
        change(bytes, seeds, words, draw);
    }
    bytes.truncate(MAX_MUTANT_BYTES);
}

/// Maximum size of a mutant, bytes.
const MAX_MUTANT_BYTES: usize = 64 * 1024;

/// Boundary values of bytes, lengths and counts, big endian.
const BOUNDARY_VALUES: [u64; 12] =
    [0, 1, 0x7f, 0x80, 0xff, 0x100, 0x7fff, 0xffff, 0x0100_0000, 0x7fff_ffff, 0xffff_ffff, u64::MAX];

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[&[u8]], draw: &mut Stream) {
    let at = draw.random_range(0..=bytes.len());
    let some = |draw: &mut Stream| (at + draw.random_range(0..16)).min(bytes.len());
    match draw.random_range(0..10) {
        0 if at < bytes.len() => bytes[at] ^= 1 << draw.random_range(0..8),
        1 if at < bytes.len() => bytes[at] = draw.random(),
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(at..some(draw))),
        4 => {
            let part = bytes[at..some(draw)].to_vec();
            for _ in 0..draw.random_range(1..8) {
                bytes.splice(at..at, part.iter().copied());
            }
        }
        5 => {
            let edge = BOUNDARY_VALUES[draw.random_range(0..BOUNDARY_VALUES.len())].to_be_bytes();
            let wide = [1, 2, 4, 8][draw.random_range(0..4)];
            let to = (at + wide).min(bytes.len());
            bytes.splice(at..to, edge[8 - wide..].iter().copied());
        }
        6 | 7 if !words.is_empty() => {
            let word = words[draw.random_range(0..words.len())];
            let to = if draw.random() { at } else { (at + word.len()).min(bytes.len()) };
            bytes.splice(at..to, word.iter().copied());
        }
        8 => {
            let other = &seeds[draw.random_range(0..seeds.len())];
            let from = draw.random_range(0..=other.len());
            let to = (from + draw.random_range(0..64)).min(other.len());
            bytes.splice(at..at, other[from..to].iter().copied());
        }
        _ => bytes.insert(at, draw.random()),
    }
}
