//! What of the windows can be trusted: runs as long as they can be foreseen, flights without outliers.

use super::model::{self, Data, Layout, State};
use super::noise;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::trajectory::Track;
use crate::world::{Engine, Rollout, simulate};

/// Growth of a start's error beyond which a run is no longer trusted.
const GROWTH: f64 = 100.0;

/// Ends runs where the start's smallest error would show.
pub fn shorten(windows: &mut [Window], engine: Engine) -> Result<()> {
    for window in windows.iter_mut().filter(|w| w.kind == Kind::Run) {
        let mut scenes = vec![window.scene.clone()];
        for body in 0..window.scene.bodies.len() {
            let mut moved = window.scene.clone();
            if let Some(p) = &mut moved.bodies[body].position {
                p[0] += 1e-7;
            }
            scenes.push(moved);
        }
        let rollouts: Vec<Rollout> = scenes
            .iter()
            .map(|scene| Rollout { scene, latents: Default::default(), effects: &[], stop: false })
            .collect();
        let paths = simulate(&rollouts, engine)?;
        let off = |a: &Track, b: &Track, i: usize| (a.x[i] - b.x[i]).hypot(a.y[i] - b.y[i]);
        let times = &paths[0].times;
        let until = (0..times.len())
            .find(|i| {
                paths[1..].iter().any(|p| {
                    p.bodies
                        .iter()
                        .zip(&paths[0].bodies)
                        .any(|(a, b)| *i < a.len() && off(a, b, *i) > GROWTH * 1e-7)
                })
            })
            .map_or(f64::INFINITY, |i| times[i]);
        let least = window.points.get(window.scene.bodies.len()).map_or(0.0, |p| p.time);
        window.points.retain(|p| p.time < until.max(least + 1e-9));
        let last = window.points.last().map_or(0.0, |p| p.time);
        let steps =
            (last / window.scene.time_step).round() as u32 + u32::from(window.scene.observe_every == 1);
        window.scene.steps = steps.clamp(1, window.scene.steps);
    }
    Ok(())
}

/// Takes outliers at the ends of flights out, by what nothing but gravity leaves.
pub fn weed(windows: &mut [Window], sd: &[f64], settings: &[usize], engine: Engine) -> Result<()> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let own: Vec<Window> = flights.iter().map(|w| windows[*w].clone()).collect();
    let data = Data::new(&own, settings, flights.iter().map(|w| sd[*w]).collect(), engine);
    let layout = Layout::new(&[], Vec::new(), 1);
    let start = State { values: Vec::new(), nuisances: own.iter().map(|w| w.nuisances.clone()).collect() };
    let (_, left) = model::fit(&data, &layout, start, 3)?;
    for (k, w) in flights.into_iter().enumerate() {
        let times: Vec<f64> = own[k].points.iter().map(|p| p.time).collect();
        for i in noise::spikes(&times, &left.residuals[k], sd[w]) {
            windows[w].points[i].weight = 0.0;
        }
    }
    Ok(())
}
