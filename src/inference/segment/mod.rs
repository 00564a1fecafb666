//! Trials cut into segments, each simulated from an initial state of its own.
//!
//! `definition`: kinds of segments. `segmentation`: cuts trials. `single_body`: flights, bounces and rolling
//! of one body, by detected contacts (`contact_detection`) and holds (`holds`); `sliding`: whether they slide; `collision`: collisions of two;
//! `corner_contact`: the corners and sides that touch (`contact_geometry`, `closest_features`), by the `free_motion` before and
//! after; `full_state`: segments of all
//! bodies of trials whose initial state is known. `unused_contacts`: contacts in no segment; `block_averages`: averages of long segments.
//!
//! Source: multiple shooting (Bock 1983).
//!
//! Differences from the source: initial states of segments are nuisance parameters and are not tied together,
//! so that errors of contact models do not affect estimates of motion.

mod block_averages;
mod closest_features;
mod collision;
mod contact_detection;
mod contact_geometry;
mod corner_contact;
mod definition;
mod free_motion;
mod full_state;
mod holds;
mod segmentation;
mod single_body;
mod sliding;
mod unused_contacts;

pub use block_averages::{MAX_OBSERVATIONS, average_blocks};
pub use contact_geometry::contact_gap;
#[cfg(test)]
pub use contact_geometry::{ContactFeature, RoundedCorner, TurningVector};
pub use definition::{
    BODY_NUISANCES, COLLISION_NUISANCES, CONTACT_NUISANCES, CollidingPair, MIN_FLIGHT_OBSERVATIONS,
    Observation, Segment, SegmentKind, Surface, any_known_initial_state, any_multi_step, any_one_step,
};
pub use full_state::{initial_state_guess, remove_overlaps};
pub use segmentation::{Segmentation, segment_trials};
pub use unused_contacts::counted;
