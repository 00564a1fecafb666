//! Parameters of a model: latents to calibrate, and the coefficients of effect terms.

use crate::inference::dynamics::SegmentPhysics;
use crate::inference::segment::Segment;
use crate::task::scene::EffectTerm;
use crate::world::Latents;
use crate::world::effect::{Effect, EffectTarget, ParameterDeclaration};
use crate::world::latent::FACTORS;

/// Finite-difference step of a latent.
const LATENT_FD_STEP: f64 = 2e-3;

/// The parameter vector of a model.
#[derive(Clone)]
pub struct ParameterLayout {
    pub terms: Vec<Term>,
    /// Parameters, latents first.
    pub parameters: Vec<Parameter>,
}

/// An effect as a term of a model.
#[derive(Clone)]
pub struct Term {
    pub effect: &'static Effect,
    /// Whether every setting has values of its own.
    pub per_setting: bool,
    /// Initial values, in the registry's order.
    pub start: Vec<f64>,
    /// Which parameters are fitted.
    pub free: Vec<bool>,
    /// Finite-difference step of the fitted parameters; the registry's by default.
    pub fd_step: Option<f64>,
    /// Of a stepwise parameter, which is not fitted.
    pub bracket: Option<Bracket>,
}

/// The values of a stepwise parameter that predict the same.
#[derive(Clone, Copy, Debug)]
pub struct Bracket {
    pub interval: [f64; 2],
    /// Number of intervals that the data distinguish.
    pub count: usize,
}

/// An estimated parameter.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    pub kind: ParameterKind,
    /// The setting it applies to; all if `None`.
    pub setting: Option<usize>,
    pub bounds: [f64; 2],
    /// Finite-difference step.
    pub fd_step: f64,
    /// Whether the value is fixed.
    pub is_fixed: bool,
    /// Precision of a normal prior with mean zero in least squares; 0 for a flat prior.
    pub prior_precision: f64,
}

/// Kind of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKind {
    /// Latent factor, by index.
    Latent(usize),
    /// Coefficient of an effect: indices of the term and of its parameter.
    EffectParameter(usize, usize),
}

impl ParameterLayout {
    /// Layout of latents (indices of factors) and terms; `settings`: number of settings.
    pub fn new(latents: &[usize], terms: Vec<Term>, settings: usize) -> ParameterLayout {
        let latent = |l: &usize| Parameter {
            kind: ParameterKind::Latent(*l),
            setting: None,
            bounds: FACTORS[*l].bounds,
            fd_step: LATENT_FD_STEP,
            is_fixed: false,
            prior_precision: 0.0,
        };
        let mut parameters: Vec<Parameter> = latents.iter().map(latent).collect();
        for (t, term) in terms.iter().enumerate() {
            for (p, parameter) in term.effect.parameters.iter().enumerate().filter(|(p, _)| term.free[*p]) {
                let slot = |setting| Parameter {
                    kind: ParameterKind::EffectParameter(t, p),
                    setting,
                    bounds: parameter.bounds,
                    fd_step: term.fd_step.unwrap_or(parameter.fd_step),
                    is_fixed: false,
                    prior_precision: 0.0,
                };
                match term.per_setting {
                    true => parameters.extend((0..settings).map(|s| slot(Some(s)))),
                    false => parameters.push(slot(None)),
                }
            }
        }
        ParameterLayout { terms, parameters }
    }

    /// Initial values: the scene's latents and those of the terms.
    pub fn initial_values(&self, latents: &[f64; 3]) -> Vec<f64> {
        let value = |s: &Parameter| match s.kind {
            ParameterKind::Latent(l) => latents[l],
            ParameterKind::EffectParameter(t, p) => self.terms[t].start[p],
        };
        self.parameters.iter().map(value).collect()
    }

    /// Number of latents; they come first.
    pub fn latent_count(&self) -> usize {
        self.parameters.iter().filter(|s| matches!(s.kind, ParameterKind::Latent(_))).count()
    }

    /// Declaration of an effect's coefficient; `None` for a latent.
    pub fn declaration(&self, slot: usize) -> Option<&'static ParameterDeclaration> {
        match self.parameters[slot].kind {
            ParameterKind::EffectParameter(t, p) => Some(&self.terms[t].effect.parameters[p]),
            ParameterKind::Latent(_) => None,
        }
    }

    /// Whether a parameter is a shape parameter, no amplitude.
    pub fn is_shape(&self, slot: usize) -> bool {
        self.declaration(slot).is_some_and(|p| !p.is_amplitude())
    }

    /// Whether predictions are discontinuous in a parameter: it is an edge of a region.
    pub fn is_discontinuous(&self, slot: usize) -> bool {
        self.declaration(slot).is_some_and(ParameterDeclaration::is_edge)
    }

    /// Whether predictions are discontinuous in any parameter.
    pub fn has_discontinuities(&self) -> bool {
        (0..self.parameters.len()).any(|i| self.is_discontinuous(i))
    }

    /// Parameters of a term.
    pub fn parameters_of_term(&self, term: usize) -> Vec<usize> {
        (0..self.parameters.len())
            .filter(|i| matches!(self.parameters[*i].kind, ParameterKind::EffectParameter(t, _) if t == term))
            .collect()
    }

    /// For every term with amplitudes that may vary between trials, which masses and moments of inertia do not: their parameters and
    /// the derivative of each by the relative change of its deviation in the prior's coordinate. `gravity`: of the scene, m/s^2.
    pub fn amplitude_directions(&self, values: &[f64], gravity: f64) -> Vec<Vec<(usize, f64)>> {
        let of = |t: usize| {
            let amplitudes = self.parameters_of_term(t).into_iter().filter(|i| !self.is_shape(*i));
            let size = |i: usize| {
                let deviation = self.declaration(i).map(|p| p.prior_deviation(values[i], gravity));
                (i, deviation.map_or(0.0, |[size, slope]| size / slope))
            };
            let mut free = (0..self.terms[t].free.len())
                .filter(|p| self.terms[t].free[*p] && self.terms[t].effect.parameters[*p].is_amplitude());
            free.next().map(|_| amplitudes.map(size).collect())
        };
        let varies = |t: &usize| self.terms[*t].effect.target() != EffectTarget::Body;
        (0..self.terms.len()).filter(varies).filter_map(of).collect()
    }

    /// Parameter values of every term, and latents, for a setting.
    pub fn values_by_term(&self, values: &[f64], setting: usize) -> (Vec<Vec<f64>>, Latents) {
        let mut latents = [None; 3];
        let mut numbers: Vec<Vec<f64>> = self.terms.iter().map(|t| t.start.clone()).collect();
        for (slot, value) in self.parameters.iter().zip(values) {
            if slot.setting.is_some_and(|s| s != setting) {
                continue;
            }
            match slot.kind {
                ParameterKind::Latent(l) => latents[l] = Some(*value),
                ParameterKind::EffectParameter(t, p) => numbers[t][p] = *value,
            }
        }
        (numbers, Latents { density: latents[0], friction: latents[1], restitution: latents[2] })
    }

    /// Effects and latents for a setting, with the clock shifted to a segment's start.
    pub fn effects_and_latents(
        &self,
        values: &[f64],
        setting: usize,
        clock: f64,
    ) -> (Vec<EffectTerm>, Latents) {
        let (numbers, latents) = self.values_by_term(values, setting);
        let of = |(term, numbers): (&Term, &Vec<f64>)| term.effect.term_at_clock(numbers, clock);
        (self.terms.iter().zip(&numbers).map(of).collect(), latents)
    }

    /// Physics of a segment, with additional effects.
    pub fn segment_physics<'a>(
        &self,
        segment: &'a Segment,
        values: &[f64],
        besides: &[(&'static Effect, Vec<f64>)],
    ) -> SegmentPhysics<'a> {
        let (numbers, latents) = self.values_by_term(values, segment.setting);
        let own = self.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice()));
        let besides = besides.iter().map(|(effect, n)| (*effect, n.as_slice()));
        SegmentPhysics::new(segment, &own.chain(besides).collect::<Vec<_>>(), &latents)
    }
}

impl Parameter {
    /// Index of the latent factor; `None` for a coefficient.
    pub fn latent(&self) -> Option<usize> {
        match self.kind {
            ParameterKind::Latent(l) => Some(l),
            ParameterKind::EffectParameter(..) => None,
        }
    }

    /// Whether a bound is active: the value is at the bound and the gradient points outwards.
    pub fn is_at_active_bound(&self, value: f64, acceleration: f64) -> bool {
        (value <= self.bounds[0] && acceleration < 0.0) || (value >= self.bounds[1] && acceleration > 0.0)
    }

    /// Minimum information: that of one noise standard deviation over the range of the parameter.
    pub fn min_information(&self) -> f64 {
        let most = if matches!(self.kind, ParameterKind::Latent(_)) { 2.0 } else { 1e3 };
        (self.bounds[1] - self.bounds[0]).min(most).powi(-2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    fn term(name: &str, per_setting: bool, free: &[bool]) -> Term {
        let effect = find(name).unwrap();
        let start = effect.parameters.iter().map(|p| p.neutral).collect();
        Term { effect, per_setting, start, free: free.to_vec(), fd_step: None, bracket: None }
    }

    /// Friction, a wind by setting of which only x is fitted, and drag.
    fn layout() -> ParameterLayout {
        let mut wind = term("wind", true, &[true, false]);
        wind.start[1] = 0.5;
        ParameterLayout::new(&[1], vec![wind, term("quadratic_drag", false, &[true])], 2)
    }

    #[test]
    fn settings_have_separate_values() {
        let layout = layout();
        assert_eq!((layout.parameters.len(), layout.latent_count()), (4, 1));
        assert_eq!((layout.parameters_of_term(0), layout.parameters_of_term(1)), (vec![1, 2], vec![3]));
        for (setting, wind) in [(0, 0.1), (1, 0.2)] {
            let (numbers, latents) = layout.values_by_term(&[0.7, 0.1, 0.2, 0.03], setting);
            assert_eq!(numbers, [vec![wind, 0.5], vec![0.03]]);
            assert_eq!((latents.density, latents.friction), (None, Some(0.7)));
        }
        assert_eq!(layout.initial_values(&[9.0, 0.4, 9.0]), [0.4, 0.0, 0.0, 0.0]);
    }

    /// Directions hold amplitudes only, no shape parameters.
    #[test]
    fn amplitude_directions_exist_for_every_term() {
        let terms = vec![term("quadratic_drag", false, &[true]), term("gust", false, &[true; 4])];
        let layout = ParameterLayout::new(&[], terms, 1);
        assert_eq!(
            layout.amplitude_directions(&[0.1, 0.4, -0.3, 2.0, 0.5], 9.81),
            [vec![(0, 0.1)], vec![(1, 0.4), (2, -0.3)]]
        );
        let layout = ParameterLayout::new(&[], vec![term("quadratic_drag", false, &[false])], 1);
        assert!(layout.amplitude_directions(&[], 9.81).is_empty());
        let layout = ParameterLayout::new(&[], vec![term("mass_ratio", false, &[true])], 1);
        assert!(layout.amplitude_directions(&[1.2], 9.81).is_empty(), "a mass does not vary between trials");
    }

    /// A later start shifts a gust's phase.
    #[test]
    fn effects_use_the_trial_clock() {
        let layout = ParameterLayout::new(&[], vec![term("gust", false, &[true; 4])], 1);
        let phase =
            |clock: f64| layout.effects_and_latents(&[1.0, 0.0, 2.0, 0.5], 0, clock).0[0].parameters["phase"];
        assert!((phase(0.0) - 0.5).abs() < 1e-12);
        assert!((phase(0.5) - (0.5 + std::f64::consts::FRAC_PI_2)).abs() < 1e-12);
    }
}
