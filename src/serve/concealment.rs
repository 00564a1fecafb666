//! Hidden physics that a client chose for its own real world: seen by that client and by scope `admin` alone.

use crate::access::{Principal, Scope};
use crate::job::Job;

/// Fields of `real` in a request that hold hidden physics.
const HIDDEN_FIELDS: [&str; 3] = ["latents", "effects", "damping"];

/// Whether a principal may see the hidden physics that this owner chose.
pub fn may_see_physics(who: &Principal, owner: Option<&str>) -> bool {
    who.scope == Scope::Admin || (owner.is_some() && owner == who.owner())
}

/// The job as a principal may see it: without the hidden physics of another client's request. Its name, its note and its owner are
/// visible to whoever sees the job, and its summary shows nothing that its result does not.
pub fn conceal_job(mut job: Job, who: &Principal) -> Job {
    if !may_see_physics(who, job.row.owner.as_deref())
        && let Some(real) = job.row.config.get_mut("real").and_then(|real| real.as_object_mut())
    {
        HIDDEN_FIELDS.iter().for_each(|field| drop(real.remove(*field)));
    }
    job
}
