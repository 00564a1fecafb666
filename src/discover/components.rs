//! The variance components that make launches most likely.
//!
//! Each component's logarithm steps up and down in turn, further where that helps and less far where it does not (pattern
//! search: Hooke and Jeeves, J. ACM 8 (1961) 212): there are few, and they are few nats wide. What a part says under some
//! components is worked out once, whichever launches a search goes by, so held-out folds, which start alike, share most of
//! theirs; and so are the sums over its windows, which most steps leave alone. Components as they may be are drawn by a walk on the
//! same logarithms (Metropolis et al., J. Chem. Phys. 21 (1953) 1087).

use std::collections::HashMap;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::columns::{Own, pushes};
use super::gaussian::{Components, Summed, Weighed};
use super::launch::Part;
use crate::error::Result;
use crate::progress::Progress;
use crate::rng::Stream;

/// First steps of the components' logarithms: of a first search, about what is nearly right, and about what a few launches less
/// can hardly move.
pub const WIDE: f64 = 1.4;
pub const NEAR: f64 = 0.4;
pub const HELD: f64 = 0.2;
/// The shortest steps (a deviation is hardly ever known to a tenth) and the longest; what a step that helps and one that does not
/// are made longer by.
const FINEST: f64 = 0.1;
const LONGEST: f64 = 1.4;
const LONGER: f64 = 1.5;
const SHORTER: f64 = 0.4;
/// Priors of the components' logarithms: centre, standard deviation. Slow misfit of the size of the noise; pushes by launch of
/// a third of what effects declare; contacts that err by a hundredth of the speed of approach.
const SLOW: [f64; 2] = [0.0, 2.0];
const PUSH: [f64; 2] = [-1.2, 1.2];
const LEAP: [f64; 2] = [-4.6, 1.0];
/// The same of the strength of effects of several amplitudes: about a seventh.
const STRENGTH: [f64; 2] = [-1.9, 1.2];
/// Share of its size by which anything may differ from launch to launch, and how many of the deviations that effects declare:
/// a model that needs more leaves something that it does not name.
pub const SIZES: f64 = 0.2;
pub const DECLARED: f64 = 2.0;
/// Gain (nats) of a search below which it is the last, and most searches.
const SETTLED: f64 = 0.05;
const SEARCHES: usize = 4;
/// Rounds of a walk, each a step of every component, before the first draw and between draws; shortest and longest deviation of a
/// step, of which there are many on the logarithm's scale.
const FORGETS: usize = 60;
const BETWEEN: usize = 12;
const STRIDES: [f64; 2] = [0.2, 2.0];

impl Components {
    /// Where a fit starts; `strengths`: whether the model has effects whose strength may differ as a whole.
    pub fn start(strengths: bool) -> Components {
        let strength = if strengths { STRENGTH[0].exp() } else { 0.0 };
        Components { slow: 1.0, leap: 0.01, strength, push: vec![0.3; pushes().len()] }
    }

    pub fn logs(&self) -> Vec<f64> {
        let own = [self.slow, self.leap];
        let free = [self.strength].into_iter().filter(|s| *s > 0.0);
        own.iter().chain(&self.push).copied().chain(free).map(f64::ln).collect()
    }

    pub fn with(&self, logs: &[f64]) -> Components {
        let mut rest = logs.iter().map(|l| l.exp());
        let mut next = || rest.next().unwrap_or(0.0);
        Components {
            slow: next(),
            leap: next(),
            push: self.push.iter().map(|_| next()).collect(),
            strength: if self.strength > 0.0 { next() } else { 0.0 },
        }
    }

    /// The most that launches have reason to differ by, logarithms.
    fn most(&self) -> Vec<f64> {
        let strength = [SIZES.ln()].into_iter().filter(|_| self.strength > 0.0);
        let pushes = self.push.iter().map(|_| DECLARED.ln());
        [f64::INFINITY; 2].into_iter().chain(pushes).chain(strength).collect()
    }

    fn log_prior(&self, logs: &[f64]) -> f64 {
        let strength = [STRENGTH].into_iter().filter(|_| self.strength > 0.0);
        let pushes = self.push.iter().map(|_| PUSH);
        let all = [SLOW, LEAP].into_iter().chain(pushes).chain(strength);
        -0.5 * logs.iter().zip(all).map(|(l, [centre, sd])| ((l - centre) / sd).powi(2)).sum::<f64>()
    }
}

/// Densities of parts by components, where a model stands.
pub struct Likelihood<'a> {
    parts: &'a [Part],
    from: Components,
    /// By the slow misfit; and by what else windows have of their own.
    weighed: HashMap<u64, Vec<Weighed>>,
    kinds: Vec<Own>,
    summed: HashMap<Vec<u64>, Vec<Option<Summed>>>,
    densities: HashMap<Vec<u64>, Vec<f64>>,
}

impl<'a> Likelihood<'a> {
    /// `from`: components from which searches start.
    pub fn new(parts: &'a [Part], from: &Components) -> Likelihood<'a> {
        let mut kinds: Vec<Own> = Vec::new();
        for kind in parts.iter().flat_map(|p| &p.blocks).flat_map(|b| &b.kinds) {
            if !kinds.contains(kind) {
                kinds.push(*kind);
            }
        }
        let (weighed, summed, densities) = (HashMap::new(), HashMap::new(), HashMap::new());
        Likelihood { parts, from: from.clone(), weighed, kinds, summed, densities }
    }

    /// Components that make the parts most likely, sought in steps of `first` at first, launches differing by no more than they
    /// have reason to.
    pub fn most(&mut self, first: f64, progress: &dyn Progress) -> Result<Components> {
        let most = self.from.most();
        let from = self.from.clone();
        let matter = self.matter();
        let mut quality = |logs: &[f64]| self.densities(logs).iter().sum::<f64>() + from.log_prior(logs);
        let mut logs: Vec<f64> = from.logs().iter().zip(&most).map(|(l, most)| l.min(*most)).collect();
        let mut best = quality(&logs);
        let mut first = first;
        for _ in 0..SEARCHES {
            let before = best;
            let mut steps = vec![first; logs.len()];
            while steps.iter().zip(&matter).any(|(s, matters)| *matters && s.abs() >= FINEST) {
                for k in (0..logs.len()).filter(|k| matter[*k]) {
                    progress.check_stop()?;
                    let step = steps[k];
                    let mut better = |way: f64| {
                        let mut moved = logs.clone();
                        moved[k] = (moved[k] + way).min(most[k]);
                        let value = if moved[k] == logs[k] { f64::NEG_INFINITY } else { quality(&moved) };
                        (value > best).then_some((value, moved, way))
                    };
                    if step.abs() < FINEST {
                        continue;
                    }
                    match better(step).or_else(|| better(-step)) {
                        Some((value, moved, way)) => {
                            (best, logs) = (value, moved);
                            steps[k] = (LONGER * way).clamp(-LONGEST, LONGEST);
                        }
                        None => steps[k] *= SHORTER,
                    }
                }
            }
            if best - before < SETTLED {
                break;
            }
            first = HELD;
        }
        Ok(from.with(&logs))
    }

    /// Components as they may be where the model stands, beginning where the search did; launches differ by no more than they have
    /// reason to. Steps are multiples of the shortest of a search, so that a walk comes by the same places again.
    pub fn draw(&mut self, count: usize, stream: &mut Stream) -> Vec<Components> {
        let (from, matter) = (self.from.clone(), self.matter());
        let most = from.most();
        let begun: Vec<f64> = from.logs().iter().zip(&most).map(|(l, most)| l.min(*most)).collect();
        let mut steps = vec![0.0; begun.len()];
        let at =
            |steps: &[f64]| -> Vec<f64> { begun.iter().zip(steps).map(|(l, n)| l + FINEST * n).collect() };
        let quality = |own: &mut Likelihood, logs: &[f64]| {
            own.densities(logs).iter().sum::<f64>() + from.log_prior(logs)
        };
        let mut here = quality(self, &begun);
        let mut out = Vec::with_capacity(count);
        for round in 1..=FORGETS + BETWEEN * count {
            for k in (0..begun.len()).filter(|k| matter[*k]) {
                let [short, long] = STRIDES;
                let stride = short * libm::pow(long / short, stream.random());
                let z: f64 = StandardNormal.sample(stream);
                let u: f64 = stream.random();
                let mut moved = steps.clone();
                moved[k] += (stride * z / FINEST).round();
                let logs = at(&moved);
                if logs[k] > most[k] {
                    continue;
                }
                let there = quality(self, &logs);
                if libm::log(u) < there - here {
                    (here, steps) = (there, moved);
                }
            }
            if round > FORGETS && (round - FORGETS).is_multiple_of(BETWEEN) {
                out.push(from.with(&at(&steps)));
            }
        }
        out
    }

    /// Whether parts depend on any of them.
    pub fn depend(&self) -> bool {
        let own = |part: &Part| {
            part.blocks.iter().any(|b| !b.kinds.is_empty() || b.slow.iter().any(|slow| *slow > 0.0))
        };
        self.parts.iter().any(|part| part.differs || own(part))
    }

    /// Which of the logarithms the parts depend on.
    fn matter(&self) -> Vec<bool> {
        let alike = self.parts.first().and_then(|p| p.blocks.first()).map_or(&[][..], |b| &b.alike_of);
        let used = |own: Own| self.kinds.contains(&own) || alike.contains(&own);
        let pushes = (0..self.from.push.len()).map(|place| used(Own::Push(place)));
        let rest = self.from.logs().len() - 2 - self.from.push.len();
        [true, used(Own::Leap)].into_iter().chain(pushes).chain(std::iter::repeat_n(true, rest)).collect()
    }

    /// Log densities of all parts.
    fn densities(&mut self, logs: &[f64]) -> &[f64] {
        let key: Vec<u64> = logs.iter().map(|l| l.to_bits()).collect();
        let parts = self.parts;
        self.densities.entry(key).or_insert_with(|| {
            let own = self.from.with(logs);
            let of = |p| Weighed::of(p, &[], own.slow);
            let weighed = self.weighed.entry(own.slow.to_bits());
            let weighed = weighed.or_insert_with(|| parts.iter().map(of).collect());
            let kinds = self.kinds.iter().map(|kind| own.of(*kind)).chain([own.slow]);
            let with_own = |(w, p): (&Weighed, &Part)| w.with_own(p, &own);
            let summed = self.summed.entry(kinds.map(f64::to_bits).collect());
            let summed = summed.or_insert_with(|| weighed.iter().zip(parts).map(with_own).collect());
            let density = |(s, p): (&Option<Summed>, &Part)| s.as_ref()?.likelihood(p, &own);
            summed.iter().zip(parts).map(density).map(|d| d.unwrap_or(f64::NEG_INFINITY)).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::launch::Block;
    use crate::rng;
    use nalgebra::{DMatrix, DVector};

    /// Launches of a block each, with a push of its own.
    fn parts() -> Vec<Part> {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.3);
        let part = |launch: usize| {
            let columns = DMatrix::from_fn(8, 2, |i, k| 2.0 * wave(31 + 7 * i + k + launch));
            let noise = DVector::from_fn(8, |i, _| 1.4 * wave(5 * i * i + 97 * launch));
            let block = Block {
                window: launch,
                left: noise + columns.column(0) * wave(11 * launch),
                slow: DVector::zeros(8),
                alike: columns.columns(0, 1).into_owned(),
                alike_of: vec![Own::Push(0)],
                columns,
                own: DMatrix::zeros(8, 0),
                kinds: Vec::new(),
                log_white: 0.0,
            };
            Part { launch, blocks: vec![block], differs: true }
        };
        (0..8).map(part).collect()
    }

    /// The walk's draws of a component that the data determine match a sum over its grid; those of one that they do not match
    /// its prior.
    #[test]
    fn components_are_drawn_as_they_may_be() {
        let parts = parts();
        let start = Components::start(false);
        let mut likely = Likelihood::new(&parts, &start);
        assert!(likely.depend());
        let drawn = likely.draw(4000, &mut rng::stream(2, "test"));
        let moments = |values: &[f64], weights: &[f64]| {
            let all: f64 = weights.iter().sum();
            let mean = values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>() / all;
            let square = values.iter().zip(weights).map(|(v, w)| (v - mean).powi(2) * w).sum::<f64>();
            [mean, (square / all).sqrt()]
        };
        let even = vec![1.0; drawn.len()];
        let found = moments(&drawn.iter().map(|c| c.push[0].ln()).collect::<Vec<_>>(), &even);
        // Where the walk comes by.
        let begun = start.push[0].ln();
        let grid: Vec<f64> =
            (-60..60).map(|i| begun + FINEST * f64::from(i)).filter(|l| *l <= DECLARED.ln()).collect();
        let at = |l: f64| {
            let mut logs = start.logs();
            logs[2] = l;
            logs
        };
        let of = |l: &f64| likely.densities(&at(*l)).iter().sum::<f64>() + start.log_prior(&at(*l));
        let logs: Vec<f64> = grid.iter().map(of).collect();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let wanted = moments(&grid, &logs.iter().map(|l| (l - most).exp()).collect::<Vec<_>>());
        assert!((found[0] - wanted[0]).abs() < 0.1 * wanted[1], "{found:?} for {wanted:?}");
        assert!((found[1] / wanted[1] - 1.0).abs() < 0.1, "{found:?} for {wanted:?}");
        assert!(wanted[1] < 0.8, "the parts tell the push: {wanted:?}");
        let slow = moments(&drawn.iter().map(|c| c.slow.ln()).collect::<Vec<_>>(), &even);
        assert!((slow[0] - SLOW[0]).abs() < 0.3 && (slow[1] - SLOW[1]).abs() < 0.3, "{slow:?}");
    }

    /// Windows that start from what is known whole, without slow misfit, depend on no component.
    #[test]
    fn what_does_not_differ_depends_on_none() {
        let alike: Vec<Part> = parts().into_iter().map(|p| Part { differs: false, ..p }).collect();
        assert!(!Likelihood::new(&alike, &Components::start(false)).depend());
    }

    /// What a search steps along is what the components are, and a model without strengths has no step for one.
    #[test]
    fn components_go_through_their_logarithms() {
        for (strengths, count) in [(false, 2 + pushes().len()), (true, 3 + pushes().len())] {
            let start = Components::start(strengths);
            let mut logs = start.logs();
            assert_eq!(logs.len(), count);
            assert!((start.log_prior(&logs) - start.log_prior(&start.logs())).abs() < 1e-12);
            (0..count).for_each(|k| logs[k] += 0.1 * (1 + k) as f64);
            let moved = start.with(&logs);
            assert!(moved.logs().iter().zip(&logs).all(|(a, b)| (a - b).abs() < 1e-12));
            assert_eq!(moved.strength > 0.0, strengths);
        }
    }
}
