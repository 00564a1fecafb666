//! Laws by the index of their effect in [`REGISTRY`].
//!
//! Calls are direct, not through pointers: a graphics processor cannot tell how much stack a call through a pointer
//! needs. Every index is a constant, so the compiler looks the law up in the registry.

use super::{
    ConstantLanes, Constants, ContactLaw, ContactResponse, ContactState, EffectKind, MotionLaw,
    MotionStateLanes, REGISTRY,
};

/// Calls `$call` with the effect of a constant index.
macro_rules! with_index {
    ($index:expr, $call:ident $arguments:tt, $none:expr) => {
        with_index!($index, $call, $arguments, $none;
            0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31)
    };
    ($index:expr, $call:ident, $arguments:tt, $none:expr; $($i:literal)*) => {
        match $index {
            $($i => $call::<$i> $arguments,)*
            _ => $none,
        }
    };
}

const _: () = assert!(REGISTRY.len() <= 32, "more effects than `with_index` lists");

/// [`MotionLaw::kick_lanes`] of the effect with this index; nothing if it has no law of motion.
#[inline(never)]
pub fn kick_lanes(effect: usize, constants: &ConstantLanes, bodies: &mut MotionStateLanes, dt: f64) {
    with_index!(effect, kick(constants, bodies, dt), ())
}

/// [`ContactLaw::respond`] of the effect with this index.
#[inline(never)]
pub fn respond(
    effect: usize,
    constants: &Constants,
    contact: ContactState,
    base: ContactResponse,
) -> ContactResponse {
    with_index!(effect, response(constants, contact, base), base)
}

/// [`ContactLaw::rolling_loss`] of the effect with this index.
#[inline(never)]
pub fn rolling_loss(effect: usize, constants: &Constants, load: f64) -> f64 {
    with_index!(effect, loss(constants, load), 0.0)
}

fn kick<const I: usize>(constants: &ConstantLanes, bodies: &mut MotionStateLanes, dt: f64) {
    if let Some(law) = const { motion(I) } {
        law.kick_lanes(constants, bodies, dt);
    }
}

fn response<const I: usize>(
    constants: &Constants,
    contact: ContactState,
    base: ContactResponse,
) -> ContactResponse {
    const { contact_law(I) }.map_or(base, |law| law.respond(constants, contact, base))
}

fn loss<const I: usize>(constants: &Constants, load: f64) -> f64 {
    const { contact_law(I) }.map_or(0.0, |law| law.rolling_loss(constants, load))
}

const fn motion(effect: usize) -> Option<&'static dyn MotionLaw> {
    if effect >= REGISTRY.len() {
        return None;
    }
    match REGISTRY[effect].kind {
        EffectKind::Motion(law) => Some(law),
        _ => None,
    }
}

const fn contact_law(effect: usize) -> Option<&'static dyn ContactLaw> {
    if effect >= REGISTRY.len() {
        return None;
    }
    match REGISTRY[effect].kind {
        EffectKind::Contact(law) => Some(law),
        _ => None,
    }
}
