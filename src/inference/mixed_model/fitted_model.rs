//! A model fitted to all trials: its parameters, evidence, held-out errors and random effects.

use nalgebra::{DMatrix, DVector};

use crate::distribution::t_quantile;
use crate::inference::mixed_model::group_statistics::{GroupStatistics, VarianceComponents};
use crate::inference::mixed_model::random_design::nuisance_accelerations;
use crate::inference::model::{FitEvaluation, FitState, Parameter, ParameterKind, ParameterLayout, Term};
use crate::inference::selection::FixedEffectsPrior;
use crate::world::effect::Effect;

/// A model fitted to all trials.
pub struct FittedModel {
    /// The effects, in the layout's order.
    pub effects: Vec<&'static Effect>,
    pub layout: ParameterLayout,
    pub state: FitState,
    pub evaluation: FitEvaluation,
    /// Held-out squares by trial in units of the noise, for prediction gains.
    pub held_out_squares: Vec<f64>,
    /// Change of the parameters without each trial.
    pub held_out_steps: Vec<DVector<f64>>,
    /// Log evidence, nats.
    pub log_evidence: f64,
    /// Log joint density at the fitted state, the shared discrepancy at its mode.
    pub log_joint: f64,
    /// Most probable standard deviation of the shared discrepancy, relative to its largest plausible one.
    pub discrepancy_scale: f64,
    /// Mode of the shared discrepancy's coefficients, relative to their largest plausible size; empty if it was fitted without.
    pub discrepancy_mode: DVector<f64>,
    /// Squared residuals by trial at the mode, in units of the noise, the shared discrepancy not subtracted.
    pub squares: Vec<f64>,
    /// Variance components.
    pub components: VarianceComponents,
    /// Posterior covariance of the parameters.
    pub covariance: DMatrix<f64>,
    /// Statistics of every group of observations about the parameters, at the variance components.
    pub group_statistics: Vec<GroupStatistics>,
    /// Prior relative to the fitted values.
    pub prior: FixedEffectsPrior,
    /// Of the scene, m/s^2.
    pub gravity: f64,
}

/// A fitted model for plots and for the extended scene.
#[derive(Clone, Copy)]
pub struct ModelView<'a> {
    pub layout: &'a ParameterLayout,
    pub state: &'a FitState,
    pub evaluation: &'a FitEvaluation,
}

impl FittedModel {
    /// View for plots and the extended scene.
    pub fn view(&self) -> ModelView<'_> {
        ModelView { layout: &self.layout, state: &self.state, evaluation: &self.evaluation }
    }

    /// Names, sorted.
    pub fn effect_names(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.effects.iter().map(|e| e.name).collect();
        names.sort_unstable();
        names
    }

    /// Whether an amplitude is at a bound of its range.
    pub fn is_at_bound(&self) -> bool {
        let is_stuck = |(i, slot): (usize, &Parameter)| {
            let value = self.state.values[i];
            let amplitude = self.layout.declaration(i).filter(|p| p.is_amplitude());
            amplitude.is_some_and(|p| slot.bounds.iter().any(|b| *b == value && *b != p.neutral))
        };
        self.layout.parameters.iter().enumerate().any(is_stuck)
    }

    /// Layout and initial state in which amplitudes bounded below by their neutral values may have either sign; those within
    /// one standard deviation of neutral start from below it. `None` if there is none of these.
    pub fn with_either_sign(&self) -> Option<(ParameterLayout, FitState)> {
        let (mut layout, mut state) = (self.layout.clone(), self.state.clone());
        let mut is_any = false;
        for i in 0..layout.parameters.len() {
            let Some(p) = self.layout.declaration(i).filter(|p| p.is_amplitude()) else { continue };
            let parameter = &mut layout.parameters[i];
            if parameter.bounds[0] == p.neutral {
                parameter.bounds[0] = p.neutral - (parameter.bounds[1] - p.neutral);
                if state.values[i] - p.neutral <= self.covariance[(i, i)].sqrt() {
                    is_any = true;
                    state.values[i] = p.neutral - p.fd_step;
                }
            }
        }
        is_any.then_some((layout, state))
    }

    /// Whether it contains all effects of another model.
    pub fn includes(&self, other: &FittedModel) -> bool {
        other.effects.iter().all(|e| self.effects.iter().any(|own| own.name == e.name))
    }

    /// Layout and initial state of this model with `more` terms.
    pub fn with_terms(
        &self,
        more: impl IntoIterator<Item = Term>,
        settings: usize,
    ) -> (ParameterLayout, FitState) {
        let latents: Vec<usize> = self.layout.parameters.iter().filter_map(Parameter::latent).collect();
        let terms = self.layout.terms.iter().cloned().chain(more).collect();
        let layout = ParameterLayout::new(&latents, terms, settings);
        let mut values = layout.initial_values(&[0.0; 3]);
        values[..self.state.values.len()].copy_from_slice(&self.state.values);
        (layout, FitState::new(values, self.state.nuisances.clone()))
    }

    /// Layout and values without one term.
    pub fn without_term(&self, term: usize, settings: usize) -> (ParameterLayout, Vec<f64>) {
        let latents: Vec<usize> = self.layout.parameters.iter().filter_map(Parameter::latent).collect();
        let mut terms = self.layout.terms.clone();
        terms.remove(term);
        let gone = self.layout.parameters_of_term(term);
        let used = self.state.values.iter().enumerate().filter(|(i, _)| !gone.contains(i));
        (ParameterLayout::new(&latents, terms, settings), used.map(|(_, v)| *v).collect())
    }

    /// Number of effect parameters; one of many settings counts once for comparisons between models.
    pub fn effect_parameter_count(&self) -> usize {
        self.layout.terms.iter().map(|t| t.free.iter().filter(|f| **f).count()).sum()
    }

    /// Half width of a parameter's 95 % interval; infinite if it is not identifiable.
    pub fn ci_half_width(&self, slot: usize) -> f64 {
        let information: f64 = self.group_statistics.iter().map(|t| t.gram[(slot, slot)]).sum();
        if information <= 0.0 {
            return f64::INFINITY;
        }
        self.t_quantile_95() * self.covariance[(slot, slot)].max(0.0).sqrt()
    }

    /// Quantile of Student's t for 95 % intervals.
    fn t_quantile_95(&self) -> f64 {
        t_quantile(0.05, (self.held_out_squares.len() as f64 - 1.0).max(1.0))
    }

    /// Squared residuals beyond those expected from noise, in units of the noise.
    pub fn excess_square(&self) -> f64 {
        let count: f64 = self.group_statistics.iter().map(|t| t.count).sum();
        (self.squares.iter().sum::<f64>() - count).max(0.0)
    }

    /// Between-trial standard deviation of a parameter, from the scale of its effect and its random
    /// acceleration; `None` if it does not vary.
    pub fn between_trial_sd(&self, slot: usize) -> Option<f64> {
        let strengths = self.layout.amplitude_directions(&self.state.values, self.gravity);
        let size = strengths.iter().flatten().find(|(i, _)| *i == slot).map_or(0.0, |(_, size)| *size);
        Some(self.acceleration_sd(slot).hypot(self.components.scale * size)).filter(|s| *s > 0.0)
    }

    /// Between-trial standard deviation of a parameter's random acceleration; 0 without one.
    pub fn acceleration_sd(&self, slot: usize) -> f64 {
        let own = (nuisance_accelerations().iter().zip(&self.components.accelerations)).find_map(
            |(acceleration, sd)| {
                let ParameterKind::EffectParameter(t, p) = self.layout.parameters[slot].kind else {
                    return None;
                };
                if acceleration.effect.name != self.layout.terms[t].effect.name {
                    return None;
                }
                let moved = acceleration.values[p] - acceleration.effect.parameters[p].neutral;
                (moved != 0.0).then(|| sd * moved.abs() / acceleration.unit)
            },
        );
        own.unwrap_or(0.0)
    }
}

/// Held-out square of all trials, in units of the noise.
pub fn held_out_square(fit: &FittedModel) -> f64 {
    fit.held_out_squares.iter().sum()
}
