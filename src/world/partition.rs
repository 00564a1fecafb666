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
    /// For an accelerator.
    pub accelerated: Vec<AcceleratedGroup>,
}

/// Rollouts of one topology that an accelerator can run.
pub struct AcceleratedGroup {
    pub indices: Vec<usize>,
    /// Memory of a thread, kB.
    pub arena_kb: usize,
    /// Maximum number of rollouts of a launch.
    pub launch_size: usize,
}

/// Engine and topology of a group.
#[derive(PartialEq)]
struct GroupKind {
    engine: Engine,
    /// `None` for the general engine.
    topology: Option<Topology>,
    /// Memory of a thread of an accelerator, kB; `None` if the group runs on the CPU.
    arena_kb: Option<usize>,
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

/// Least number of rollouts for which [`Engine::Auto`] considers an accelerator. Opening a device takes about as long as
/// so many short rollouts on a CPU.
pub const MIN_ACCELERATED_ROLLOUTS: usize = 1 << 14;

/// Up to this many rollouts are checked on the calling thread.
const MAX_SERIAL_ROLLOUTS: usize = LANES;

/// Units of rollouts for the batched engine.
pub fn lanes_units(indices: &[usize]) -> Vec<WorkUnit> {
    units_of_share(indices, indices.len())
}

/// The same, if they are part of a batch of so many.
fn units_of_share(indices: &[usize], batch: usize) -> Vec<WorkUnit> {
    let share = batch.div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(UNIT_SIZE_RANGE[0], UNIT_SIZE_RANGE[1]);
    indices.chunks(size).map(|part| WorkUnit::Lanes(part.to_vec())).collect()
}

/// Checks every rollout, so that invalid input is rejected before any work is done, and partitions the work.
/// The partition does not affect results. Compiled models are discarded: memory stays constant in the number
/// of rollouts.
pub fn partition(
    rollouts: &[Rollout],
    engine: Engine,
    budget: &dyn Budget,
    compile: impl Fn(&Rollout) -> Result<RolloutModel> + Sync,
) -> Result<Partition> {
    let considers_accelerator = match engine {
        Engine::Gpu => true,
        Engine::Auto => rollouts.len() >= MIN_ACCELERATED_ROLLOUTS,
        Engine::Lanes | Engine::Rapier => false,
    };
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
            let considered = considers_accelerator && engine != Engine::Rapier;
            let arena_kb = if considered { gpu::thread_memory_kb(&model) } else { None };
            let launch_size = if arena_kb.is_some() { gpu::launch_size(&model) } else { usize::MAX };
            last = group(&mut groups, GroupKind { engine, topology, arena_kb }, launch_size);
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
    let mut partition = Partition { units: Vec::new(), accelerated: Vec::new() };
    for TopologyGroup { kind, indices, launch_size } in groups {
        let enough = kind.engine == Engine::Gpu || indices.len() >= MIN_ACCELERATED_ROLLOUTS;
        match kind {
            GroupKind { engine: Engine::Rapier, .. } => {
                partition.units.extend(indices.into_iter().map(WorkUnit::Rapier));
            }
            GroupKind { arena_kb: Some(arena_kb), .. } if enough => {
                partition.accelerated.push(AcceleratedGroup { indices, arena_kb, launch_size });
            }
            _ => partition.units.extend(units_of_share(&indices, rollouts.len())),
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
