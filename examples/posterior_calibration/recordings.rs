//! Recordings of a ball that is thrown through air with a linear drag: the drag is drawn from the prior, and so is all that launches may
//! differ by, as `discover::components` believes it (its constants are written down here once more): the drag's spread, a lift and a wind of
//! each launch's own, a slow misfit.
//!
//! Differences from the model that is asked: all launches have the same noise, where the model lets each have a scale of its own;
//! the most that the drag differs by goes by the drag that is there, where the model goes by the one that it fits.

use std::sync::Arc;

use iplw::error::Result;
use iplw::reality::trials_from_csv;
use iplw::rng::{self, Stream};
use nalgebra::DMatrix;
use rand_distr::{Distribution, StandardNormal};

use super::{Drawn, Run};

#[path = "../../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

/// What is asked for.
pub const ASKED: [&str; 1] = ["linear_drag.c"];
/// What is plausible of it, 1/s.
const PLAUSIBLE: f64 = 0.7;
/// Centre and standard deviation of logarithms: the drag's spread as a share of what is plausible, pushes as a share of what effects declare, slow misfit
/// in units of the noise.
const SPREAD: [f64; 2] = [-2.9957, 1.5];
const PUSH: [f64; 2] = [-1.2, 1.2];
const SLOW: [f64; 2] = [0.0, 2.0];
/// Most spread as a share of the drag, the least that this is as a share of what is plausible, and most of a push's deviation.
const MOST_SPREAD: f64 = 0.2;
const LEAST: f64 = 1e-4;
const MOST_PUSH: f64 = 2.0;
/// Lift, 1/s, and wind, m/s^2, as effects declare them.
const LIFT: f64 = 0.2;
const WIND: f64 = 0.1;
/// Length over which slow misfit changes, as a share of the usual flight.
const SLOW_LENGTH: f64 = 0.25;
/// Observations of a flight.
const ROWS: usize = 25;

/// A world and throws in it.
pub fn drawn(run: &Run, seed: u64) -> Result<Drawn> {
    let mut r = rng::stream(seed, "truth");
    let drag = PLAUSIBLE * normal(&mut r).abs();
    let spread = PLAUSIBLE * below(SPREAD, (MOST_SPREAD * drag / PLAUSIBLE).max(LEAST), &mut r);
    let pushes: [f64; 3] = [LIFT, WIND, WIND].map(|declared| declared * below(PUSH, MOST_PUSH, &mut r));
    let slow = run.noise * below(SLOW, f64::INFINITY, &mut r);
    let launches = worlds::launches(run.trials, seed);
    let mut durations: Vec<f64> = launches.iter().map(|l| l.1).collect();
    durations.sort_by(f64::total_cmp);
    let length = SLOW_LENGTH * durations[durations.len() / 2];
    let mut csv = String::from("trial,t,body,x,y\n");
    for (i, (start, duration)) in launches.into_iter().enumerate() {
        let c = (drag + spread * normal(&mut r)).max(0.0);
        let [lift, wx, wy] = pushes.map(|sd| sd * normal(&mut r));
        let force: worlds::Force =
            Arc::new(move |_, [_, _, vx, vy]| [wx - c * vx - lift * vy, wy - c * vy + lift * vx]);
        let path = worlds::flight(start, duration, ROWS, &force);
        let times: Vec<f64> = path.iter().map(|(t, _)| *t).collect();
        let [off_x, off_y] = [(); 2].map(|()| misfit(&times, length, &mut r));
        for (k, (t, at)) in path.iter().enumerate() {
            let mut seen = |at: f64, off: f64| at + slow * off + run.noise * normal(&mut r);
            csv += &format!("{i},{t},ball,{},{}\n", seen(at[0], off_x[k]), seen(at[1], off_y[k]));
        }
    }
    let scene = worlds::scene();
    let trials = trials_from_csv(&csv, &scene)?;
    Ok(Drawn { scene, trials, set: vec!["linear_drag".into()], truth: vec![drag] })
}

fn normal(r: &mut Stream) -> f64 {
    StandardNormal.sample(r)
}

/// Of a logarithm's centre and deviation, below a bound.
fn below([centre, sd]: [f64; 2], most: f64, r: &mut Stream) -> f64 {
    loop {
        let drawn = libm::exp(centre + sd * normal(r));
        if drawn <= most {
            return drawn;
        }
    }
}

/// A path of a Gaussian process of unit variance (Matern 3/2).
fn misfit(times: &[f64], length: f64, r: &mut Stream) -> Vec<f64> {
    let n = times.len();
    let kernel = DMatrix::from_fn(n, n, |i, j| {
        let d = f64::sqrt(3.0) * (times[i] - times[j]).abs() / length;
        (1.0 + d) * libm::exp(-d) + if i == j { 1e-9 } else { 0.0 }
    });
    let root = kernel.cholesky().expect("a kernel with a ridge is positive").l();
    let z = DMatrix::from_fn(n, 1, |_, _| normal(r));
    (root * z).as_slice().to_vec()
}
