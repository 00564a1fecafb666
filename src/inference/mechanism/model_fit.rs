//! Fit of a set of effects to a recording of a mechanism, with its evidence: the statistics of `mixed_model` and `selection` on
//! segments of joint positions.

use nalgebra::{DMatrix, DVector};

use super::discrepancy::JointDiscrepancy;
use super::linearization::{JointLinearization, Slot, Terms, declaration, slots};
use super::recording::JointRecording;
use crate::error::{Error, Result};
use crate::inference::mixed_model::coordinates::{orthonormalise, project_out};
use crate::inference::mixed_model::group_statistics::{
    GroupStatistics, VarianceComponents, group_statistics,
};
use crate::inference::mixed_model::groups::{Group, SegmentBlock};
use crate::inference::mixed_model::random_design::RandomEffect;
use crate::inference::selection::{FixedEffectsPrior, Laplace, marginal_evidence, profile_log_posterior};
use crate::inference::statistics::median;
use crate::progress::Progress;
use crate::world::mechanism::JointTerm;

/// Maximum number of Gauss-Newton steps, halvings of a step that decreases the posterior, and convergence tolerance, nats.
const MAX_STEPS: usize = 12;
const MAX_HALVINGS: usize = 3;
const TOLERANCE: f64 = 0.05;
/// Maximum number of steps of initial states alone, and of searches of states in a fit; relative decrease of squares below which they
/// end, and the factor of a step after a failure.
const MAX_STATE_STEPS: usize = 12;
const MAX_STATE_UPDATES: usize = 3;
const STATE_TOLERANCE: f64 = 1e-3;
const STATE_STEP_SHRINKAGE: f64 = 0.3;
/// Decrease of a segment's squares, in units of the noise, that a step of its states promises, from which they are searched.
const STATE_PROMISE: f64 = 1.0;
/// Squares of a segment, relative to the median, from which its states are searched anew.
const OUTLIER_RATIO: f64 = 3.0;
/// Maximum number of failures of such a step one after the other.
const MAX_STATE_FAILURES: usize = 3;

/// Estimates and data that all sets of effects share.
pub struct JointContext<'a, 'b> {
    pub recording: &'b JointRecording<'a>,
    pub discrepancy: Option<JointDiscrepancy>,
    pub components: VarianceComponents,
    pub progress: &'b dyn Progress,
}

/// A fitted set of effects.
pub struct JointFit {
    pub terms: Terms,
    /// Initial states by segment.
    pub states: Vec<Vec<f64>>,
    pub log_evidence: f64,
    pub laplace: Laplace,
    pub prior: FixedEffectsPrior,
    pub groups: Vec<Group>,
    pub statistics: Vec<GroupStatistics>,
    /// Whether a parameter is at a bound that the data would cross.
    pub is_at_bound: bool,
}

impl JointFit {
    /// Whether it has all effects of a smaller fit.
    pub fn contains(&self, small: &JointFit) -> bool {
        let has =
            |t: &JointTerm| self.terms.iter().any(|l| l.joint == t.joint && l.effect.name == t.effect.name);
        self.terms.len() > small.terms.len() && small.terms.iter().all(has)
    }
}

/// A point of the fit.
struct JointIterate {
    terms: Terms,
    states: Vec<Vec<f64>>,
    linearizations: Vec<JointLinearization>,
    groups: Vec<Group>,
    statistics: Vec<GroupStatistics>,
    prior: FixedEffectsPrior,
    laplace: Laplace,
    log_posterior: f64,
}

impl JointIterate {
    /// Log evidence of what was reached: less what a step that remains promises.
    fn log_evidence(&self) -> f64 {
        self.laplace.log_evidence - (self.laplace.log_joint - self.log_posterior).max(0.0)
    }
}

impl JointContext<'_, '_> {
    /// Fits terms from values and states; `None` if they cannot be simulated.
    pub fn fit(&self, terms: Terms, states: Vec<Vec<f64>>) -> Result<Option<JointFit>> {
        let Some(states) = self.best_states(&terms, states)? else { return Ok(None) };
        let Some(first) = self.evaluate(terms, states)? else { return Ok(None) };
        let mut best = self.converged(first)?;
        for _ in 0..MAX_STATE_UPDATES {
            // States that were found for other values may be in another optimum.
            let Some(states) = self.best_states(&best.terms, best.states.clone())? else { break };
            let Some(moved) = self.evaluate(best.terms.clone(), states)? else { break };
            let again = self.converged(moved)?;
            let gained = again.log_evidence() - best.log_evidence();
            if gained > 0.0 {
                best = again;
            }
            if gained < TOLERANCE {
                break;
            }
        }
        Ok(Some(self.fitted(best)))
    }

    /// The initial states that fit each segment best, from some states, and from the local polynomials for segments that then fit much
    /// worse than others; `None` if a segment cannot be simulated.
    fn best_states(&self, terms: &Terms, states: Vec<Vec<f64>>) -> Result<Option<Vec<Vec<f64>>>> {
        let every = (0..states.len()).collect();
        let (mut own, mut squares) = self.settled(terms, states, every)?;
        let outlier = OUTLIER_RATIO * median(&squares);
        let outliers: Vec<usize> =
            (0..own.len()).filter(|w| !squares[*w].is_finite() || squares[*w] > outlier).collect();
        let (fresh, others) = self.settled(terms, self.recording.initial_states(), outliers.clone())?;
        for w in outliers {
            if others[w] < squares[w] {
                (own[w], squares[w]) = (fresh[w].clone(), others[w]);
            }
        }
        Ok(squares.iter().all(|square| square.is_finite()).then_some(own))
    }

    /// The most probable point from another one, by Gauss-Newton steps of the parameters with damping, the initial states those that
    /// fit best.
    fn converged(&self, mut best: JointIterate) -> Result<JointIterate> {
        let (mut fraction, mut halvings) = (1.0, 0);
        for _ in 0..MAX_STEPS {
            let terms = self.stepped(&best, fraction);
            let candidate = self.evaluate_settled(terms.clone(), self.predicted_states(&best, &terms))?;
            // The step is one at the scale of the discrepancy at which the evidence is largest; that may differ after it.
            let gain = |c: &JointIterate| {
                profile_log_posterior(&c.statistics, &c.prior, best.laplace.scale) - best.log_posterior
            };
            match candidate.map(|c| (gain(&c), c)).filter(|(gained, _)| *gained > 0.0) {
                Some((gained, candidate)) => {
                    let is_settled = gained < TOLERANCE && candidate.laplace.scale == best.laplace.scale;
                    (best, halvings) = (candidate, 0);
                    fraction = f64::min(1.0, 2.0 * fraction);
                    if is_settled {
                        break;
                    }
                }
                None if halvings == MAX_HALVINGS => break,
                None => (fraction, halvings) = (0.4 * fraction, halvings + 1),
            }
        }
        Ok(best)
    }

    /// Evaluates terms with the initial states that fit best, from states near them. Segments that leave the linearization soon, as
    /// where a joint sticks and slips, promise by it more than their states can reach: these are searched.
    fn evaluate_settled(&self, terms: Terms, states: Vec<Vec<f64>>) -> Result<Option<JointIterate>> {
        let Some(first) = self.evaluate(terms, states)? else { return Ok(None) };
        let promise = |block: &SegmentBlock| {
            let segment = &self.recording.segments[block.segment];
            let residual = &first.linearizations[block.segment].residual;
            block.nuisances.tr_mul(&self.recording.white_column(segment, residual)).norm_squared()
        };
        let blocks = first.groups.iter().flat_map(|group| &group.blocks);
        let unsettled: Vec<usize> =
            blocks.filter(|block| promise(block) > STATE_PROMISE).map(|block| block.segment).collect();
        if unsettled.is_empty() {
            return Ok(Some(first));
        }
        let (found, squares) = self.settled(&first.terms, first.states.clone(), unsettled.clone())?;
        let mut states = first.states;
        for w in unsettled {
            if !squares[w].is_finite() {
                return Ok(None);
            }
            states[w].clone_from(&found[w]);
        }
        self.evaluate(first.terms, states)
    }

    /// Initial states that fit each segment best with other values of the parameters, by the linearization.
    fn predicted_states(&self, from: &JointIterate, terms: &Terms) -> Vec<Vec<f64>> {
        let value = |terms: &Terms, slot: &Slot| terms[slot.term].values[slot.parameter];
        let change: Vec<f64> =
            slots(terms).iter().map(|slot| value(terms, slot) - value(&from.terms, slot)).collect();
        let change = DVector::from_vec(change);
        let of = |(w, own): (usize, &JointLinearization)| {
            let segment = &self.recording.segments[w];
            let residual = &own.residual - &own.jacobian * &change;
            let right = self.recording.white_column(segment, &residual);
            let step = self.recording.state_step(segment, &own.nuisances, &right);
            from.states[w].iter().zip(step.iter()).map(|(state, by)| state + by).collect()
        };
        from.linearizations.iter().enumerate().map(of).collect()
    }

    /// Initial states that fit some segments best, by Gauss-Newton steps with damping, and the squares.
    fn settled(
        &self,
        terms: &Terms,
        mut states: Vec<Vec<f64>>,
        mut active: Vec<usize>,
    ) -> Result<(Vec<Vec<f64>>, Vec<f64>)> {
        let recording = self.recording;
        // By segment: the best square and states, and the step from there with its fraction.
        let mut best: Vec<(f64, Vec<f64>)> = states.iter().map(|s| (f64::INFINITY, s.clone())).collect();
        let mut steps: Vec<(DVector<f64>, f64)> =
            states.iter().map(|s| (DVector::zeros(s.len()), 1.0)).collect();
        let mut failures = vec![0; states.len()];
        for _ in 0..MAX_STATE_STEPS {
            self.progress.check_stop()?;
            let mut unsettled = Vec::with_capacity(active.len());
            for (w, own) in active.iter().copied().zip(recording.linearise_states(terms, &states, &active)) {
                let segment = &recording.segments[w];
                let right = recording.white_column(segment, &own.residual);
                let (square, step) = (right.norm_squared(), &mut steps[w]);
                if square < best[w].0 {
                    if square < (1.0 - STATE_TOLERANCE) * best[w].0 {
                        unsettled.push(w);
                    }
                    failures[w] = 0;
                    best[w] = (square, states[w].clone());
                    *step = (recording.state_step(segment, &own.nuisances, &right), 1.0);
                } else {
                    step.1 *= STATE_STEP_SHRINKAGE;
                    failures[w] += 1;
                    if failures[w] < MAX_STATE_FAILURES {
                        unsettled.push(w);
                    }
                }
                states[w] = best[w].1.iter().zip(step.0.iter()).map(|(s, by)| s + step.1 * by).collect();
            }
            active = unsettled;
            if active.is_empty() {
                break;
            }
        }
        Ok(best.into_iter().map(|(square, state)| (state, square)).unzip())
    }

    /// Log evidence of terms at values and states, by one linearization: what a fit promises.
    pub fn promise(&self, terms: Terms, states: &[Vec<f64>]) -> Result<Option<f64>> {
        Ok(self.evaluate(terms, states.to_vec())?.map(|iterate| iterate.laplace.log_evidence))
    }

    fn evaluate(&self, terms: Terms, states: Vec<Vec<f64>>) -> Result<Option<JointIterate>> {
        self.progress.check_stop()?;
        let Some(linearizations) = self.recording.linearise(&terms, &states) else { return Ok(None) };
        let groups = self.groups(&terms, &linearizations);
        let Some(statistics) = group_statistics(&groups, &self.components, self.progress)? else {
            return Ok(None);
        };
        let prior = self.prior(&terms);
        let Some(laplace) = marginal_evidence(&statistics, &prior) else { return Ok(None) };
        let log_posterior = profile_log_posterior(&statistics, &prior, laplace.scale);
        Ok(Some(JointIterate {
            terms,
            states,
            linearizations,
            groups,
            statistics,
            prior,
            laplace,
            log_posterior,
        }))
    }

    /// Prior of the terms' parameters, relative to their values.
    pub fn prior(&self, terms: &Terms) -> FixedEffectsPrior {
        let slots = slots(terms);
        let mut out = FixedEffectsPrior::none();
        out.precision = DMatrix::zeros(slots.len(), slots.len());
        out.mean_offset = DVector::zeros(slots.len());
        for (k, slot) in slots.iter().enumerate() {
            let own = declaration(terms, *slot);
            out.precision[(k, k)] = self.recording.plausible(terms, *slot).powi(-2);
            out.mean_offset[k] = own.neutral - terms[slot.term].values[slot.parameter];
        }
        out
    }

    /// Groups by trial: columns of the parameters, then of the shared discrepancy.
    pub fn groups(&self, terms: &Terms, linearizations: &[JointLinearization]) -> Vec<Group> {
        let mut out: Vec<Group> = Vec::new();
        for (w, own) in linearizations.iter().enumerate() {
            let trial = self.recording.segments[w].trial;
            let block = self.block(w, terms, own);
            match out.last_mut() {
                Some(last) if last.trial == trial => last.blocks.push(block),
                _ => out.push(Group { trial, blocks: vec![block], has_random_effects: true }),
            }
        }
        out
    }

    fn block(&self, w: usize, terms: &Terms, own: &JointLinearization) -> SegmentBlock {
        let (recording, segment) = (self.recording, &self.recording.segments[w]);
        let (nuisances, _) = orthonormalise(&recording.white(segment, &own.nuisances));
        let project_white = |white: &DMatrix<f64>| project_out(&nuisances, white);
        let project = |columns: &DMatrix<f64>| project_white(&recording.white(segment, columns));
        let parameters = project(&own.jacobian);
        let residual = project(&DMatrix::from_column_slice(own.residual.len(), 1, own.residual.as_slice()));
        let rows = parameters.nrows();
        let shared = self.discrepancy.as_ref().map(|d| project_white(&d.responses[w]));
        let constant = self.discrepancy.as_ref().map(|d| project_white(&d.constant[w]));
        let columns = |m: &Option<DMatrix<f64>>| m.as_ref().map_or(0, |m| m.ncols());
        let mut jacobian = parameters.clone().resize_horizontally(parameters.ncols() + columns(&shared), 0.0);
        if let Some(shared) = &shared {
            jacobian.columns_mut(parameters.ncols(), shared.ncols()).copy_from(shared);
        }
        // Differences between trials: a constant torque in each joint, and the size of each effect.
        let mut z_group = DMatrix::zeros(rows, columns(&constant) + terms.len());
        let mut z_group_effects = Vec::new();
        if let Some(constant) = &constant {
            z_group.columns_mut(0, constant.ncols()).copy_from(constant);
            z_group_effects.extend((0..constant.ncols()).map(|_| RandomEffect::Acceleration(0)));
        }
        for (k, slot) in slots(terms).iter().enumerate() {
            let off = terms[slot.term].values[slot.parameter] - declaration(terms, *slot).neutral;
            let mut column = z_group.column_mut(columns(&constant) + slot.term);
            column.axpy(off, &parameters.column(k), 1.0);
        }
        z_group_effects.extend(terms.iter().map(|_| RandomEffect::Scale));
        SegmentBlock {
            segment: w,
            residual: residual.column(0).into_owned(),
            gp_variance: recording.gp_variances(segment),
            jacobian,
            z_group,
            z_group_effects,
            z_segment: DMatrix::zeros(rows, 0),
            z_segment_effects: Vec::new(),
            nuisances,
            log_det_noise: 0.0,
        }
    }

    /// Terms after a fraction of the step to the mode.
    fn stepped(&self, from: &JointIterate, fraction: f64) -> Terms {
        let mut terms = from.terms.clone();
        for (k, slot) in slots(&from.terms).iter().enumerate() {
            let [low, high] = declaration(&terms, *slot).bounds;
            let value = &mut terms[slot.term].values[slot.parameter];
            *value = (*value + fraction * from.laplace.step[k]).clamp(low, high);
        }
        terms
    }

    fn fitted(&self, best: JointIterate) -> JointFit {
        let log_evidence = best.log_evidence();
        let JointIterate { terms, states, groups, statistics, prior, laplace, .. } = best;
        let slots = slots(&terms);
        let beyond = |(k, slot): (usize, &Slot)| {
            let (own, value) = (declaration(&terms, *slot), terms[slot.term].values[slot.parameter]);
            let sd = laplace.covariance[(k, k)].sqrt();
            let wanted = value + laplace.step[k];
            wanted < own.bounds[0] - 0.1 * sd || wanted > own.bounds[1] + 0.1 * sd
        };
        let is_at_bound = slots.iter().enumerate().any(beyond);
        JointFit { log_evidence, terms, states, laplace, prior, groups, statistics, is_at_bound }
    }
}

/// The error of a fit that must be possible.
pub fn not_simulable() -> Error {
    Error::Failed("the mechanism could not be simulated along the recording".into())
}
