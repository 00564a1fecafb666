//! The hidden physics of a family's standard real world. A family's file contains it; only `reality/` reads
//! it.

use rand::RngExt;
use serde::Deserialize;

use crate::error::{Error, Result, check_range};
use crate::rng;
use crate::task::limits::{DENSITY_RANGE_KG_M2, FRICTION_RANGE, RESTITUTION_RANGE};

/// The hidden physics of a family's standard real world. Anyone can create it; code outside this crate
/// cannot read it:
///
/// ```compile_fail
/// let sealed = iplw::task::RealPhysics::new(1.0, 0.2, 0.7, 0.8);
/// println!("{}", sealed.friction);
/// ```
///
/// ```compile_fail
/// iplw::task::family("bowling").unwrap().real_physics.draw(0);
/// ```
///
/// Within the crate a test ensures that only `reality/` opens it.
#[derive(Deserialize)]
#[serde(transparent)]
pub struct RealPhysics {
    opened: HiddenRanges,
}

/// The content of a [`RealPhysics`].
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HiddenRanges {
    density: HiddenValue,
    friction: HiddenValue,
    restitution: HiddenValue,
    damping: HiddenValue,
}

/// A hidden number, or the ends of the range from which each real world draws its own.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "a number, or [lowest, highest]")]
enum HiddenValue {
    Fixed(f64),
    Range([f64; 2]),
}

/// The hidden physics of one real world.
#[derive(Clone, Copy, Debug)]
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
        let [density, friction, restitution, damping] = [
            HiddenValue::Fixed(density),
            HiddenValue::Fixed(friction),
            HiddenValue::Fixed(restitution),
            HiddenValue::Fixed(damping),
        ];
        RealPhysics { opened: HiddenRanges { density, friction, restitution, damping } }
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        let HiddenRanges { density, friction, restitution, damping } = self.opened;
        density.validate("density", DENSITY_RANGE_KG_M2)?;
        friction.validate("friction", FRICTION_RANGE)?;
        restitution.validate("restitution", RESTITUTION_RANGE)?;
        damping.validate("damping", [0.0, 1.0])?;
        if damping.ends()[0] > 0.0 {
            return Ok(());
        }
        Err(Error::input("damping", damping.ends()[0], "the fraction of velocity kept per second, in (0, 1]"))
    }

    /// A text that identifies the physics; used only in the digest of a family.
    pub(super) fn fingerprint(&self) -> String {
        let HiddenRanges { density, friction, restitution, damping } = self.opened;
        let [density, friction, restitution, damping] =
            [density, friction, restitution, damping].map(HiddenValue::fingerprint);
        // Part of the digests of certified tasks: the text must never change.
        format!(
            "Opened {{ density: {density}, friction: {friction}, restitution: {restitution}, damping: {damping} }}"
        )
    }

    /// The physics of the real world with this seed; for `reality/` only.
    pub(crate) fn draw(&self, seed: u64) -> HiddenPhysics {
        self.each(|name, [low, high]| {
            low + (high - low) * rng::stream(seed, &format!("real {name}")).random::<f64>()
        })
    }

    /// The physics at the centre of all ranges, with which tasks are certified; for `reality/` only.
    pub(crate) fn centre(&self) -> HiddenPhysics {
        self.each(|_, [low, high]| (low + high) / 2.0)
    }

    /// Fixed values, and `of` the name and the ends of each range.
    fn each(&self, of: impl Fn(&str, [f64; 2]) -> f64) -> HiddenPhysics {
        let value = |name: &str, value: HiddenValue| match value {
            HiddenValue::Fixed(value) => value,
            HiddenValue::Range(ends) => of(name, ends),
        };
        let HiddenRanges { density, friction, restitution, damping } = self.opened;
        HiddenPhysics {
            density: value("density", density),
            friction: value("friction", friction),
            restitution: value("restitution", restitution),
            damping: value("damping", damping),
        }
    }
}

impl HiddenValue {
    fn ends(self) -> [f64; 2] {
        match self {
            HiddenValue::Fixed(value) => [value, value],
            HiddenValue::Range(ends) => ends,
        }
    }

    fn validate(self, name: &str, [least, most]: [f64; 2]) -> Result<()> {
        let [low, high] = self.ends();
        check_range(name, low, least, most)?;
        check_range(name, high, least, most)?;
        if low > high {
            let allowed = "a number, or [lowest, highest]";
            return Err(Error::input(name, format!("[{low}, {high}]"), allowed));
        }
        Ok(())
    }

    fn fingerprint(self) -> String {
        match self {
            HiddenValue::Fixed(value) => format!("{value:?}"),
            HiddenValue::Range(ends) => format!("{ends:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(friction: &str) -> Result<RealPhysics> {
        let text = format!("density = 1.0\nfriction = {friction}\nrestitution = 0.5\ndamping = 1.0");
        let physics: RealPhysics = toml::from_str(&text).map_err(|e| Error::Failed(e.to_string()))?;
        physics.validate().map(|()| physics)
    }

    #[test]
    fn draws_ranges_by_seed_and_keeps_fixed_values() {
        let physics = parsed("[0.2, 0.6]").unwrap();
        let drawn: Vec<f64> = (0..200).map(|seed| physics.draw(seed).friction).collect();
        assert!(drawn.iter().all(|f| (0.2..0.6).contains(f)));
        assert!((drawn.iter().sum::<f64>() / 200.0 - 0.4).abs() < 0.03);
        assert_eq!(physics.draw(3).friction, drawn[3]);
        assert_eq!((physics.draw(3).density, physics.centre().friction), (1.0, 0.4));
        assert_eq!(parsed("0.3").unwrap().draw(7).friction, 0.3);
    }

    #[test]
    fn rejects_ranges_out_of_order_or_out_of_bounds() {
        for bad in ["[0.6, 0.2]", "[-0.1, 0.2]", "[0.2, 101.0]", "\"low\"", "[0.2]"] {
            assert!(parsed(bad).is_err(), "{bad}");
        }
    }
}
