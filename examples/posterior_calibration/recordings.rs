//! Recordings of a thrown ball with linear drag. The drag is drawn from its prior, and so are the variance components with the
//! hyperpriors of the diagnosis (their constants are repeated here): between-trial variation of the drag, a lift and a wind per trial, and
//! a model discrepancy.
//!
//! Differences from the fitted model: all trials have the same noise, whereas the model has a noise scale per trial; the bound of the
//! drag's variation is relative to the true drag, whereas the model uses the fitted one.

use std::sync::Arc;

use iplw::error::Result;
use iplw::reality::trials_from_csv;
use iplw::rng::{self, Stream};
use nalgebra::DMatrix;
use rand_distr::{Distribution, StandardNormal};

use super::{Run, SampledWorld};

#[path = "../../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

/// Parameters to estimate.
pub const PARAMETERS: [&str; 1] = ["linear_drag.c"];
/// Prior standard deviation of the drag, 1/s.
const DRAG_PRIOR_SD: f64 = 0.7;
/// Hyperpriors (mean and standard deviation of the logarithm): the drag's between-trial standard deviation relative to its prior, random
/// accelerations relative to the effects' declared sizes, model discrepancy relative to the noise.
const DRAG_SD_PRIOR: [f64; 2] = [-2.9957, 1.5];
const ACCELERATION_SD_PRIOR: [f64; 2] = [-1.2, 1.2];
const DISCREPANCY_PRIOR: [f64; 2] = [0.0, 2.0];
/// Upper bounds: the drag's standard deviation relative to the drag, its minimum relative to the prior, and the standard deviation of a
/// random acceleration.
const MAX_RELATIVE_DRAG_SD: f64 = 0.2;
const MIN_DRAG_SD: f64 = 1e-4;
const MAX_ACCELERATION_SD: f64 = 2.0;
/// Declared sizes of lift, 1/s, and wind, m/s^2.
const LIFT_SIZE: f64 = 0.2;
const WIND_SIZE: f64 = 0.1;
/// Correlation length of the discrepancy, as a share of the typical flight.
const DISCREPANCY_LENGTH: f64 = 0.25;
/// Observations per flight.
const OBSERVATIONS: usize = 25;

/// A world with recordings of throws.
pub fn sample_world(run: &Run, seed: u64) -> Result<SampledWorld> {
    let mut r = rng::stream(seed, "truth");
    let drag = DRAG_PRIOR_SD * normal(&mut r).abs();
    let spread = DRAG_PRIOR_SD
        * truncated_lognormal(
            DRAG_SD_PRIOR,
            (MAX_RELATIVE_DRAG_SD * drag / DRAG_PRIOR_SD).max(MIN_DRAG_SD),
            &mut r,
        );
    let pushes: [f64; 3] = [LIFT_SIZE, WIND_SIZE, WIND_SIZE]
        .map(|declared| declared * truncated_lognormal(ACCELERATION_SD_PRIOR, MAX_ACCELERATION_SD, &mut r));
    let slow = run.noise * truncated_lognormal(DISCREPANCY_PRIOR, f64::INFINITY, &mut r);
    let launches = worlds::launches(run.trials, seed);
    let mut durations: Vec<f64> = launches.iter().map(|l| l.1).collect();
    durations.sort_by(f64::total_cmp);
    let length = DISCREPANCY_LENGTH * durations[durations.len() / 2];
    let mut csv = String::from("trial,t,body,x,y\n");
    for (i, (start, duration)) in launches.into_iter().enumerate() {
        let c = (drag + spread * normal(&mut r)).max(0.0);
        let [lift, wx, wy] = pushes.map(|sd| sd * normal(&mut r));
        let force: worlds::Force =
            Arc::new(move |_, [_, _, vx, vy]| [wx - c * vx - lift * vy, wy - c * vy + lift * vx]);
        let path = worlds::flight(start, duration, OBSERVATIONS, &force);
        let times: Vec<f64> = path.iter().map(|(t, _)| *t).collect();
        let [off_x, off_y] = [(); 2].map(|()| discrepancy_path(&times, length, &mut r));
        for (k, (t, at)) in path.iter().enumerate() {
            let mut seen = |at: f64, off: f64| at + slow * off + run.noise * normal(&mut r);
            csv += &format!("{i},{t},ball,{},{}\n", seen(at[0], off_x[k]), seen(at[1], off_y[k]));
        }
    }
    let scene = worlds::scene();
    let trials = trials_from_csv(&csv, &scene)?;
    Ok(SampledWorld { scene, trials, set: vec!["linear_drag".into()], truth: vec![drag] })
}

fn normal(r: &mut Stream) -> f64 {
    StandardNormal.sample(r)
}

/// Draws from a log-normal distribution truncated above.
fn truncated_lognormal([centre, sd]: [f64; 2], most: f64, r: &mut Stream) -> f64 {
    loop {
        let value = libm::exp(centre + sd * normal(r));
        if value <= most {
            return value;
        }
    }
}

/// Sample path of a Gaussian process with unit variance (Matern 3/2 kernel).
fn discrepancy_path(times: &[f64], length: f64, r: &mut Stream) -> Vec<f64> {
    let n = times.len();
    let kernel = DMatrix::from_fn(n, n, |i, j| {
        let d = f64::sqrt(3.0) * (times[i] - times[j]).abs() / length;
        (1.0 + d) * libm::exp(-d) + if i == j { 1e-9 } else { 0.0 }
    });
    let root = kernel.cholesky().expect("a kernel with a ridge is positive").l();
    let z = DMatrix::from_fn(n, 1, |_, _| normal(r));
    (root * z).as_slice().to_vec()
}
