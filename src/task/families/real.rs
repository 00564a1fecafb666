//! What is hidden in a family's standard real world. A family's file writes it down; only `reality/` opens it.

use serde::Deserialize;

use crate::error::{Error, Result, within};
use crate::task::limits::DENSITIES;

/// The hidden side of a family's standard real world. It can be made by anyone and read by nobody outside this crate:
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
/// Within the crate a test holds that `reality/` alone opens it.
#[derive(Deserialize)]
#[serde(transparent)]
pub struct RealPhysics {
    opened: Opened,
}

/// What a [`RealPhysics`] seals.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Opened {
    /// kg/m^2
    pub density: f64,
    /// Surface coefficient of every carrier.
    pub friction: f64,
    /// Surface coefficient of every carrier.
    pub restitution: f64,
    /// Kept share of velocity per second, which the simulation does not know of.
    pub damping: f64,
}

impl RealPhysics {
    /// Seals density (kg/m^2), friction and restitution of every carrier, and the kept share of velocity per second.
    pub const fn new(density: f64, friction: f64, restitution: f64, damping: f64) -> RealPhysics {
        RealPhysics { opened: Opened { density, friction, restitution, damping } }
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        let Opened { density, friction, restitution, damping } = self.opened;
        within("density", density, DENSITIES[0], DENSITIES[1])?;
        within("friction", friction, 0.0, 100.0)?;
        within("restitution", restitution, 0.0, 1.0)?;
        if damping > 0.0 && damping <= 1.0 {
            return Ok(());
        }
        Err(Error::input("damping", damping, "a kept share of velocity per second in (0, 1]"))
    }

    /// A text that is another for another physics; for the digest of a family, which goes through it alone.
    pub(super) fn fingerprint(&self) -> String {
        format!("{:?}", self.opened)
    }

    /// For `reality/` alone.
    pub(crate) fn open(&self) -> Opened {
        self.opened
    }
}
