//! Effects in joints: one file each, listed in [`REGISTRY`].
//!
//! A file declares the law, its parameters with units, bounds and plausible sizes, and how it shows in recordings.

mod backlash;
mod base_tilt;
mod centre_shift;
mod cogging;
mod command_delay;
mod coulomb_friction;
mod declaration;
mod encoder_lag;
mod encoder_offset;
mod encoder_resolution;
mod encoder_scale;
mod inertia_factor;
mod joint_compliance;
mod link_length;
mod motor_gain;
mod payload;
mod stribeck_friction;
mod torque_offset;
mod torque_saturation;
mod viscous_friction;

use crate::error::{Error, Result, check_range};
use crate::task::scene::EffectTerm;
pub use declaration::{
    Applicability, DriveLaw, JointEffect, JointLanes, JointLaw, JointParameter, JointScale, JointState,
    JointTerm, LawValues, LinkChange, MAX_PARAMETERS, TorqueLaw,
};
use declaration::{factor, parameter};

/// Every effect in joints.
pub static REGISTRY: &[&JointEffect] = &[
    &viscous_friction::EFFECT,
    &coulomb_friction::EFFECT,
    &stribeck_friction::EFFECT,
    &torque_offset::EFFECT,
    &cogging::EFFECT,
    &motor_gain::EFFECT,
    &torque_saturation::EFFECT,
    &command_delay::EFFECT,
    &payload::EFFECT,
    &link_length::EFFECT,
    &centre_shift::EFFECT,
    &inertia_factor::EFFECT,
    &base_tilt::EFFECT,
    &backlash::EFFECT,
    &joint_compliance::EFFECT,
    &encoder_scale::EFFECT,
    &encoder_offset::EFFECT,
    &encoder_lag::EFFECT,
    &encoder_resolution::EFFECT,
];

/// The effect named `name`.
pub fn find(name: &str) -> Result<&'static JointEffect> {
    let found = REGISTRY.iter().copied().find(|e| e.name == name);
    found.ok_or_else(|| Error::not_found("effect in joints", name, REGISTRY.iter().map(|e| e.name)))
}

/// The term of a joint's effect in a scene; `place` prefixes the field of an error.
pub fn resolve(term: &EffectTerm, joint: usize, place: &str) -> Result<JointTerm> {
    let effect = find(&term.name).map_err(|e| e.unknown_in(&format!("{place}.name")))?;
    if let Some(unknown) =
        term.parameters.keys().find(|key| !effect.parameters.iter().any(|p| p.name == **key))
    {
        let known = effect.parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        let field = format!("{place}.parameters.{unknown}");
        return Err(Error::input(field, "unknown", format!("parameters of {}: {known}", effect.name)));
    }
    let value = |p: &JointParameter| {
        let value = term.parameters.get(p.name).copied().unwrap_or(p.neutral);
        check_range(&format!("{place}.parameters.{}", p.name), value, p.bounds[0], p.bounds[1])
    };
    Ok(JointTerm { effect, joint, values: effect.parameters.iter().map(value).collect::<Result<_>>()? })
}
