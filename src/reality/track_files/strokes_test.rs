//! Tests of films of strokes: generated ones, seen from above.

use std::fmt::Write;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::load::{LoadedTrials, Subject, TrackFile, load_tracks};
use super::parse_options::TrackParseOptions;
use super::strokes::free_stretches;
use super::track_rows::TrialPoints;
use crate::budget::Unlimited;
use crate::rng;
use crate::task::ball::BallScene;

/// A film of a puck that is struck again and again.
#[derive(Clone, Copy)]
struct Film {
    fps: f64,
    /// Standard deviation of each coordinate, m.
    noise: f64,
    /// Duration of a push, pictures.
    push: f64,
    /// Deceleration by friction, m/s^2.
    deceleration: f64,
    /// Rest between a stop and the next push, s; without, the puck is struck while it moves.
    rest: f64,
    seed: u64,
}

const STROKES: usize = 8;
const FILM: Film = Film { fps: 60.0, noise: 5e-4, push: 3.0, deceleration: 1.0, rest: 0.0, seed: 0 };

impl Film {
    /// Points (t, x, y), and the times from which and to which the puck is pushed.
    fn record(&self) -> (TrialPoints, Vec<[f64; 2]>) {
        let mut random = rng::stream(self.seed, "film of strokes");
        let substeps = 50;
        let dt = 1.0 / self.fps / f64::from(substeps);
        let ([mut x, mut y], [mut vx, mut vy], [mut ax, mut ay]) = ([0.0f64; 2], [0.0f64; 2], [0.0f64; 2]);
        let (mut points, mut pushes): (Vec<[f64; 3]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
        // The film starts at rest. The phase ends at this time.
        let (mut is_pushed, mut end) = (false, 0.3 + random.random::<f64>() / self.fps);
        for step in 0.. {
            let t = f64::from(step) * dt;
            if step % substeps == 0 {
                let mut error = || self.noise * Distribution::<f64>::sample(&StandardNormal, &mut random);
                points.push([t, x + error(), y + error()]);
            }
            if t >= end && is_pushed {
                is_pushed = false;
                let slide = vx.hypot(vy) / self.deceleration;
                let share = 0.6 + 0.3 * random.random::<f64>();
                end = if self.rest > 0.0 { t + slide + self.rest * share } else { t + share * slide };
            } else if t >= end {
                if pushes.len() == STROKES {
                    break;
                }
                is_pushed = true;
                end = t + self.push / self.fps;
                pushes.push([t, end]);
                // Back to the middle of the table, more or less.
                let (speed, turn) = (0.7 + 0.7 * random.random::<f64>(), random.random::<f64>() - 0.5);
                let direction = libm::atan2(-y, -x) + turn;
                let target = [speed * libm::cos(direction), speed * libm::sin(direction)];
                (ax, ay) = ((target[0] - vx) / (end - t), (target[1] - vy) / (end - t));
            }
            if is_pushed {
                (vx, vy) = (vx + ax * dt, vy + ay * dt);
            } else {
                let kept = (1.0 - self.deceleration * dt / vx.hypot(vy).max(1e-12)).max(0.0);
                (vx, vy) = (vx * kept, vy * kept);
            }
            (x, y) = (x + vx * dt, y + vy * dt);
        }
        (TrialPoints { trial: "film".into(), points }, pushes)
    }

    /// Checks that each push is followed by one stretch, and is in none of them but for a picture or two.
    fn check(&self) {
        let (film, pushes) = self.record();
        let stretches = free_stretches(&film, &Unlimited).unwrap();
        let name = format!(
            "{} fps, noise {}, push {}, rest {}, seed {}",
            self.fps, self.noise, self.push, self.rest, self.seed
        );
        assert_eq!(stretches.len(), STROKES, "{name}: {stretches:?} {pushes:?}");
        // A push that begins within the noise.
        let tolerance = 3.5 / self.fps;
        for (k, (stretch, push)) in stretches.iter().zip(&pushes).enumerate() {
            let late = stretch.start - push[1];
            assert!((-tolerance..0.1).contains(&late), "{name}, part {k}: {late}");
            if let Some(next) = pushes.get(k + 1) {
                assert!(stretch.end < next[0] + tolerance, "{name}, part {k}: {stretch:?} {next:?}");
            }
        }
    }
}

#[test]
fn cuts_films_of_a_sliding_puck() {
    for fps in [30.0, 60.0, 120.0, 240.0] {
        for noise in [3e-4, 1e-3] {
            for push in [1.0, 3.0, 5.0] {
                (0..2).for_each(|seed| Film { fps, noise, push, seed, ..FILM }.check());
            }
        }
    }
}

/// A puck that rests between strokes: the rest is left out, but for a few points.
#[test]
fn cuts_films_with_rests() {
    for fps in [30.0, 120.0] {
        for seed in 0..3 {
            let film = Film { fps, rest: 1.0, seed, ..FILM };
            film.check();
            let (points, _) = film.record();
            for stretch in free_stretches(&points, &Unlimited).unwrap() {
                let last = points.points.iter().rfind(|p| stretch.contains(&p[0])).unwrap();
                let rests = points.points.iter().filter(|p| stretch.contains(&p[0]));
                let rests = rests.filter(|p| (p[1] - last[1]).hypot(p[2] - last[2]) < 2e-3).count();
                assert!(rests < fps as usize / 5 + 4, "{rests} points at rest");
            }
        }
    }
}

/// Tracks in whole pixels, of a puck that rests for longer than it slides.
#[test]
fn cuts_tracks_in_whole_pixels() {
    for fps in [30.0, 240.0] {
        let (mut film, pushes) = Film { fps, noise: 1e-4, rest: 3.0, ..FILM }.record();
        film.points.iter_mut().for_each(|p| [p[1], p[2]] = [p[1], p[2]].map(|v| (1e3 * v).round() / 1e3));
        assert_eq!(free_stretches(&film, &Unlimited).unwrap().len(), pushes.len(), "{fps}");
    }
}

/// Free motions without a stroke, along x: slides to rest, two decelerations one after another (sliding, then rolling), drag, and
/// paths that are bent by spin and by a lens.
#[test]
fn free_motion_stays_whole() {
    let slide = |speed: f64, deceleration: f64, t: f64| {
        let t = t.min(speed / deceleration);
        speed * t - 0.5 * deceleration * t * t
    };
    let along = |distance: f64| [distance, 0.3 * distance];
    type Path<'a> = &'a dyn Fn(f64, f64) -> [f64; 2];
    let paths: [(&str, Path); 6] = [
        ("slide", &|speed, t| along(slide(speed, 1.0, t))),
        ("short slide", &|speed, t| along(slide(2.0 * speed, 5.0, t))),
        ("rolling after sliding", &|speed, t| {
            along(slide(speed, 2.0, t.min(0.3)) + slide(speed - 0.6, 0.3, (t - 0.3).max(0.0)))
        }),
        ("drag", &|speed, t| along(speed / 2.0 * (1.0 - libm::exp(-2.0 * t)))),
        ("spin", &|speed, t| [speed / 1.5 * libm::sin(1.5 * t), speed / 1.5 * libm::cos(1.5 * t)]),
        ("bent view", &|speed, t| {
            let (x, y) = (speed * t - 1.2, 0.3);
            [x, y].map(|v| v * (1.0 - 0.1 * (x * x + y * y)))
        }),
    ];
    for (name, path) in paths {
        for fps in [30.0, 60.0, 240.0] {
            let cut = |seed: &u64| {
                let mut random = rng::stream(*seed, "free motion");
                let speed = 0.8 + random.random::<f64>();
                let noise = if seed.is_multiple_of(2) { 3e-4 } else { 1e-3 };
                let mut point = |i: usize| {
                    let mut error = || noise * Distribution::<f64>::sample(&StandardNormal, &mut random);
                    let (t, [dx, dy]) = (i as f64 / fps, [error(), error()]);
                    let [x, y] = path(speed, t);
                    [t, x + dx, y + dy]
                };
                let points = (0..(2.5 * fps) as usize).map(&mut point).collect();
                !free_stretches(&TrialPoints { trial: "free".into(), points }, &Unlimited).unwrap().is_empty()
            };
            assert_eq!((0..20).filter(cut).count(), 0, "{name}, {fps} fps");
        }
    }
}

/// A slide without noise, and points that no camera records.
#[test]
fn odd_points_are_no_strokes() {
    let films: [Vec<[f64; 3]>; 6] = [
        (0..90).map(|i| f64::from(i.min(40)) / 30.0).map(|t| [t, t - 0.375 * t * t, 0.0]).collect(),
        vec![[0.0; 3]; 50],
        (0..50).map(|i| [f64::from(i), f64::NAN, f64::INFINITY]).collect(),
        (0..50).map(|i| [f64::from(-i), f64::from(i * i % 7), 1e300]).collect(),
        vec![[0.0, 1.0, 2.0], [1.0, 3.0, -1e308]],
        Vec::new(),
    ];
    for points in films {
        let shown = format!("{:?}", points.first());
        let stretches = free_stretches(&TrialPoints { trial: "odd".into(), points }, &Unlimited).unwrap();
        assert!(stretches.is_empty(), "{shown}: {stretches:?}");
    }
}

/// Pictures in which the tracking is elsewhere are no strokes.
#[test]
fn outliers_are_no_strokes() {
    for (fps, size) in [(60, 0.1), (240, 0.1), (240, 0.01)] {
        let slide = |i: u32| {
            let t = f64::from(i) / f64::from(fps);
            let wobble = |k: u32| 5e-4 * libm::sin(f64::from(i * i * k));
            let error = if i % 41 == 17 { size } else { 0.0 };
            [t, t - 0.1 * t * t + wobble(7919), 0.2 * t + wobble(31) + error]
        };
        let film = TrialPoints { trial: "film".into(), points: (0..2 * fps).map(slide).collect() };
        let stretches = free_stretches(&film, &Unlimited).unwrap();
        assert!(stretches.is_empty(), "{fps} {size}: {stretches:?}");
    }
}

fn csv(film: &TrialPoints) -> TrackFile {
    let mut text = String::from("t,x,y\n");
    for [t, x, y] in &film.points {
        let _ = writeln!(text, "{t:.5},{x:.5},{y:.5}");
    }
    TrackFile { name: "film.csv".into(), text }
}

fn load(files: &[TrackFile], of: Subject) -> LoadedTrials {
    load_tracks(files, of, &TrackParseOptions::default(), &Unlimited).unwrap()
}

const FROM_ABOVE: BallScene = BallScene { radius: 0.03, mass: None, gravity: Some(0.0), floor: None };

/// A film from above becomes as many trials as there are strokes, with or without a scene; one with a wall stays whole.
#[test]
fn film_of_strokes_becomes_trials() {
    let (film, pushes) = FILM.record();
    let files = [csv(&film)];
    let loaded = load(&files, Subject::Ball(&FROM_ABOVE));
    let names: Vec<&str> = loaded.trials.iter().map(|t| t.name.as_str()).collect();
    assert_eq!((names.len(), names[0], names[7]), (pushes.len(), "film, part 1", "film, part 8"));
    let note = "1 film of many strokes is cut into 8 trials";
    assert!(loaded.notes.iter().any(|n| n.contains(note)), "{:?}", loaded.notes);
    for (trial, push) in loaded.trials.iter().zip(&pushes) {
        assert!((trial.observed.times[0] - push[1]).abs() < 0.06, "{} {push:?}", trial.observed.times[0]);
    }
    let mut scene = loaded.scene;
    assert_eq!(load(&files, Subject::Scene(&scene)).trials.len(), pushes.len());
    scene.statics = BallScene { floor: Some(-3.0), ..FROM_ABOVE }.build("ball", 1.0).unwrap().statics;
    assert_eq!(load(&files, Subject::Scene(&scene)).trials.len(), 1);
    // Four films are enough as they are.
    let four: Vec<TrackFile> =
        (0..4).map(|k| TrackFile { name: format!("film{k}.csv"), ..files[0].clone() }).collect();
    assert_eq!(load(&four, Subject::Ball(&FROM_ABOVE)).trials.len(), 4);
}
