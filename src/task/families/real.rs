//! The hidden physics of a family's standard real world. A family's file contains it; only `reality/` reads
//! it.

use serde::Deserialize;

use crate::error::{Error, Result, check_range};
use crate::task::limits::DENSITY_RANGE_KG_M2;

/// The hidden physics of a family's standard real world. Anyone can create it; code outside this crate
/// cannot read it:
///
/// ```compile_fail
/// let sealed = iplw::task::RealPhysics::new(1.0, 0.2, 0.7, 0.8);
/// println!("{}", sealed.friction);
/// ```
///
/// ```compile_fail
/// iplw::task::family("bowling").unwrap().real_physics.open();
/// ```
///
/// Within the crate a test ensures that only `reality/` opens it.
#[derive(Deserialize)]
#[serde(transparent)]
pub struct RealPhysics {
    opened: HiddenPhysics,
}

/// The content of a [`RealPhysics`].
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HiddenPhysics {
    /// kg/m^2
    pub density: f64,
    /// Surface coefficient of every carrier.
    pub friction: f64,
    /// Surface coefficient of every carrier.
    pub restitution: f64,
    /// Fraction of the velocity kept per second; not part of the simulation.
    pub damping: f64,
}

impl RealPhysics {
    /// Seals density (kg/m^2), friction and restitution of every carrier, and the fraction of velocity
    /// kept per second.
    pub const fn new(density: f64, friction: f64, restitution: f64, damping: f64) -> RealPhysics {
        RealPhysics { opened: HiddenPhysics { density, friction, restitution, damping } }
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        let HiddenPhysics { density, friction, restitution, damping } = self.opened;
        check_range("density", density, DENSITY_RANGE_KG_M2[0], DENSITY_RANGE_KG_M2[1])?;
        check_range("friction", friction, 0.0, 100.0)?;
        check_range("restitution", restitution, 0.0, 1.0)?;
        if damping > 0.0 && damping <= 1.0 {
            return Ok(());
        }
        Err(Error::input("damping", damping, "the fraction of velocity kept per second, in (0, 1]"))
    }

    /// A text that identifies the physics; used only in the digest of a family.
    pub(super) fn fingerprint(&self) -> String {
        let HiddenPhysics { density, friction, restitution, damping } = self.opened;
        // Part of the digests of certified tasks: the text must never change.
        format!(
            "Opened {{ density: {density:?}, friction: {friction:?}, restitution: {restitution:?}, damping: {damping:?} }}"
        )
    }

    /// Returns the content; for `reality/` only.
    pub(crate) fn open(&self) -> HiddenPhysics {
        self.opened
    }
}
