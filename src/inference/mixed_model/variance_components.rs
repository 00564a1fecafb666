//! Estimation of variance components.
//!
//! The logarithms of the components are optimised by pattern search (Hooke and Jeeves, J. ACM 8 (1961) 212),
//! and sampled by random-walk Metropolis (Metropolis et al., J. Chem. Phys. 21 (1953) 1087). Cross products
//! and densities are cached by the components on which they depend; held-out folds start alike and share most
//! of them.

use std::collections::HashMap;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::error::Result;
use crate::inference::mixed_model::group_statistics::{CrossProducts, GroupProducts, VarianceComponents};
use crate::inference::mixed_model::groups::Group;
use crate::inference::mixed_model::random_design::{RandomEffect, nuisance_accelerations};
use crate::progress::Progress;
use crate::rng::Stream;

/// Initial steps in the logarithms: of a first search, of a warm start, and of a restart.
pub const INITIAL_STEP: f64 = 1.4;
pub const WARM_STEP: f64 = 0.4;
pub const RESTART_STEP: f64 = 0.2;
/// Minimum and maximum step; factors after a successful and a failed step.
const MIN_STEP: f64 = 0.1;
const MAX_STEP: f64 = 1.4;
const STEP_GROWTH: f64 = 1.5;
const STEP_SHRINKAGE: f64 = 0.4;
/// Normal priors of the logarithms (mean, standard deviation): discrepancy as large as the noise;
/// accelerations of a third of the declared standard deviation; impact errors of a hundredth of the approach
/// speed.
const LOG_DISCREPANCY_PRIOR: [f64; 2] = [0.0, 2.0];
const LOG_ACCELERATION_PRIOR: [f64; 2] = [-1.2, 1.2];
const LOG_IMPACT_PRIOR: [f64; 2] = [-4.6, 1.0];
/// Scale of effects: about a seventh.
const LOG_SCALE_PRIOR: [f64; 2] = [-1.9, 1.2];
/// Upper bounds: relative standard deviation of an effect's scale, and of accelerations in declared standard
/// deviations. A model that needs more is misspecified.
pub const MAX_SCALE_SD: f64 = 0.2;
pub const MAX_ACCELERATION_SD: f64 = 2.0;
/// Gain of a search, nats, below which it is the last; maximum number of searches.
const GAIN_TOLERANCE: f64 = 0.05;
const MAX_SEARCHES: usize = 4;
/// Metropolis sampling: sweeps of burn-in, thinning, and the range of proposal standard deviations,
/// log-uniform.
const BURN_IN: usize = 60;
const THINNING: usize = 12;
const PROPOSAL_SD: [f64; 2] = [0.2, 2.0];

impl VarianceComponents {
    /// Initial values; `strengths`: whether the model has effects with a random scale.
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

    /// Upper bounds of the logarithms.
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

/// Likelihood of the components at a fixed linearization of a model, nuisances projected out.
pub struct ComponentLikelihood<'a> {
    groups: &'a [Group],
    initial: VarianceComponents,
    /// Cached by the discrepancy component, and by the components of segments.
    cross_products: HashMap<u64, Vec<CrossProducts>>,
    segment_effects: Vec<RandomEffect>,
    group_products: HashMap<Vec<u64>, Vec<Option<GroupProducts>>>,
    log_densities: HashMap<Vec<u64>, Vec<f64>>,
}

impl<'a> ComponentLikelihood<'a> {
    /// `from`: initial components.
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

    /// Most probable components within their upper bounds; `first`: initial step.
    pub fn maximise(&mut self, first: f64, progress: &dyn Progress) -> Result<VarianceComponents> {
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
                    progress.check_stop()?;
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
        Ok(from.with_log_values(&logs))
    }

    /// Draws from the posterior of the components within their upper bounds. Proposals lie on a lattice of
    /// the minimum step, so that cached densities are reused.
    pub fn sample(
        &mut self,
        count: usize,
        stream: &mut Stream,
        progress: &dyn Progress,
    ) -> Result<Vec<VarianceComponents>> {
        let (from, matter) = (self.initial.clone(), self.active_components());
        let most = from.log_upper_bounds();
        let begun: Vec<f64> = from.log_values().iter().zip(&most).map(|(l, most)| l.min(*most)).collect();
        let mut steps = vec![0.0; begun.len()];
        let at =
            |steps: &[f64]| -> Vec<f64> { begun.iter().zip(steps).map(|(l, n)| l + MIN_STEP * n).collect() };
        let quality = |own: &mut ComponentLikelihood, logs: &[f64]| {
            own.log_densities(logs).iter().sum::<f64>() + from.log_prior(logs)
        };
        let mut current = quality(self, &begun);
        let mut out = Vec::with_capacity(count);
        for round in 1..=BURN_IN + THINNING * count {
            for k in (0..begun.len()).filter(|k| matter[*k]) {
                progress.check_stop()?;
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
                let candidate = quality(self, &logs);
                if libm::log(u) < candidate - current {
                    (current, steps) = (candidate, moved);
                }
            }
            if round > BURN_IN && (round - BURN_IN).is_multiple_of(THINNING) {
                out.push(from.with_log_values(&at(&steps)));
            }
        }
        Ok(out)
    }

    /// Whether the likelihood depends on any component.
    pub fn depends_on_components(&self) -> bool {
        let own = |group: &Group| {
            group
                .blocks
                .iter()
                .any(|b| !b.z_segment_effects.is_empty() || b.gp_variance.iter().any(|slow| *slow > 0.0))
        };
        self.groups.iter().any(|group| group.has_random_effects || own(group))
    }

    /// Mask of the components on which the likelihood depends.
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

    /// Log densities of all groups.
    fn log_densities(&mut self, logs: &[f64]) -> &[f64] {
        let key: Vec<u64> = logs.iter().map(|l| l.to_bits()).collect();
        let groups = self.groups;
        self.log_densities.entry(key).or_insert_with(|| {
            let own = self.initial.with_log_values(logs);
            let of = |p| CrossProducts::of(p, &[], own.discrepancy);
            let weighed = self.cross_products.entry(own.discrepancy.to_bits());
            let weighed = weighed.or_insert_with(|| groups.iter().map(of).collect());
            let kinds = self.segment_effects.iter().map(|kind| own.sd_of(*kind)).chain([own.discrepancy]);
            let with_own = |(w, p): (&CrossProducts, &Group)| w.with_segment_effects(p, &own);
            let summed = self.group_products.entry(kinds.map(f64::to_bits).collect());
            let summed = summed.or_insert_with(|| weighed.iter().zip(groups).map(with_own).collect());
            let density = |(s, p): (&Option<GroupProducts>, &Group)| s.as_ref()?.log_density(p, &own);
            summed.iter().zip(groups).map(density).map(|d| d.unwrap_or(f64::NEG_INFINITY)).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::mixed_model::groups::SegmentBlock;
    use crate::progress::NoProgress;
    use crate::rng;
    use nalgebra::{DMatrix, DVector};

    /// Trials of one segment each, with a random acceleration.
    fn parts() -> Vec<Group> {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.3);
        let group = |trial: usize| {
            let columns = DMatrix::from_fn(8, 2, |i, k| 2.0 * wave(31 + 7 * i + k + trial));
            let noise = DVector::from_fn(8, |i, _| 1.4 * wave(5 * i * i + 97 * trial));
            let block = SegmentBlock {
                segment: trial,
                residual: noise + columns.column(0) * wave(11 * trial),
                gp_variance: DVector::zeros(8),
                z_group: columns.columns(0, 1).into_owned(),
                z_group_effects: vec![RandomEffect::Acceleration(0)],
                jacobian: columns,
                z_segment: DMatrix::zeros(8, 0),
                z_segment_effects: Vec::new(),
                nuisances: DMatrix::zeros(8, 0),
                log_det_noise: 0.0,
            };
            Group { trial, blocks: vec![block], has_random_effects: true }
        };
        (0..8).map(group).collect()
    }

    /// Draws match quadrature for an identified component, and the prior for one that is not.
    #[test]
    fn sampled_components_match_quadrature() {
        let groups = parts();
        let start = VarianceComponents::initial(false);
        let mut likely = ComponentLikelihood::new(&groups, &start);
        assert!(likely.depends_on_components());
        let drawn = likely.sample(4000, &mut rng::stream(2, "test"), &NoProgress).unwrap();
        let moments = |values: &[f64], weights: &[f64]| {
            let all: f64 = weights.iter().sum();
            let mean = values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>() / all;
            let square = values.iter().zip(weights).map(|(v, w)| (v - mean).powi(2) * w).sum::<f64>();
            [mean, (square / all).sqrt()]
        };
        let even = vec![1.0; drawn.len()];
        let found = moments(&drawn.iter().map(|c| c.accelerations[0].ln()).collect::<Vec<_>>(), &even);
        // The lattice of the proposals.
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
        let expected = moments(&grid, &logs.iter().map(|l| (l - most).exp()).collect::<Vec<_>>());
        assert!((found[0] - expected[0]).abs() < 0.1 * expected[1], "{found:?} for {expected:?}");
        assert!((found[1] / expected[1] - 1.0).abs() < 0.1, "{found:?} for {expected:?}");
        assert!(expected[1] < 0.8, "the parts tell the push: {expected:?}");
        let slow = moments(&drawn.iter().map(|c| c.discrepancy.ln()).collect::<Vec<_>>(), &even);
        assert!(
            (slow[0] - LOG_DISCREPANCY_PRIOR[0]).abs() < 0.3
                && (slow[1] - LOG_DISCREPANCY_PRIOR[1]).abs() < 0.3,
            "{slow:?}"
        );
    }

    /// Fully observed segments without discrepancy depend on no component.
    #[test]
    fn groups_without_random_effects_depend_on_no_component() {
        let alike: Vec<Group> =
            parts().into_iter().map(|p| Group { has_random_effects: false, ..p }).collect();
        assert!(
            !ComponentLikelihood::new(&alike, &VarianceComponents::initial(false)).depends_on_components()
        );
    }

    /// Components and their logarithms are equivalent; models without random scales have no logarithm for
    /// them.
    #[test]
    fn components_and_logarithms_are_equivalent() {
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
