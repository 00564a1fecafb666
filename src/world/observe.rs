//! Sensor models: from the true trajectory to the measured one, shared by both engines.
//!
//! Engines simulate the truth. With sensor effects (`EffectKind::Sensor`), the samples of a simulation are
//! the measured values; contact events, counts, goals and the outcome remain true, in true time.
//!
//! Clocks: a sensor may stamp a state with another time. Stamps are the scene's usual ones (0, and every
//! `observe_every` steps) from 0 until the end of the rollout is measured, and that end. The engine then
//! observes the two steps around each true time, and the state between them is interpolated: positions and
//! angles by cubic Hermite polynomials, which are exact in free flight, velocities linearly. Before the
//! start, bodies are shown at rest at their initial pose.
//!
//! A measured trial starts at its first observation, which includes the sensor's error: an estimator of
//! sensor parameters must correct the initial state for it.
//!
//! Sensors apply in the order of the effects: the second measures the output of the first.

use super::effect::{self, Constants, EffectKind, Measurement, Sensor, SimulationContext};
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;
use crate::trajectory::{Track, Trajectory, hermite};

/// Applies the sensors among `effects` to a trajectory, stamped at its own times within its span.
///
/// The truth is interpolated between samples: with clock errors, a trajectory sampled more coarsely than its
/// bounces is a poor approximation; a simulation with the same effects is accurate.
pub fn observe(truth: Trajectory, effects: &[EffectTerm]) -> Result<Trajectory> {
    let context = SimulationContext { time_step: 0.0, gravity: [0.0; 2] };
    let mut view = SensorChain::default();
    for (i, term) in effects.iter().enumerate() {
        let active = effect::resolve(term, format_args!("effects[{i}]"))?;
        if let (EffectKind::Sensor(sensor), false) = (active.effect.kind, active.is_neutral()) {
            view.sensors.push((sensor, sensor.constants(&active.values, &context)));
        }
    }
    let [rate, offset] = view.clock();
    let stamps: Vec<[f64; 2]> = truth.times.iter().map(|stamp| [*stamp, rate * stamp + offset]).collect();
    Ok(view.measure_at(truth, &stamps))
}

/// The sensors of a rollout.
#[derive(Clone, Default)]
pub struct SensorChain {
    /// Sensors with non-neutral parameters, in order of application.
    pub sensors: Vec<(&'static dyn Sensor, Constants)>,
    /// Time between stamps, s.
    every: f64,
}

/// Steps at which an engine observes, in addition to the start and the end.
#[derive(Clone, Debug)]
pub enum ObservationSchedule {
    /// Every so many steps.
    Every(u32),
    /// At these steps; increasing.
    At(Vec<u32>),
}

/// Times that differ by less are equal, s: above rounding errors, below any sampling interval.
const TIME_TOLERANCE_S: f64 = 1e-9;
/// Maximum number of observations of a rollout with clock errors, or this multiple of the usual number if
/// that is more; more means an implausible clock.
const MAX_OBSERVATIONS: f64 = 1000.0;
const MAX_OBSERVATION_FACTOR: f64 = 4.0;

impl SensorChain {
    /// The sensors, if there are any, with stamps `every` seconds.
    pub fn new(sensors: Vec<(&'static dyn Sensor, Constants)>, every: f64) -> Option<SensorChain> {
        (!sensors.is_empty()).then_some(SensorChain { sensors, every })
    }

    /// The measurement of a simulated trajectory.
    pub fn measure(&self, truth: Trajectory) -> Trajectory {
        let last = truth.times.last().copied().unwrap_or(0.0);
        let [rate, offset] = self.clock();
        if !self.changes_clock() {
            let stamps: Vec<[f64; 2]> = truth.times.iter().map(|t| [*t, *t]).collect();
            return self.measure_at(truth, &stamps);
        }
        // The last stamp shows the end and replaces a grid stamp within the tolerance; a sensor that
        // starts after the end shows only the end.
        let end = ((last - offset) / rate).max(0.0);
        let grid = (0..).map(|k| f64::from(k) * self.every).take_while(|t| *t < end - TIME_TOLERANCE_S);
        let stamps = grid.chain([end]).map(|stamp| [stamp, (rate * stamp + offset).min(last)]);
        let stamps: Vec<[f64; 2]> = stamps.collect();
        self.measure_at(truth, &stamps)
    }

    /// The steps that the engine must observe; an error if they are implausibly many.
    pub fn schedule(&self, time_step: f64, steps: u32, observe_every: u32) -> Result<ObservationSchedule> {
        if !self.changes_clock() {
            return Ok(ObservationSchedule::Every(observe_every));
        }
        let [rate, offset] = self.clock();
        let stamps = (f64::from(steps) * time_step - offset) / rate / self.every;
        let most = MAX_OBSERVATIONS.max(MAX_OBSERVATION_FACTOR * f64::from(steps / observe_every));
        if stamps > most {
            let allowed = format!("sensors whose clocks give a rollout at most {most} observations");
            return Err(Error::input("effects", format!("{stamps:.0} observations"), allowed));
        }
        let mut at = Vec::new();
        for k in 0.. {
            let step = (rate * (f64::from(k) * self.every) + offset) / time_step;
            if step >= f64::from(steps) {
                break;
            }
            let (low, nearest) = (step.floor().max(0.0) as u32, step.round());
            if (step - nearest).abs() * time_step < TIME_TOLERANCE_S {
                at.push(nearest.max(0.0) as u32);
            } else {
                at.extend([low, low + 1]);
            }
        }
        at.dedup();
        Ok(ObservationSchedule::At(at))
    }

    /// The measured states at `stamps` (stamp, true time); times beyond the trajectory are skipped.
    fn measure_at(&self, truth: Trajectory, stamps: &[[f64; 2]]) -> Trajectory {
        let changes_clock = self.changes_clock();
        let mut bodies: Vec<Track> =
            truth.bodies.iter().map(|b| Track::with_capacity(&b.name, b.len())).collect();
        let (mut times, mut interval) = (Vec::with_capacity(truth.times.len()), 0);
        for (i, [stamp, time]) in stamps.iter().enumerate() {
            let share = if changes_clock {
                match locate(&truth.times, *time, &mut interval) {
                    Some(share) => share,
                    None => continue,
                }
            } else {
                interval = i;
                TimePosition::Sample
            };
            times.push(*stamp);
            for (track, own) in bodies.iter_mut().zip(&truth.bodies) {
                let state = state(own, &truth.times, interval, share);
                let s = self.sensors.iter().fold(state, |s, (sensor, c)| sensor.measure(c, s));
                track.push([s.x, s.y], s.angle, [s.vx, s.vy], s.omega);
            }
        }
        Trajectory { times, bodies, ..truth }
    }

    /// (rate, offset) of all sensors combined: true time = rate * stamp + offset.
    fn clock(&self) -> [f64; 2] {
        self.sensors.iter().fold([1.0, 0.0], |[rate, offset], (sensor, c)| {
            let [r, o] = sensor.clock(c);
            [rate * r, rate * o + offset]
        })
    }

    fn changes_clock(&self) -> bool {
        self.clock() != [1.0, 0.0]
    }
}

impl ObservationSchedule {
    /// The next step to observe after `step`; `u32::MAX` if there is none.
    pub fn after(&self, step: u32) -> u32 {
        match self {
            ObservationSchedule::Every(n) => (step / n + 1).saturating_mul(*n),
            ObservationSchedule::At(steps) => {
                steps.get(steps.partition_point(|s| *s <= step)).copied().unwrap_or(u32::MAX)
            }
        }
    }

    /// Approximate number of observations in `steps` steps.
    pub fn count(&self, steps: u32) -> usize {
        match self {
            ObservationSchedule::Every(n) => (steps / n) as usize + 2,
            ObservationSchedule::At(at) => at.len() + 2,
        }
    }
}

/// Position of a time relative to an interval between two samples.
#[derive(Clone, Copy)]
enum TimePosition {
    /// Before the first sample.
    BeforeStart,
    /// At the first sample of the interval.
    Sample,
    /// Within the interval, at this fraction.
    Within(f64),
}

/// Finds the interval that contains `time`, starting from the last one; `None` beyond the end.
fn locate(times: &[f64], time: f64, interval: &mut usize) -> Option<TimePosition> {
    let last = times.len().checked_sub(1)?;
    while *interval < last && times[*interval + 1] <= time + TIME_TOLERANCE_S {
        *interval += 1;
    }
    let start = times[*interval];
    if time < start - TIME_TOLERANCE_S {
        Some(TimePosition::BeforeStart)
    } else if time <= start + TIME_TOLERANCE_S {
        Some(TimePosition::Sample)
    } else if *interval == last {
        None
    } else {
        Some(TimePosition::Within((time - start) / (times[*interval + 1] - start)))
    }
}

fn state(track: &Track, times: &[f64], i: usize, share: TimePosition) -> Measurement {
    let own = Measurement {
        x: track.x[i],
        y: track.y[i],
        angle: track.angle[i],
        vx: track.vx[i],
        vy: track.vy[i],
        omega: track.omega[i],
    };
    let s = match share {
        TimePosition::Sample => return own,
        TimePosition::BeforeStart => return Measurement { vx: 0.0, vy: 0.0, omega: 0.0, ..own },
        TimePosition::Within(s) => s,
    };
    let (j, span) = (i + 1, times[i + 1] - times[i]);
    let place = |p: &[f64], v: &[f64]| hermite([p[i], p[j]], [v[i], v[j]], span, s);
    let speed = |v: &[f64]| v[i] + s * (v[j] - v[i]);
    Measurement {
        x: place(&track.x, &track.vx),
        y: place(&track.y, &track.vy),
        angle: place(&track.angle, &track.omega),
        vx: speed(&track.vx),
        vy: speed(&track.vy),
        omega: speed(&track.omega),
    }
}
