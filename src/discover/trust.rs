//! What of the windows can be trusted: runs as long as they can be foreseen, flights without outliers.

use super::model::{self, Data, Layout, State};
use super::smooth::spikes;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::task::Scene;
use crate::world::{Engine, Rollout, Simulator};

/// A start's smallest error, m, and its growth beyond which a run is no longer trusted.
const SMALLEST: f64 = 1e-7;
const GROWTH: f64 = 100.0;

/// Ends runs where the start's smallest error would show.
pub fn shorten(windows: &mut [Window], engine: Engine) -> Result<()> {
    for window in windows.iter_mut().filter(|w| w.kind == Kind::Run) {
        let until = foreseen(&window.scene, engine)?;
        let least = window.points.get(window.scene.bodies.len()).map_or(0.0, |p| p.time);
        window.points.retain(|p| p.time < until.max(least + 1e-9));
        let last = window.points.last().map_or(0.0, |p| p.time);
        let steps =
            (last / window.scene.time_step).round() as u32 + u32::from(window.scene.observe_every == 1);
        window.scene.steps = steps.clamp(1, window.scene.steps);
    }
    Ok(())
}

/// The time from which a scene goes elsewhere if one of its bodies starts elsewhere by next to nothing, s.
fn foreseen(scene: &Scene, engine: Engine) -> Result<f64> {
    let mut scenes = vec![scene.clone(); 1 + scene.bodies.len()];
    for body in 0..scene.bodies.len() {
        if let Some(p) = &mut scenes[1 + body].bodies[body].position {
            p[0] += SMALLEST;
        }
    }
    let usual = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let paths = Simulator::new(engine).run(&scenes.iter().map(usual).collect::<Vec<_>>())?;
    let (own, moved) = (&paths[0], &paths[1..]);
    let pairs = || moved.iter().flat_map(|p| p.bodies.iter().zip(&own.bodies));
    let parted = |i: &usize| {
        pairs().any(|(a, b)| *i < a.len() && (a.x[*i] - b.x[*i]).hypot(a.y[*i] - b.y[*i]) > GROWTH * SMALLEST)
    };
    Ok((0..own.times.len()).find(parted).map_or(f64::INFINITY, |i| own.times[i]))
}

/// Takes outliers at the ends of flights out, by what nothing but gravity leaves.
pub fn weed(windows: &mut [Window], sd: &[f64], settings: &[usize], engine: Engine) -> Result<()> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let own: Vec<Window> = flights.iter().map(|w| windows[*w].clone()).collect();
    let data = Data::new(&own, settings, flights.iter().map(|w| sd[*w]).collect(), engine);
    let layout = Layout::new(&[], Vec::new(), 1);
    let start = State::new(Vec::new(), own.iter().map(|w| w.nuisances.clone()).collect());
    let (_, left) = model::fit(&data, &layout, start, 3)?;
    for (k, w) in flights.into_iter().enumerate() {
        let times: Vec<f64> = own[k].points.iter().map(|p| p.time).collect();
        for i in spikes(&times, &left.residuals[k], sd[w]) {
            windows[w].points[i].weight = 0.0;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::flights;

    /// On a floor a ball stays as far off as it starts; off another ball's top it goes where the start's error sends it.
    #[test]
    fn a_bounce_off_a_ball_cannot_be_foreseen() {
        let until = |fixed: &str| {
            let scene = Scene::from_json(&format!(
                r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 300, "observe_every": 10,
                    "bodies": [{{"name": "ball", "shape": {{"type": "disc", "radius": 0.1}}, "position": [0, 3],
                                "restitution": 1}}],
                    "statics": [{{"name": "below", "restitution": 1, {fixed}}}]}}"#
            ));
            foreseen(&scene.unwrap(), Engine::Lanes).unwrap()
        };
        assert_eq!(until(r#""shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}"#), f64::INFINITY);
        let met = until(r#""shape": {"type": "disc", "radius": 0.1}, "position": [0, 0]"#);
        assert!((0.8..2.5).contains(&met), "{met} s: it meets the other after 0.76 s");
    }

    #[test]
    fn one_point_off_at_the_end_is_weeded_out_alone() {
        let (mut windows, settings) = flights([0.0, 0.0], 2);
        windows[1].points[19].seen[1] += 0.02;
        weed(&mut windows, &[1e-3; 2], &settings, Engine::Auto).unwrap();
        let out = |w: &Window| (0..20).filter(|i| w.points[*i].weight == 0.0).collect::<Vec<_>>();
        assert_eq!((out(&windows[0]), out(&windows[1])), (vec![], vec![19]));
    }
}
