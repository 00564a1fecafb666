//! Segments of all bodies of a trial whose initial state is known: its beginning, one-step segments between
//! fully observed states, and multi-step segments with estimated initial states.

use super::definition::{Observation, Segment, SegmentKind, observed_position};
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};

/// Intervals of a multi-step segment: 8 coordinates per body against 5 nuisances.
const MULTI_STEP_INTERVALS: usize = 3;
/// Maximum number of multi-step segments per trial.
const MAX_MULTI_STEP_SEGMENTS: usize = 6;
/// Minimum displacement in a segment, m; less counts as rest.
const MIN_MOVEMENT: f64 = 0.1;

/// The beginning of a trial, up to `most` intervals.
pub fn initial_segment(trial: &Trial, most: usize) -> Option<Segment> {
    let mut scene = Scene { stop: Some(false), ..trial.scene.clone() };
    let observed = &trial.observed;
    let start = *observed.times.first()?;
    let rows = 1..observed.times.len().min(most + 1);
    let points = observations(observed, start, rows);
    let last = points.last()?.time;
    let every = scene.observe_every.max(1);
    let on_grid = points.iter().all(|p| {
        let steps = p.time / (scene.time_step * f64::from(every));
        (steps - steps.round()).abs() < 1e-6 || (p.time - last).abs() < 1e-9
    });
    if !on_grid {
        scene.observe_every = 1;
    }
    scene.steps = (last / scene.time_step).round().max(1.0) as u32 + u32::from(!on_grid);
    Some(Segment::new(SegmentKind::FromInitialState, scene, start, points))
}

/// One-step segments: at most `most` intervals with movement, evenly spaced; none unless every state is fully
/// observed.
pub fn one_step_segments(trial: &Trial, most: usize) -> Vec<Segment> {
    let observed = &trial.observed;
    let whole = |i: usize| {
        let known = |b: &Track| [b.vx[i], b.vy[i], b.omega[i], b.angle[i]].iter().all(|v| v.is_finite());
        observed.bodies.iter().all(|b| observed_position(b, i).is_some() && known(b))
    };
    let last = observed.times.len().saturating_sub(1);
    if !(0..=last).all(whole) {
        return Vec::new();
    }
    let leap = |from: usize| {
        let (start, time) = (observed.times[from], observed.times[from + 1] - observed.times[from]);
        let mut scene = free_running(&trial.scene);
        for (body, track) in scene.bodies.iter_mut().zip(&observed.bodies) {
            body.position = Some([track.x[from], track.y[from]]);
            body.angle = track.angle[from];
            body.velocity = [track.vx[from], track.vy[from]];
            body.angular_velocity = track.omega[from];
        }
        let steps = time / scene.time_step;
        scene.steps = (steps - 1e-6).ceil().max(1.0) as u32;
        scene.observe_every = if (steps - steps.round()).abs() < 1e-6 { scene.steps } else { 1 };
        let points = observations(observed, start, from + 1..from + 2);
        Segment { contacts_established: from > 0, ..Segment::new(SegmentKind::OneStep, scene, start, points) }
    };
    evenly_spaced((0..last).filter(|i| has_movement(observed, *i, 1)).collect(), most).map(leap).collect()
}

/// Multi-step segments with movement, evenly spaced.
pub fn multi_step_segments(trial: &Trial) -> Vec<Segment> {
    let observed = &trial.observed;
    let whole = |i: usize| observed.bodies.iter().all(|b| observed_position(b, i).is_some());
    let shot = |from: usize| {
        let start = observed.times[from];
        let mut scene = free_running(&trial.scene);
        let time = observed.times[from + MULTI_STEP_INTERVALS] - start;
        let gap = time / MULTI_STEP_INTERVALS as f64 / scene.time_step;
        let even = (1..=MULTI_STEP_INTERVALS).all(|k| {
            let steps = (observed.times[from + k] - start) / scene.time_step;
            (steps - gap * k as f64).abs() < 1e-6
        });
        scene.observe_every = if even && (gap - gap.round()).abs() < 1e-6 { gap.round() as u32 } else { 1 };
        scene.steps = (time / scene.time_step - 1e-6).ceil() as u32;
        for (body, track) in scene.bodies.iter_mut().zip(&observed.bodies) {
            body.angle = if track.angle[from].is_finite() { track.angle[from] } else { 0.0 };
        }
        let of = |track| initial_state_guess(track, &observed.times, from, scene.gravity, 0);
        let nuisances = observed.bodies.iter().flat_map(of).collect();
        let points = observations(observed, start, from..from + MULTI_STEP_INTERVALS + 1);
        Segment { nuisances, ..Segment::new(SegmentKind::MultiStep, scene, start, points) }
    };
    let last = observed.times.len().saturating_sub(MULTI_STEP_INTERVALS);
    let tells = |i: &usize| {
        (*i..=i + MULTI_STEP_INTERVALS).all(whole) && has_movement(observed, *i, MULTI_STEP_INTERVALS)
    };
    evenly_spaced((1..last).step_by(MULTI_STEP_INTERVALS).filter(tells).collect(), MAX_MULTI_STEP_SEGMENTS)
        .map(shot)
        .collect()
}

/// Removes multi-step segments that overlap with the initial segment of their trial.
pub fn remove_overlaps(segments: &mut Vec<Segment>) {
    let end = |w: &Segment| w.start + w.observations.last().map_or(0.0, |p| p.time);
    let runs: Vec<(usize, f64)> = segments
        .iter()
        .filter(|w| w.kind == SegmentKind::FromInitialState)
        .map(|w| (w.trial, end(w)))
        .collect();
    let is_covered =
        |w: &Segment| runs.iter().any(|(trial, until)| *trial == w.trial && w.start < until - 1e-9);
    segments.retain(|w| w.kind != SegmentKind::MultiStep || !is_covered(w));
}

/// Initial guess of a body's position, velocity and spin at an observation by finite differences: forward
/// with gravity (0), forward without gravity (1), backward with gravity (2).
pub fn initial_state_guess(
    track: &Track,
    times: &[f64],
    at: usize,
    gravity: [f64; 2],
    way: usize,
) -> [f64; 5] {
    let (i, j) = if way == 2 && at > 0 { (at - 1, at) } else { (at, at + 1) };
    let dt = times[j] - times[i];
    let pull = [-0.5, 0.0, 0.5][way] * dt;
    let known = |v: f64| if v.is_finite() { v } else { 0.0 };
    [
        track.x[at],
        track.y[at],
        known((track.x[j] - track.x[i]) / dt + pull * gravity[0]),
        known((track.y[j] - track.y[i]) / dt + pull * gravity[1]),
        known((track.angle[j] - track.angle[i]) / dt),
    ]
}

/// A scene without stop condition, goal and action.
fn free_running(scene: &Scene) -> Scene {
    Scene { stop: Some(false), goal: None, action: None, ..scene.clone() }
}

/// Observed positions of all bodies at a range of times.
fn observations(observed: &Trajectory, start: f64, rows: std::ops::Range<usize>) -> Vec<Observation> {
    let point = |i: usize, (body, track): (usize, &Track)| {
        Some(Observation {
            body,
            time: observed.times[i] - start,
            position: observed_position(track, i)?,
            weight: 1.0,
        })
    };
    rows.flat_map(|i| observed.bodies.iter().enumerate().filter_map(move |b| point(i, b))).collect()
}

/// Whether any body moves between an observation and the one `by` later.
fn has_movement(observed: &Trajectory, from: usize, by: usize) -> bool {
    let moved = |b: &Track| (b.x[from + by] - b.x[from]).hypot(b.y[from + by] - b.y[from]) > MIN_MOVEMENT;
    observed.bodies.iter().any(moved)
}

/// At most `most` of them, evenly spaced.
fn evenly_spaced(of: Vec<usize>, most: usize) -> impl Iterator<Item = usize> {
    let stride = of.len().div_ceil(most).max(1);
    of.into_iter().step_by(stride)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Engine, Rollout, Simulator};

    /// A simulated trial of a falling and a resting ball, observed every 0.1 s.
    fn trial() -> Trial {
        let scene = Scene::from_json(
            r#"{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 100, "observe_every": 10,
                "bodies": [{"name": "falls", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 9]},
                           {"name": "rests", "shape": {"type": "disc", "radius": 0.1}, "position": [3, 0.1]}],
                "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}"#,
        )
        .unwrap();
        let usual = Rollout { stop_at_goal: false, ..Rollout::of(&scene) };
        let observed = Simulator::new(Engine::Lanes).run(&[usual]).unwrap().remove(0);
        Trial { name: String::new(), setting: None, scene, observed }
    }

    /// A rollout of a segment's scene reproduces its observations.
    #[test]
    fn segments_reproduce_their_observations() {
        let trial = trial();
        let leaps = one_step_segments(&trial, 3);
        assert_eq!(leaps.len(), 3, "no more than asked for");
        for w in leaps.into_iter().chain(initial_segment(&trial, 8)) {
            let usual = Default::default();
            let path = Simulator::new(Engine::Lanes).run(&[w.rollout(&w.scene, &usual)]).unwrap().remove(0);
            for p in &w.observations {
                let i = path.times.iter().position(|t| (t - p.time).abs() < 1e-9).expect("an observation");
                let track = &path.bodies[p.body];
                let off = (track.x[i] - p.position[0]).hypot(track.y[i] - p.position[1]);
                assert!(off < 1e-3, "{:?} {off}", w.kind);
            }
        }
    }

    #[test]
    fn segments_need_full_states_and_movement() {
        let mut trial = trial();
        let all = multi_step_segments(&trial);
        assert_eq!(all.len(), 3, "from the second observation on, three intervals each");
        assert!(
            all.iter()
                .all(|w| w.observations.len() == 2 * (MULTI_STEP_INTERVALS + 1) && w.nuisances.len() == 10)
        );
        trial.observed.bodies[1].omega[4] = f64::NAN;
        assert!(one_step_segments(&trial, 100).is_empty());
        trial.observed.bodies[0].x[5] = f64::NAN;
        assert_eq!(multi_step_segments(&trial).len(), 2, "the second holds the fifth");
        let mut still = self::trial();
        still.observed.bodies[0] = still.observed.bodies[1].clone();
        assert!(multi_step_segments(&still).is_empty() && one_step_segments(&still, 100).is_empty());
    }

    /// Multi-step segments begin where the initial segment ends.
    #[test]
    fn multi_step_segments_follow_the_initial_segment() {
        let trial = trial();
        let run = initial_segment(&trial, 8).unwrap();
        let end = run.observations.last().unwrap().time;
        assert!((end - 0.8).abs() < 1e-9, "{end}");
        let mut segments: Vec<Segment> = multi_step_segments(&trial).into_iter().chain([run]).collect();
        assert_eq!(segments.len(), 4);
        remove_overlaps(&mut segments);
        assert!(
            segments.iter().all(|w| w.kind == SegmentKind::FromInitialState),
            "the last shot begins at 0.7 s"
        );
        segments.extend(multi_step_segments(&trial));
        let run = segments.iter_mut().find(|w| w.kind == SegmentKind::FromInitialState).unwrap();
        run.observations.retain(|p| p.time < 0.45);
        remove_overlaps(&mut segments);
        let shots: Vec<f64> =
            segments.iter().filter(|w| w.kind == SegmentKind::MultiStep).map(|w| w.start).collect();
        assert_eq!(shots.len(), 2, "{shots:?}");
    }

    /// In free flight the forward and backward guesses equal the true velocity and spin.
    #[test]
    fn initial_guesses_match_free_flight() {
        let times: Vec<f64> = (0..4).map(|i| 0.1 * f64::from(i)).collect();
        let of = |f: &dyn Fn(f64) -> f64| times.iter().map(|t| f(*t)).collect();
        let track = Track {
            x: of(&|t| 2.0 * t),
            y: of(&|t| 3.0 * t - 4.9 * t * t),
            angle: of(&|t| 7.0 * t),
            ..Track::default()
        };
        for way in [0, 2] {
            let [x, y, vx, vy, spin] = initial_state_guess(&track, &times, 1, [0.0, -9.8], way);
            let off = [x - 0.2, y - 0.251, vx - 2.0, vy - 2.02, spin - 7.0];
            assert!(off.iter().all(|o| o.abs() < 1e-9), "{off:?}");
        }
    }
}
