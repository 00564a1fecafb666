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

use super::columns::{RandomEffect, nuisance_accelerations};
use super::gaussian::{CrossProducts, GroupProducts, VarianceComponents};
use super::launch::Group;
use crate::rng::Stream;

/// First steps of the components' logarithms: of a first search, about what is nearly right, and about what a few launches less
/// can hardly move.
pub const INITIAL_STEP: f64 = 1.4;
pub const WARM_STEP: f64 = 0.4;
pub const RESTART_STEP: f64 = 0.2;
/// The shortest steps (a deviation is hardly ever known to a tenth) and the longest; what a step that helps and one that does not
/// are made longer by.
const MIN_STEP: f64 = 0.1;
const MAX_STEP: f64 = 1.4;
const STEP_GROWTH: f64 = 1.5;
const STEP_SHRINKAGE: f64 = 0.4;
/// Priors of the components' logarithms: centre, standard deviation. Slow misfit of the size of the noise; pushes by launch of
/// a third of what effects declare; contacts that err by a hundredth of the speed of approach.
const LOG_DISCREPANCY_PRIOR: [f64; 2] = [0.0, 2.0];
const LOG_ACCELERATION_PRIOR: [f64; 2] = [-1.2, 1.2];
const LOG_IMPACT_PRIOR: [f64; 2] = [-4.6, 1.0];
/// The same of the strength of effects of several amplitudes: about a seventh.
const LOG_SCALE_PRIOR: [f64; 2] = [-1.9, 1.2];
/// Share of its size by which anything may differ from launch to launch, and how many of the deviations that effects declare:
/// a model that needs more leaves something that it does not name.
pub const MAX_SCALE_SD: f64 = 0.2;
pub const MAX_ACCELERATION_SD: f64 = 2.0;
/// Gain (nats) of a search below which it is the last, and most searches.
const GAIN_TOLERANCE: f64 = 0.05;
const MAX_SEARCHES: usize = 4;
/// Rounds of a walk, each a step of every component, before the first draw and between draws; shortest and longest deviation of a
/// step, of which there are many on the logarithm's scale.
const BURN_IN: usize = 60;
const THINNING: usize = 12;
const PROPOSAL_SD: [f64; 2] = [0.2, 2.0];

impl VarianceComponents {
    /// Where a fit starts; `strengths`: whether the model has effects whose strength may differ as a whole.
    pub fn initial(strengths: bool) -> VarianceComponents {
        let scale = if strengths { LOG_SCALE_PRIOR[0].exp() } else { 0.0 };
        VarianceComponents {
            discrepancy: 1.0,
            impact: 0.01,
            scale,
            accelerations: vec![0.3; nuisance_accelerations().len()],
        }
    }

    pub fn log_values(&self) -> Vec<f64> {
        let own = [self.discrepancy, self.impact];
        let free = [self.scale].into_iter().filter(|s| *s > 0.0);
        own.iter().chain(&self.accelerations).copied().chain(free).map(f64::ln).collect()
    }

    pub fn with_log_values(&self, logs: &[f64]) -> VarianceComponents {
        let mut rest = logs.iter().map(|l| l.exp());
        let mut next = || rest.next().unwrap_or(0.0);
        VarianceComponents {
            discrepancy: next(),
            impact: next(),
            accelerations: self.accelerations.iter().map(|_| next()).collect(),
            scale: if self.scale > 0.0 { next() } else { 0.0 },
        }
    }

    /// The most that launches have reason to differ by, logarithms.
    fn log_upper_bounds(&self) -> Vec<f64> {
        let strength = [MAX_SCALE_SD.ln()].into_iter().filter(|_| self.scale > 0.0);
        let pushes = self.accelerations.iter().map(|_| MAX_ACCELERATION_SD.ln());
        [f64::INFINITY; 2].into_iter().chain(pushes).chain(strength).collect()
    }

    fn log_prior(&self, logs: &[f64]) -> f64 {
        let strength = [LOG_SCALE_PRIOR].into_iter().filter(|_| self.scale > 0.0);
        let pushes = self.accelerations.iter().map(|_| LOG_ACCELERATION_PRIOR);
        let all = [LOG_DISCREPANCY_PRIOR, LOG_IMPACT_PRIOR].into_iter().chain(pushes).chain(strength);
        -0.5 * logs.iter().zip(all).map(|(l, [centre, sd])| ((l - centre) / sd).powi(2)).sum::<f64>()
    }
}

/// Densities of parts by components, where a model stands.
pub struct ComponentLikelihood<'a> {
    groups: &'a [Group],
    initial: VarianceComponents,
    /// By the slow misfit; and by what else windows have of their own.
    cross_products: HashMap<u64, Vec<CrossProducts>>,
    segment_effects: Vec<RandomEffect>,
    group_products: HashMap<Vec<u64>, Vec<Option<GroupProducts>>>,
    log_densities: HashMap<Vec<u64>, Vec<f64>>,
}

impl<'a> ComponentLikelihood<'a> {
    /// `from`: components from which searches start.
    pub fn new(groups: &'a [Group], from: &VarianceComponents) -> ComponentLikelihood<'a> {
        let mut segment_effects: Vec<RandomEffect> = Vec::new();
        for kind in groups.iter().flat_map(|p| &p.blocks).flat_map(|b| &b.z_segment_effects) {
            if !segment_effects.contains(kind) {
                segment_effects.push(*kind);
            }
        }
        let (cross_products, group_products, log_densities) =
            (HashMap::new(), HashMap::new(), HashMap::new());
        ComponentLikelihood {
            groups,
            initial: from.clone(),
            cross_products,
            segment_effects,
            group_products,
            log_densities,
        }
    }

    /// Components that make the parts most likely, sought in steps of `first` at first, launches differing by no more than they
    /// have reason to.
    pub fn maximise(&mut self, first: f64) -> VarianceComponents {
        let most = self.initial.log_upper_bounds();
        let from = self.initial.clone();
        let matter = self.active_components();
        let mut quality = |logs: &[f64]| self.log_densities(logs).iter().sum::<f64>() + from.log_prior(logs);
        let mut logs: Vec<f64> = from.log_values().iter().zip(&most).map(|(l, most)| l.min(*most)).collect();
        let mut best = quality(&logs);
        let mut first = first;
        for _ in 0..MAX_SEARCHES {
            let before = best;
            let mut steps = vec![first; logs.len()];
            while steps.iter().zip(&matter).any(|(s, matters)| *matters && s.abs() >= MIN_STEP) {
                for k in (0..logs.len()).filter(|k| matter[*k]) {
                    let step = steps[k];
                    let mut better = |way: f64| {
                        let mut moved = logs.clone();
                        moved[k] = (moved[k] + way).min(most[k]);
                        let value = if moved[k] == logs[k] { f64::NEG_INFINITY } else { quality(&moved) };
                        (value > best).then_some((value, moved, way))
                    };
                    if step.abs() < MIN_STEP {
                        continue;
                    }
                    match better(step).or_else(|| better(-step)) {
                        Some((value, moved, way)) => {
                            (best, logs) = (value, moved);
                            steps[k] = (STEP_GROWTH * way).clamp(-MAX_STEP, MAX_STEP);
                        }
                        None => steps[k] *= STEP_SHRINKAGE,
                    }
                }
            }
            if best - before < GAIN_TOLERANCE {
                break;
            }
            first = RESTART_STEP;
        }
        from.with_log_values(&logs)
    }

    /// Components as they may be where the model stands, beginning where the search did; launches differ by no more than they have
    /// reason to. Steps are multiples of the shortest of a search, so that a walk comes by the same places again.
    pub fn sample(&mut self, count: usize, stream: &mut Stream) -> Vec<VarianceComponents> {
        let (from, matter) = (self.initial.clone(), self.active_components());
        let most = from.log_upper_bounds();
        let begun: Vec<f64> = from.log_values().iter().zip(&most).map(|(l, most)| l.min(*most)).collect();
        let mut steps = vec![0.0; begun.len()];
        let at =
            |steps: &[f64]| -> Vec<f64> { begun.iter().zip(steps).map(|(l, n)| l + MIN_STEP * n).collect() };
        let quality = |own: &mut ComponentLikelihood, logs: &[f64]| {
            own.log_densities(logs).iter().sum::<f64>() + from.log_prior(logs)
        };
        let mut here = quality(self, &begun);
        let mut out = Vec::with_capacity(count);
        for round in 1..=BURN_IN + THINNING * count {
            for k in (0..begun.len()).filter(|k| matter[*k]) {
                let [short, long] = PROPOSAL_SD;
                let stride = short * libm::pow(long / short, stream.random());
                let z: f64 = StandardNormal.sample(stream);
                let u: f64 = stream.random();
                let mut moved = steps.clone();
                moved[k] += (stride * z / MIN_STEP).round();
                let logs = at(&moved);
                if logs[k] > most[k] {
                    continue;
                }
                let there = quality(self, &logs);
                if libm::log(u) < there - here {
                    (here, steps) = (there, moved);
                }
            }
            if round > BURN_IN && (round - BURN_IN).is_multiple_of(THINNING) {
                out.push(from.with_log_values(&at(&steps)));
            }
        }
        out
    }

    /// Whether parts depend on any of them.
    pub fn depends_on_components(&self) -> bool {
        let own = |part: &Group| {
            part.blocks
                .iter()
                .any(|b| !b.z_segment_effects.is_empty() || b.gp_variance.iter().any(|slow| *slow > 0.0))
        };
        self.groups.iter().any(|part| part.has_random_effects || own(part))
    }

    /// Which of the logarithms the parts depend on.
    fn active_components(&self) -> Vec<bool> {
        let alike =
            self.groups.first().and_then(|p| p.blocks.first()).map_or(&[][..], |b| &b.z_group_effects);
        let used = |own: RandomEffect| self.segment_effects.contains(&own) || alike.contains(&own);
        let pushes =
            (0..self.initial.accelerations.len()).map(|place| used(RandomEffect::Acceleration(place)));
        let rest = self.initial.log_values().len() - 2 - self.initial.accelerations.len();
        [true, used(RandomEffect::ImpactNoise)]
            .into_iter()
            .chain(pushes)
            .chain(std::iter::repeat_n(true, rest))
            .collect()
    }

    /// Log densities of all parts.
    fn log_densities(&mut self, logs: &[f64]) -> &[f64] {
        let key: Vec<u64> = logs.iter().map(|l| l.to_bits()).collect();
        let parts = self.groups;
        self.log_densities.entry(key).or_insert_with(|| {
            let own = self.initial.with_log_values(logs);
            let of = |p| CrossProducts::of(p, &[], own.discrepancy);
            let weighed = self.cross_products.entry(own.discrepancy.to_bits());
            let weighed = weighed.or_insert_with(|| parts.iter().map(of).collect());
            let kinds = self.segment_effects.iter().map(|kind| own.sd_of(*kind)).chain([own.discrepancy]);
            let with_own = |(w, p): (&CrossProducts, &Group)| w.with_segment_effects(p, &own);
            let summed = self.group_products.entry(kinds.map(f64::to_bits).collect());
            let summed = summed.or_insert_with(|| weighed.iter().zip(parts).map(with_own).collect());
            let density = |(s, p): (&Option<GroupProducts>, &Group)| s.as_ref()?.log_density(p, &own);
            summed.iter().zip(parts).map(density).map(|d| d.unwrap_or(f64::NEG_INFINITY)).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::launch::SegmentBlock;
    use crate::rng;
    use nalgebra::{DMatrix, DVector};

    /// Launches of a block each, with a push of its own.
    fn parts() -> Vec<Group> {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.3);
        let part = |launch: usize| {
            let columns = DMatrix::from_fn(8, 2, |i, k| 2.0 * wave(31 + 7 * i + k + launch));
            let noise = DVector::from_fn(8, |i, _| 1.4 * wave(5 * i * i + 97 * launch));
            let block = SegmentBlock {
                segment: launch,
                residual: noise + columns.column(0) * wave(11 * launch),
                gp_variance: DVector::zeros(8),
                z_group: columns.columns(0, 1).into_owned(),
                z_group_effects: vec![RandomEffect::Acceleration(0)],
                jacobian: columns,
                z_segment: DMatrix::zeros(8, 0),
                z_segment_effects: Vec::new(),
                log_det_noise: 0.0,
            };
            Group { trial: launch, blocks: vec![block], has_random_effects: true }
        };
        (0..8).map(part).collect()
    }

    /// The walk's draws of a component that the data determine match a sum over its grid; those of one that they do not match
    /// its prior.
    #[test]
    fn components_are_drawn_as_they_may_be() {
        let parts = parts();
        let start = VarianceComponents::initial(false);
        let mut likely = ComponentLikelihood::new(&parts, &start);
        assert!(likely.depends_on_components());
        let drawn = likely.sample(4000, &mut rng::stream(2, "test"));
        let moments = |values: &[f64], weights: &[f64]| {
            let all: f64 = weights.iter().sum();
            let mean = values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>() / all;
            let square = values.iter().zip(weights).map(|(v, w)| (v - mean).powi(2) * w).sum::<f64>();
            [mean, (square / all).sqrt()]
        };
        let even = vec![1.0; drawn.len()];
        let found = moments(&drawn.iter().map(|c| c.accelerations[0].ln()).collect::<Vec<_>>(), &even);
        // Where the walk comes by.
        let begun = start.accelerations[0].ln();
        let grid: Vec<f64> = (-60..60)
            .map(|i| begun + MIN_STEP * f64::from(i))
            .filter(|l| *l <= MAX_ACCELERATION_SD.ln())
            .collect();
        let at = |l: f64| {
            let mut logs = start.log_values();
            logs[2] = l;
            logs
        };
        let of = |l: &f64| likely.log_densities(&at(*l)).iter().sum::<f64>() + start.log_prior(&at(*l));
        let logs: Vec<f64> = grid.iter().map(of).collect();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let wanted = moments(&grid, &logs.iter().map(|l| (l - most).exp()).collect::<Vec<_>>());
        assert!((found[0] - wanted[0]).abs() < 0.1 * wanted[1], "{found:?} for {wanted:?}");
        assert!((found[1] / wanted[1] - 1.0).abs() < 0.1, "{found:?} for {wanted:?}");
        assert!(wanted[1] < 0.8, "the parts tell the push: {wanted:?}");
        let slow = moments(&drawn.iter().map(|c| c.discrepancy.ln()).collect::<Vec<_>>(), &even);
        assert!(
            (slow[0] - LOG_DISCREPANCY_PRIOR[0]).abs() < 0.3
                && (slow[1] - LOG_DISCREPANCY_PRIOR[1]).abs() < 0.3,
            "{slow:?}"
        );
    }

    /// Windows that start from what is known whole, without slow misfit, depend on no component.
    #[test]
    fn what_does_not_differ_depends_on_none() {
        let alike: Vec<Group> =
            parts().into_iter().map(|p| Group { has_random_effects: false, ..p }).collect();
        assert!(
            !ComponentLikelihood::new(&alike, &VarianceComponents::initial(false)).depends_on_components()
        );
    }

    /// What a search steps along is what the components are, and a model without strengths has no step for one.
    #[test]
    fn components_go_through_their_logarithms() {
        for (strengths, count) in
            [(false, 2 + nuisance_accelerations().len()), (true, 3 + nuisance_accelerations().len())]
        {
            let start = VarianceComponents::initial(strengths);
            let mut logs = start.log_values();
            assert_eq!(logs.len(), count);
            assert!((start.log_prior(&logs) - start.log_prior(&start.log_values())).abs() < 1e-12);
            (0..count).for_each(|k| logs[k] += 0.1 * (1 + k) as f64);
            let moved = start.with_log_values(&logs);
            assert!(moved.log_values().iter().zip(&logs).all(|(a, b)| (a - b).abs() < 1e-12));
            assert_eq!(moved.scale > 0.0, strengths);
        }
    }
}
