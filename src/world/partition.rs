//! Partition of a batch into units of work.

use rayon::prelude::*;

use super::compile::{RolloutModel, is_variant_of};
use super::effect::LANES;
use super::engine::{Engine, engine_for};
use super::lanes::{Topology, gpu};
use super::rollout::Rollout;
use crate::budget::Budget;
use crate::error::Result;

/// A unit of work for one thread: indices of rollouts.
pub enum WorkUnit {
    Rapier(usize),
    /// Rollouts of one topology.
    Lanes(Vec<usize>),
}

/// A batch in parts.
pub struct Partition {
    /// For the CPU.
    pub units: Vec<WorkUnit>,
    /// For launches on an accelerator: rollouts of one topology.
    pub launches: Vec<Vec<usize>>,
}

/// Engine and topology of a group.
#[derive(PartialEq)]
struct GroupKind {
    engine: Engine,
    /// `None` for the general engine.
    topology: Option<Topology>,
}

/// Rollouts of one kind.
struct TopologyGroup {
    kind: GroupKind,
    indices: Vec<usize>,
    /// Rollouts of a launch.
    launch_size: usize,
}

/// Minimum and maximum number of rollouts per unit: enough to keep all lanes busy until near the end, and
/// enough units for all threads.
pub const UNIT_SIZE_RANGE: [usize; 2] = [2 * LANES, 32 * LANES];

/// Up to this many rollouts are checked on the calling thread.
const MAX_SERIAL_ROLLOUTS: usize = LANES;

/// Checks every rollout, so that invalid input is rejected before any work is done, and partitions the work.
/// The partition does not affect results. Compiled models are discarded: memory stays constant in the number
/// of rollouts.
pub fn partition(
    rollouts: &[Rollout],
    engine: Engine,
    budget: &dyn Budget,
    compile: impl Fn(&Rollout) -> Result<RolloutModel> + Sync,
) -> Result<Partition> {
    let check_chunk = |(chunk, rollouts): (usize, &[Rollout])| -> Result<Vec<TopologyGroup>> {
        let mut groups: Vec<TopologyGroup> = Vec::new();
        // Group of the previous rollout.
        let mut last = 0;
        budget.check()?;
        for (i, rollout) in rollouts.iter().enumerate() {
            let same_start = |other: &Rollout| rollout.contacts_established == other.contacts_established;
            if i > 0 && is_variant_of(rollout, &rollouts[i - 1]) && same_start(&rollouts[i - 1]) {
                groups[last].indices.push(chunk * UNIT_SIZE_RANGE[1] + i);
                continue;
            }
            let model = compile(rollout)?;
            let engine = engine_for(engine, &model)?;
            let topology = (engine != Engine::Rapier).then(|| Topology::of(&model));
            let launch_size = if engine == Engine::Gpu { gpu::launch_size(&model) } else { usize::MAX };
            last = group(&mut groups, GroupKind { engine, topology }, launch_size);
            groups[last].indices.push(chunk * UNIT_SIZE_RANGE[1] + i);
        }
        Ok(groups)
    };
    let checked_chunks: Vec<Result<Vec<TopologyGroup>>> = match rollouts.len() {
        0..=MAX_SERIAL_ROLLOUTS => rollouts.chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
        _ => rollouts.par_chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
    };
    let mut groups = Vec::new();
    for chunk in checked_chunks {
        for part in chunk? {
            let at = group(&mut groups, part.kind, part.launch_size);
            groups[at].indices.extend(part.indices);
        }
    }
    let share = rollouts.len().div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(UNIT_SIZE_RANGE[0], UNIT_SIZE_RANGE[1]);
    let mut partition = Partition { units: Vec::new(), launches: Vec::new() };
    for TopologyGroup { kind, indices, launch_size } in groups {
        let parts = |size: usize| indices.chunks(size).map(<[usize]>::to_vec);
        match kind.engine {
            Engine::Rapier => partition.units.extend(indices.into_iter().map(WorkUnit::Rapier)),
            Engine::Gpu => partition.launches.extend(parts(launch_size)),
            Engine::Auto | Engine::Lanes => partition.units.extend(parts(size).map(WorkUnit::Lanes)),
        }
    }
    Ok(partition)
}

/// Index of the group of a kind, added if there is none; its launches suit the longest output.
fn group(groups: &mut Vec<TopologyGroup>, kind: GroupKind, launch_size: usize) -> usize {
    let at = groups.iter().rposition(|group| group.kind == kind).unwrap_or_else(|| {
        groups.push(TopologyGroup { kind, indices: Vec::new(), launch_size });
        groups.len() - 1
    });
    groups[at].launch_size = groups[at].launch_size.min(launch_size);
    at
}
