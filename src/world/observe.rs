//! What a rollout's sensors show of it: the truth goes in, what is seen comes out; one place for both
//! engines.
//!
//! Engines simulate the truth. Where effects of the form `Act::Sensor` are at work, what [`super::simulate`]
//! returns as samples is what the sensors show; contact events, counts, goals and the outcome stay the
//! truth's, in true time.
//!
//! Clocks: sensors may show the state of another time than they stamp. Stamps are the scene's usual ones (0,
//! and every `observe_every` steps) from 0 until the end of the rollout has been seen, and that end. The
//! engine then observes the two steps about each true time instead of its usual ones, and the state between
//! them is interpolated: positions and angles by cubic Hermite polynomials, which are exact in free flight,
//! speeds linearly. Before the start, bodies are seen waiting at it.
//!
//! What starts at its first observation (a measured trial) starts where the sensors saw it and not where it
//! was: whoever fits a sensor's parameters has to set the start back.
//!
//! The first effect of several is the nearest to the world: the second shows what the first does.

use super::effect::{self, Act, Constants, Sensor, Shown, Surroundings};
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;
use crate::trajectory::{Track, Trajectory, hermite};

/// What the sensors among `effects` show of a trajectory, stamped at its own times as far as its span covers
/// them.
///
/// Between samples the truth is interpolated: where clocks are off, a trajectory sampled coarser than its
/// bounces gives a poor picture, and [`super::simulate`] with the same effects a good one.
pub fn observe(truth: Trajectory, effects: &[EffectTerm]) -> Result<Trajectory> {
    let around = Surroundings { time_step: 0.0, gravity: [0.0; 2] };
    let mut view = View::default();
    for (i, term) in effects.iter().enumerate() {
        let active = effect::resolve(term, format_args!("effects[{i}]"))?;
        if let (Act::Sensor(sensor), false) = (active.effect.act, active.is_neutral()) {
            view.sensors.push((sensor, sensor.constants(&active.values, &around)));
        }
    }
    let [rate, offset] = view.clock();
    let stamps: Vec<[f64; 2]> = truth.times.iter().map(|stamp| [*stamp, rate * stamp + offset]).collect();
    Ok(view.see(truth, &stamps))
}

/// The sensors of a rollout.
#[derive(Clone, Default)]
pub struct View {
    /// Those that change anything; the nearest to the world first.
    pub sensors: Vec<(&'static dyn Sensor, Constants)>,
    /// Between stamps, s.
    every: f64,
}

/// Steps at which an engine observes, beside the start and the end.
#[derive(Clone, Debug)]
pub enum Schedule {
    /// Every so many steps.
    Every(u32),
    /// At these; rising.
    At(Vec<u32>),
}

/// Times no further apart than this are the same, s: more than rounds off, less than can be seen.
const HAIR: f64 = 1e-9;
/// Most stamps of a rollout whose clocks are off, or this many times the usual ones if that is more. No clock
/// of a real sensor is off that far.
const MOST_STAMPS: f64 = 1000.0;
const MOST_TIMES_USUAL: f64 = 4.0;

impl View {
    /// The sensors, if there are any, with stamps `every` seconds.
    pub fn new(sensors: Vec<(&'static dyn Sensor, Constants)>, every: f64) -> Option<View> {
        (!sensors.is_empty()).then_some(View { sensors, every })
    }

    /// What is seen of a simulated truth.
    pub fn seen(&self, truth: Trajectory) -> Trajectory {
        let last = truth.times.last().copied().unwrap_or(0.0);
        let [rate, offset] = self.clock();
        if !self.warps() {
            let stamps: Vec<[f64; 2]> = truth.times.iter().map(|t| [*t, *t]).collect();
            return self.see(truth, &stamps);
        }
        // The last stamp shows the end, and one of the grid that is all but there gives way to it; a sensor
        // that wakes after the end shows nothing else.
        let end = ((last - offset) / rate).max(0.0);
        let grid = (0..).map(|k| f64::from(k) * self.every).take_while(|t| *t < end - HAIR);
        let stamps = grid.chain([end]).map(|stamp| [stamp, (rate * stamp + offset).min(last)]);
        let stamps: Vec<[f64; 2]> = stamps.collect();
        self.see(truth, &stamps)
    }

    /// The steps that the engine must observe to show what there is to see; an error if that is more than a
    /// clock can be off.
    pub fn schedule(&self, time_step: f64, steps: u32, observe_every: u32) -> Result<Schedule> {
        if !self.warps() {
            return Ok(Schedule::Every(observe_every));
        }
        let [rate, offset] = self.clock();
        let stamps = (f64::from(steps) * time_step - offset) / rate / self.every;
        let most = MOST_STAMPS.max(MOST_TIMES_USUAL * f64::from(steps / observe_every));
        if stamps > most {
            let allowed = format!("sensors by whose clocks a rollout has at most {most} observations");
            return Err(Error::input("effects", format!("{stamps:.0} observations"), allowed));
        }
        let mut at = Vec::new();
        for k in 0.. {
            let step = (rate * (f64::from(k) * self.every) + offset) / time_step;
            if step >= f64::from(steps) {
                break;
            }
            let (low, nearest) = (step.floor().max(0.0) as u32, step.round());
            if (step - nearest).abs() * time_step < HAIR {
                at.push(nearest.max(0.0) as u32);
            } else {
                at.extend([low, low + 1]);
            }
        }
        at.dedup();
        Ok(Schedule::At(at))
    }

    /// The states of the truth at `stamps` (stamp, true time), as the sensors show them; those of times
    /// beyond the truth are left out.
    fn see(&self, truth: Trajectory, stamps: &[[f64; 2]]) -> Trajectory {
        let warps = self.warps();
        let mut bodies: Vec<Track> =
            truth.bodies.iter().map(|b| Track::with_capacity(&b.name, b.len())).collect();
        let (mut times, mut interval) = (Vec::with_capacity(truth.times.len()), 0);
        for (i, [stamp, time]) in stamps.iter().enumerate() {
            let share = if warps {
                match between(&truth.times, *time, &mut interval) {
                    Some(share) => share,
                    None => continue,
                }
            } else {
                interval = i;
                Share::Sample
            };
            times.push(*stamp);
            for (track, own) in bodies.iter_mut().zip(&truth.bodies) {
                let state = state(own, &truth.times, interval, share);
                let s = self.sensors.iter().fold(state, |s, (sensor, c)| sensor.show(c, s));
                track.push([s.x, s.y], s.angle, [s.vx, s.vy], s.omega);
            }
        }
        Trajectory { times, bodies, ..truth }
    }

    /// (rate, offset) of all sensors together: true time = rate * stamp + offset.
    fn clock(&self) -> [f64; 2] {
        self.sensors.iter().fold([1.0, 0.0], |[rate, offset], (sensor, c)| {
            let [r, o] = sensor.clock(c);
            [rate * r, rate * o + offset]
        })
    }

    fn warps(&self) -> bool {
        self.clock() != [1.0, 0.0]
    }
}

impl Schedule {
    /// The next step to be observed after `step`; beyond all steps if there is none.
    pub fn after(&self, step: u32) -> u32 {
        match self {
            Schedule::Every(n) => (step / n + 1).saturating_mul(*n),
            Schedule::At(steps) => {
                steps.get(steps.partition_point(|s| *s <= step)).copied().unwrap_or(u32::MAX)
            }
        }
    }

    /// About how many observations there are in `steps` steps.
    pub fn count(&self, steps: u32) -> usize {
        match self {
            Schedule::Every(n) => (steps / n) as usize + 2,
            Schedule::At(at) => at.len() + 2,
        }
    }
}

/// Where in an interval between two samples a time lies.
#[derive(Clone, Copy)]
enum Share {
    /// Before the first sample.
    Waiting,
    /// At the sample that the interval begins with.
    Sample,
    /// Further on, by this share of the interval.
    Within(f64),
}

/// Finds the interval in which `time` lies, from the last one on; `None` beyond the end.
fn between(times: &[f64], time: f64, interval: &mut usize) -> Option<Share> {
    let last = times.len().checked_sub(1)?;
    while *interval < last && times[*interval + 1] <= time + HAIR {
        *interval += 1;
    }
    let start = times[*interval];
    if time < start - HAIR {
        Some(Share::Waiting)
    } else if time <= start + HAIR {
        Some(Share::Sample)
    } else if *interval == last {
        None
    } else {
        Some(Share::Within((time - start) / (times[*interval + 1] - start)))
    }
}

fn state(track: &Track, times: &[f64], i: usize, share: Share) -> Shown {
    let own = Shown {
        x: track.x[i],
        y: track.y[i],
        angle: track.angle[i],
        vx: track.vx[i],
        vy: track.vy[i],
        omega: track.omega[i],
    };
    let s = match share {
        Share::Sample => return own,
        Share::Waiting => return Shown { vx: 0.0, vy: 0.0, omega: 0.0, ..own },
        Share::Within(s) => s,
    };
    let (j, span) = (i + 1, times[i + 1] - times[i]);
    let place = |p: &[f64], v: &[f64]| hermite([p[i], p[j]], [v[i], v[j]], span, s);
    let speed = |v: &[f64]| v[i] + s * (v[j] - v[i]);
    Shown {
        x: place(&track.x, &track.vx),
        y: place(&track.y, &track.vy),
        angle: place(&track.angle, &track.omega),
        vx: speed(&track.vx),
        vy: speed(&track.vy),
        omega: speed(&track.omega),
    }
}
