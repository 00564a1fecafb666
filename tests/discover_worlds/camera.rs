//! Camera observations of trials: correlated noise, outliers and missing points, or almost none of it.

use super::law::{Law, Motion, State};
use super::normal;
use iplw::reality::{Trial, trials_from_csv};
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;

/// Correlation of the noise of neighbouring points.
pub const CORRELATION: f64 = 0.5;
/// Share of outliers, and their distance in standard deviations of the noise.
pub const OUTLIERS: f64 = 0.02;
pub const OUTLYING: f64 = 5.0;
/// Share of missing points.
pub const MISSING: f64 = 0.03;
/// Standard deviation of the noise of a clean twin, m.
const TRACE: f64 = 1e-6;
/// Standard deviation of an observed angle, and that of a clean twin, rad.
const MARKED: [f64; 2] = [0.03, 2e-5];

/// A camera.
pub struct Camera<'a> {
    pub motion: Motion,
    pub scene: &'a Scene,
    pub starts: &'a [State],
    pub times: &'a [Vec<f64>],
    /// Whether the angle is observed.
    pub marked: bool,
    pub seed: u64,
}

impl Camera<'_> {
    /// Trials with correlated noise, outliers and missing points.
    pub fn recorded(&self, laws: &[Law], sd: f64) -> Vec<Trial> {
        let mut r = rng::stream(self.seed, "recorded noise");
        let mut carried = [normal(&mut r), normal(&mut r)];
        self.trials(laws, |k, [x, y, angle]| {
            let fresh = (1.0 - CORRELATION * CORRELATION).sqrt();
            for c in &mut carried {
                let new = normal(&mut r);
                *c = if k == 0 { new } else { CORRELATION * *c + fresh * new };
            }
            let off = if r.random_range(0.0..1.0) < OUTLIERS { OUTLYING } else { 0.0 };
            let way: f64 = r.random_range(0.0..std::f64::consts::TAU);
            let missing = r.random_range(0.0..1.0) < MISSING;
            let angle = angle + MARKED[0] * normal(&mut r);
            let at = |v: f64, c: f64, way: f64| v + sd * (c + off * way);
            (!missing).then_some([at(x, carried[0], way.cos()), at(y, carried[1], way.sin()), angle])
        })
    }

    /// Trials almost without noise.
    pub fn clean(&self, laws: &[Law]) -> Vec<Trial> {
        let mut r = rng::stream(self.seed, "clean noise");
        self.trials(laws, |_, [x, y, angle]| {
            let mut about = |v: f64, sd: f64| v + sd * normal(&mut r);
            Some([about(x, TRACE), about(y, TRACE), about(angle, MARKED[1])])
        })
    }

    /// `err`: from the index of a point in its trial and its position to its observation.
    fn trials(&self, laws: &[Law], mut err: impl FnMut(usize, [f64; 3]) -> Option<[f64; 3]>) -> Vec<Trial> {
        let mut csv = String::from("trial,t,body,x,y");
        csv += if self.marked { ",angle\n" } else { "\n" };
        for (i, ((law, start), times)) in laws.iter().zip(self.starts).zip(self.times).enumerate() {
            for (k, (t, at)) in times.iter().zip(law.seen(self.motion, *start, times)).enumerate() {
                let seen = err(k, at).map_or([const { String::new() }; 3], |s| s.map(|v| v.to_string()));
                let [x, y, angle] = seen;
                csv += &format!("{i},{t},ball,{x},{y}");
                csv += &if self.marked { format!(",{angle}\n") } else { "\n".into() };
            }
        }
        trials_from_csv(&csv, self.scene).expect("generated trials are valid")
    }
}
