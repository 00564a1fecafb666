//! Preparation of trials for a diagnosis: segmentation, noise, cleaning, alignment with the simulation.

pub mod cleaning;
pub mod discretisation;
pub mod noise;
pub mod preprocessing;
pub mod smoothing;
pub mod surface_offsets;
pub mod time_alignment;
