//! For tests: balls thrown through air that drags by c v, each launch by a c of its own, and a model fitted to them.

use super::fit::{Fitted, Fitter};
use super::fixture::term;
use super::model::{Data, Layout, State};
use super::noise::Noise;
use super::report::Verdict;
use super::selection::Decision;
use super::window::{self, Window};
use crate::progress::NoProgress;
use crate::reality::trials_from_csv;
use crate::rng;
use crate::task::ball::BallScene;
use crate::world::Engine;
use rand_distr::{Distribution, StandardNormal};

/// Gravity, m/s^2; observations of a launch and what lies between two, s; their noise, m.
const GRAVITY: f64 = 9.81;
const OBSERVED: usize = 30;
const INTERVAL: f64 = 0.03;
pub const NOISE: f64 = 0.002;

/// Windows of launches, one for each drag (1/s, not 0).
pub fn windows(drags: &[f64], seed: u64) -> Vec<Window> {
    let scene = BallScene { radius: 0.05, mass: None, gravity: Some(GRAVITY), floor: None }
        .build("ball", 1.0)
        .unwrap();
    let mut stream = rng::stream(seed, "thrown");
    let mut noise =
        || -> f64 { NOISE * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut stream) };
    let mut csv = String::from("trial,t,body,x,y\n");
    for (trial, c) in drags.iter().enumerate() {
        let [vx, vy] = [4.0 + 0.7 * trial as f64, 5.0 - 0.4 * trial as f64];
        for i in 0..OBSERVED {
            let t = INTERVAL * i as f64;
            let gone = (1.0 - libm::exp(-c * t)) / c;
            let x = vx * gone + noise();
            let y = 1.0 + (vy + GRAVITY / c) * gone - GRAVITY / c * t + noise();
            csv += &format!("{trial},{t},ball,{x},{y}\n");
        }
    }
    window::cut(&scene, &trials_from_csv(&csv, &scene).unwrap(), &vec![0; drags.len()], 8, &NoProgress)
        .unwrap()
}

/// A set of effects fitted to such launches, and what is made of it.
pub fn fitted<T>(drags: &[f64], set: &[&str], seed: u64, of: impl FnOnce(&Fitter, &Fitted) -> T) -> T {
    let windows = windows(drags, seed);
    let settings = vec![0; drags.len()];
    let data = Data::new(&windows, &settings, vec![NOISE; windows.len()], Engine::Auto);
    let fitter = Fitter::new(&data, &Noise { sd: NOISE, rho: 0.0, freedom: 1e3 });
    let layout = Layout::new(&[], set.iter().map(|name| term(name)).collect(), 1);
    let values = layout.start(&[0.0; 3]);
    let state = State::new(values, windows.iter().map(|w| w.nuisances.clone()).collect());
    of(&fitter, &fitter.fit(layout, state, 12).unwrap().unwrap())
}

/// A decision that takes no more than a model that stands alone.
pub fn decision(verdict: Verdict) -> Decision {
    Decision {
        verdict,
        champion: None,
        rivals: Vec::new(),
        probabilities: Vec::new(),
        base_probability: 1.0,
        explained: None,
        gain: None,
        field: None,
        unnamed: None,
    }
}

#[test]
fn a_drag_that_all_launches_have_is_found() {
    fitted(&[0.4; 8], &["linear_drag"], 1, |_, f| {
        assert!((f.state.values[0] - 0.4).abs() < 0.02, "{:?}", f.state.values);
        assert!(
            f.half_width(0) < 0.03 && f.spread(0).is_none_or(|s| s < 0.05),
            "{} {:?}",
            f.half_width(0),
            f.spread(0)
        );
    });
}
