//! Memory that a rollout needs in a thread of a graphics processor.

use super::super::goal::MAX_REGION_POINTS;
use super::super::topology::Topology;

/// Memory of a thread for which the kernel has entry points, kB.
pub const ARENA_SIZES_KB: [usize; 4] = [8, 16, 48, 128];

/// Upper bounds of the bytes of the objects that a thread stores, with the memory that growing vectors abandon; a test
/// compares them with the bytes that the kernel takes.
const FIXED_BYTES: usize = 1024;
const BODY_BYTES: usize = 344;
const LAW_BYTES: usize = 104;
const STATIC_BYTES: usize = 64;
const EDGE_BYTES: usize = 48;
const DISC_PAIR_BYTES: usize = 240;
const OUTLINE_BYTES: usize = 160;
const CORNER_BYTES: usize = 40;
const OUTLINE_PAIR_BYTES: usize = 496;
const REGION_POINT_BYTES: usize = 16;
/// Further bytes for a warm start: of a body, a pair of discs and a pair of outlines.
const WARM_START_BYTES: [usize; 3] = [48, 48, 96];

/// The smallest of [`ARENA_SIZES_KB`] that suffices, if one does.
pub fn arena_size(topology: &Topology) -> Option<usize> {
    let needed = arena_bytes(topology);
    ARENA_SIZES_KB.into_iter().find(|kb| needed <= kb * 1024)
}

/// An upper bound of the bytes that a rollout takes.
pub fn arena_bytes(topology: &Topology) -> usize {
    let bodies = topology.bodies.len();
    let discs = (0..bodies).filter(|i| topology.is_disc(*i)).count();
    let statics = topology.statics.len();
    let edges: usize = topology.statics.iter().map(|(_, corners)| corners).sum();
    let disc_pairs = discs * discs.saturating_sub(1) / 2 + discs * statics;
    let [warm_body, warm_disc, warm_outline] =
        if topology.contacts_established { WARM_START_BYTES } else { [0; 3] };
    let mut bytes = FIXED_BYTES
        + bodies * (BODY_BYTES + warm_body)
        + statics * STATIC_BYTES
        + edges * EDGE_BYTES
        + (topology.motion_laws.len() + topology.contact_laws.len()) * LAW_BYTES
        + disc_pairs * (DISC_PAIR_BYTES + warm_disc)
        + MAX_REGION_POINTS * REGION_POINT_BYTES;
    if discs < bodies {
        let pieces: usize = topology.bodies.iter().map(|corners| corners.len().max(1)).sum();
        let corners: usize = topology.bodies.iter().map(|corners| corners.iter().sum::<usize>().max(1)).sum();
        let pairs = pieces * pieces.saturating_sub(1) / 2 + pieces * statics - disc_pairs;
        bytes += (pieces + statics) * OUTLINE_BYTES
            + (2 * corners + edges) * CORNER_BYTES
            + pairs * (OUTLINE_PAIR_BYTES + warm_outline);
    }
    bytes
}
