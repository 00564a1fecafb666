//! Validation of a client's measurements.

use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::serve::wire::TrialIn;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};

/// Validates a measured trial and completes it with a track for every body of the scene.
pub fn trajectory(trial: TrialIn, scene: &Scene, field: &str) -> Result<Trajectory> {
    let n = trial.t.len();
    for (i, t) in trial.t.iter().enumerate() {
        let least = if i == 0 { 0.0 } else { trial.t[i - 1] };
        if !(t.is_finite() && *t <= MAX_MAGNITUDE && (if i == 0 { *t >= 0.0 } else { *t > least })) {
            let allowed = if i == 0 {
                "a time from 0 s".into()
            } else {
                format!("a time after {least} s, up to {MAX_MAGNITUDE}")
            };
            return Err(Error::input(format!("{field}.t[{i}]"), t, allowed));
        }
    }
    for name in trial.bodies.keys() {
        if !scene.bodies.iter().any(|b| b.name == *name) {
            let known: Vec<String> = scene.bodies.iter().map(|b| format!("{:?}", b.name)).collect();
            let allowed = format!("a body of the scene: {}", known.join(", "));
            return Err(Error::input(format!("{field}.bodies.{name}"), "unknown", allowed));
        }
    }
    let mut bodies = trial.bodies;
    let mut tracks = Vec::new();
    for body in &scene.bodies {
        let mut track = Track { name: body.name.clone(), ..Track::default() };
        let given = bodies.remove(&body.name).map(|JsonObject(t)| t).unwrap_or_default();
        let columns = [
            ("x", given.x, &mut track.x),
            ("y", given.y, &mut track.y),
            ("angle", given.angle, &mut track.angle),
            ("vx", given.vx, &mut track.vx),
            ("vy", given.vy, &mut track.vy),
            ("omega", given.omega, &mut track.omega),
        ];
        for (name, values, column) in columns {
            let at = format!("{field}.bodies.{}.{name}", body.name);
            let Some(values) = values else {
                *column = vec![f64::NAN; n];
                continue;
            };
            if values.len() != n {
                return Err(Error::input(
                    at,
                    format!("{} values", values.len()),
                    format!("{n}, one per time in t"),
                ));
            }
            for (i, value) in values.iter().enumerate() {
                if value.is_some_and(|v| !v.is_finite() || v.abs() > MAX_MAGNITUDE) {
                    let allowed = format!("a number from -{MAX_MAGNITUDE} to {MAX_MAGNITUDE}, or null");
                    return Err(Error::input(format!("{at}[{i}]"), value.unwrap_or_default(), allowed));
                }
            }
            *column = values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
        }
        tracks.push(track);
    }
    let observed = Trajectory { times: trial.t, bodies: tracks, ..Trajectory::default() };
    check_usable(&observed, &format!("{field}.t"))?;
    Ok(observed)
}

/// Maximum magnitude of a time, position, angle or speed, SI units.
const MAX_MAGNITUDE: f64 = 1e6;
/// Latest time of the first observation, s.
const MAX_FIRST_OBSERVATION_S: f64 = 0.1;

/// Fails unless there are observations, starting near time 0.
pub fn check_usable(observed: &Trajectory, field: &str) -> Result<()> {
    let allowed = format!("times since the start, the first from 0 to {MAX_FIRST_OBSERVATION_S} s");
    match observed.times.first() {
        None => return Err(Error::input(field, "empty", allowed)),
        Some(first) if !(0.0..=MAX_FIRST_OBSERVATION_S).contains(first) => {
            return Err(Error::input(field, first, allowed));
        }
        Some(_) => {}
    }
    if crate::residual::count_observations(observed) == 0 {
        let field = field.trim_end_matches('t').trim_end_matches([' ', ':', '.']);
        return Err(Error::input(field, "without any position", "x and y of a body at one or more times"));
    }
    Ok(())
}

/// Observation times of a simulation, s: the start, every `observe_every` steps, and the end.
pub fn observe_at(scene: &Scene) -> Vec<f64> {
    let every = scene.observe_every.max(1);
    let mut steps: Vec<u32> = (0..=scene.steps / every).map(|k| k * every).collect();
    if !scene.steps.is_multiple_of(every) {
        steps.push(scene.steps);
    }
    steps.into_iter().map(|k| f64::from(k) * scene.time_step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn observation_times_are_those_of_a_rollout() {
        let tasks = crate::session::Catalogue::new().family("bowling").unwrap();
        let task = &tasks.tasks[0];
        let times = observe_at(&task.scene);
        assert_eq!((times.len(), times[0], times[1]), (68, 0.0, 60.0 * task.scene.time_step));
        assert_eq!(times[67], f64::from(task.scene.steps) * task.scene.time_step);
        let even = Scene { steps: 120, observe_every: 60, ..task.scene.clone() };
        assert_eq!(observe_at(&even).len(), 3);
    }
}
