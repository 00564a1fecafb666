//! What is wrong alike in all trials of a recording, and none of which may be named: a smooth stray force over position and
//! velocity, a lens, a camera turned a little, a floor off its height, a drag whose exponent is not quite that of the law.

use std::sync::Arc;

use super::Force;
use super::law::Law;
use super::normal;
use iplw::rng;
use rand::RngExt;

/// Least ratio of the path shift by a hidden effect to that by all of this.
pub const RATIO: f64 = 5.0;
/// Range of the stray force's root mean square, m/s^2.
const STRAY: [f64; 2] = [0.05, 0.1];
/// Range of the length over which it varies, m, and the speed, m/s.
const STRAY_LENGTH: [f64; 2] = [1.0, 2.0];
const STRAY_SPEED: f64 = 4.0;
/// Waves that it is made of.
const WAVES: usize = 12;
/// Range of a lens's radial distortion, 1/m^2, and its centre, m.
const LENS: [f64; 2] = [5e-4, 2e-3];
const CENTRE: [f64; 2] = [2.0, 1.0];
/// Standard deviations of the camera's angle, rad, the floor's height, m, and the change of a drag's exponent.
const ANGLE: f64 = 0.1 * std::f64::consts::PI / 180.0;
const HEIGHT: f64 = 2e-3;
const EXPONENT: f64 = 0.03;
/// Speed at which a drag with another exponent is as strong, m/s.
const SPEED: f64 = 4.0;

/// Errors that all trials share.
#[derive(Clone)]
pub struct SharedDirt {
    stray: Force,
    lens: f64,
    angle: f64,
    height: f64,
    exponent: f64,
}

impl SharedDirt {
    pub fn draw(seed: u64) -> SharedDirt {
        let mut r = rng::stream(seed, "shared dirt");
        let rms = r.random_range(STRAY[0]..STRAY[1]);
        let length = r.random_range(STRAY_LENGTH[0]..STRAY_LENGTH[1]);
        let mut wave = || {
            let [x, y, vx, vy]: [f64; 4] = std::array::from_fn(|_| normal(&mut r));
            let rates = [x / length, y / length, vx / STRAY_SPEED, vy / STRAY_SPEED];
            (rates, r.random_range(0.0..std::f64::consts::TAU))
        };
        let axes: [Vec<([f64; 4], f64)>; 2] = std::array::from_fn(|_| (0..WAVES).map(|_| wave()).collect());
        let stray: Force = Arc::new(move |_, s| {
            let at = |(rates, phase): &([f64; 4], f64)| {
                libm::cos(rates.iter().zip(&s).map(|(rate, v)| rate * v).sum::<f64>() + phase)
            };
            let scale = rms * (2.0 / WAVES as f64).sqrt();
            [0, 1].map(|axis| scale * axes[axis].iter().map(at).sum::<f64>())
        });
        let sign = if r.random::<bool>() { 1.0 } else { -1.0 };
        SharedDirt {
            stray,
            lens: sign * r.random_range(LENS[0]..LENS[1]),
            angle: ANGLE * normal(&mut r),
            height: HEIGHT * normal(&mut r),
            exponent: EXPONENT * normal(&mut r),
        }
    }

    /// A share of all of it.
    pub fn scaled(&self, share: f64) -> SharedDirt {
        let stray = self.stray.clone();
        SharedDirt {
            stray: Arc::new(move |t, s| stray(t, s).map(|a| share * a)),
            lens: share * self.lens,
            angle: share * self.angle,
            height: share * self.height,
            exponent: share * self.exponent,
        }
    }

    /// Adds all of it to a law; `is_drag`: whether the law's own forces oppose motion.
    pub fn act(&self, law: &mut Law, is_drag: bool) {
        let exponent = self.exponent;
        for (_, push) in law.pushes.iter_mut().filter(|_| is_drag) {
            let own = push.clone();
            *push = Arc::new(move |t, s| {
                let factor = libm::pow(s[2].hypot(s[3]).max(1e-6) / SPEED, exponent);
                own(t, s).map(|a| factor * a)
            });
        }
        law.pushes.push((1.0, self.stray.clone()));
        law.turn += self.angle;
        law.lens = self.lens;
        law.height = self.height;
    }
}

/// Where a lens of some distortion shows a point, m.
pub fn through_lens(lens: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let [dx, dy] = [x - CENTRE[0], y - CENTRE[1]];
    let share = lens * (dx * dx + dy * dy);
    [x + share * dx, y + share * dy]
}
