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
    /// The same for one launch on an accelerator.
    Accelerated(Vec<usize>),
}

/// The units of the processor, and those of an accelerator.
pub fn split_off_accelerated(work: Vec<WorkUnit>) -> (Vec<WorkUnit>, Vec<Vec<usize>>) {
    let (mut processor, mut accelerator) = (Vec::new(), Vec::new());
    for unit in work {
        match unit {
            WorkUnit::Accelerated(indices) => accelerator.push(indices),
            unit => processor.push(unit),
        }
    }
    (processor, accelerator)
}

/// The engine and the topology of a group; without topology for the general engine.
#[derive(PartialEq)]
struct GroupKind {
    topology: Option<Topology>,
    /// Rollouts of a launch on an accelerator; `None` on the processor.
    launch: Option<usize>,
}

/// Indices of the rollouts of one kind.
type TopologyGroup = (GroupKind, Vec<usize>);

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
) -> Result<Vec<WorkUnit>> {
    let check_chunk = |(chunk, rollouts): (usize, &[Rollout])| -> Result<Vec<TopologyGroup>> {
        let mut groups: Vec<TopologyGroup> = Vec::new();
        // Group of the previous rollout.
        let mut last = 0;
        budget.check()?;
        for (i, rollout) in rollouts.iter().enumerate() {
            let same_start = |other: &Rollout| rollout.contacts_established == other.contacts_established;
            if i > 0 && is_variant_of(rollout, &rollouts[i - 1]) && same_start(&rollouts[i - 1]) {
                groups[last].1.push(chunk * UNIT_SIZE_RANGE[1] + i);
                continue;
            }
            let model = compile(rollout)?;
            let topology = Topology::of(&model);
            let kind = match engine_for(engine, &model, &topology)? {
                Engine::Lanes => GroupKind { topology: Some(topology), launch: None },
                Engine::Gpu => GroupKind { topology: Some(topology), launch: Some(gpu::launch_size(&model)) },
                Engine::Rapier | Engine::Auto => GroupKind { topology: None, launch: None },
            };
            last = group(&mut groups, kind);
            groups[last].1.push(chunk * UNIT_SIZE_RANGE[1] + i);
        }
        Ok(groups)
    };
    let checked_chunks: Vec<Result<Vec<TopologyGroup>>> = match rollouts.len() {
        0..=MAX_SERIAL_ROLLOUTS => rollouts.chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
        _ => rollouts.par_chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
    };
    let mut groups = Vec::new();
    for chunk in checked_chunks {
        for (kind, indices) in chunk? {
            let at = group(&mut groups, kind);
            groups[at].1.extend(indices);
        }
    }
    let share = rollouts.len().div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(UNIT_SIZE_RANGE[0], UNIT_SIZE_RANGE[1]);
    let parts = groups.into_iter().flat_map(|(kind, indices)| match kind {
        GroupKind { topology: None, .. } => {
            indices.into_iter().map(WorkUnit::Rapier).collect::<Vec<WorkUnit>>()
        }
        GroupKind { launch: Some(size), .. } => {
            indices.chunks(size).map(|part| WorkUnit::Accelerated(part.to_vec())).collect()
        }
        _ => indices.chunks(size).map(|part| WorkUnit::Lanes(part.to_vec())).collect(),
    });
    Ok(parts.collect())
}

/// Index of the group of a kind, added if there is none.
fn group(groups: &mut Vec<TopologyGroup>, kind: GroupKind) -> usize {
    groups.iter().rposition(|(k, _)| *k == kind).unwrap_or_else(|| {
        groups.push((kind, Vec::new()));
        groups.len() - 1
    })
}
