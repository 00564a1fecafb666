//! Latents to calibrate and effect terms with their parameters, laid out as one vector of numbers.

use crate::discover::path::SegmentPhysics;
use crate::discover::window::Segment;
use crate::task::scene::EffectTerm;
use crate::world::Latents;
use crate::world::effect::{Effect, ParameterDeclaration};
use crate::world::latent::FACTORS;

/// Difference for derivatives by a latent.
const LATENT_FD_STEP: f64 = 2e-3;

/// Which numbers there are.
#[derive(Clone)]
pub struct ParameterLayout {
    pub terms: Vec<Term>,
    /// Latents first.
    pub parameters: Vec<Parameter>,
}

/// An effect in a candidate model.
#[derive(Clone)]
pub struct Term {
    pub effect: &'static Effect,
    /// Whether every setting has its own values.
    pub per_setting: bool,
    /// Starting values, in the registry's order.
    pub start: Vec<f64>,
    /// Which parameters are fitted.
    pub free: Vec<bool>,
    /// Difference for derivatives by what is fitted, where the library's usual one does not suit.
    pub fd_step: Option<f64>,
}

/// One number of the parameter vector.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    pub kind: ParameterKind,
    /// The setting it belongs to; all if none.
    pub setting: Option<usize>,
    pub bounds: [f64; 2],
    /// Difference for derivatives.
    pub fd_step: f64,
    /// Whether the value is held and not fitted.
    pub is_fixed: bool,
    /// Precision by which the value is believed to be about nothing, in fits by least squares; 0 where nothing is believed.
    pub prior_precision: f64,
}

/// What one number of the parameter vector stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKind {
    /// Index into the latent factors.
    Latent(usize),
    /// Term and parameter.
    EffectParameter(usize, usize),
}

impl ParameterLayout {
    /// Latents (indices of factors) and terms; `settings` is the number of settings.
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

    /// Values to start from: the scene's latents, the terms' own.
    pub fn initial_values(&self, latents: &[f64; 3]) -> Vec<f64> {
        let value = |s: &Parameter| match s.kind {
            ParameterKind::Latent(l) => latents[l],
            ParameterKind::EffectParameter(t, p) => self.terms[t].start[p],
        };
        self.parameters.iter().map(value).collect()
    }

    /// Number of latent slots; they come first.
    pub fn latent_count(&self) -> usize {
        self.parameters.iter().filter(|s| matches!(s.kind, ParameterKind::Latent(_))).count()
    }

    /// The parameter that a slot stands for, unless it stands for a latent.
    pub fn declaration(&self, slot: usize) -> Option<&'static ParameterDeclaration> {
        match self.parameters[slot].kind {
            ParameterKind::EffectParameter(t, p) => Some(&self.terms[t].effect.parameters[p]),
            ParameterKind::Latent(_) => None,
        }
    }

    /// Whether a slot only shapes its effect.
    pub fn is_shape(&self, slot: usize) -> bool {
        self.declaration(slot).is_some_and(|p| !p.is_amplitude())
    }

    /// Whether a slot moves an edge in space, which a path feels only where it crosses it.
    pub fn is_discontinuous(&self, slot: usize) -> bool {
        self.declaration(slot).is_some_and(ParameterDeclaration::is_edge)
    }

    /// Whether any slot moves an edge in space.
    pub fn has_discontinuities(&self) -> bool {
        (0..self.parameters.len()).any(|i| self.is_discontinuous(i))
    }

    /// Slots of a term.
    pub fn parameters_of_term(&self, term: usize) -> Vec<usize> {
        (0..self.parameters.len())
            .filter(|i| matches!(self.parameters[*i].kind, ParameterKind::EffectParameter(t, _) if t == term))
            .collect()
    }

    /// Of every term with amplitudes, their slots and by how much each changes if its deviation in the prior's coordinate grows
    /// by all of itself. `gravity`: of the scene, m/s^2.
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
        (0..self.terms.len()).filter_map(of).collect()
    }

    /// Values of every term, and latents, for a setting.
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

    /// Effects and latents for a setting, the clock shifted to a window's start.
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

    /// What acts in a window that is integrated here, and effects besides.
    pub fn segment_physics<'a>(
        &self,
        window: &'a Segment,
        values: &[f64],
        besides: &[(&'static Effect, Vec<f64>)],
    ) -> SegmentPhysics<'a> {
        let (numbers, latents) = self.values_by_term(values, window.setting);
        let own = self.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice()));
        let besides = besides.iter().map(|(effect, n)| (*effect, n.as_slice()));
        SegmentPhysics::new(window, &own.chain(besides).collect::<Vec<_>>(), &latents)
    }
}

impl Parameter {
    /// The index of the latent factor that it is, if it is one.
    pub fn latent(&self) -> Option<usize> {
        match self.kind {
            ParameterKind::Latent(l) => Some(l),
            ParameterKind::EffectParameter(..) => None,
        }
    }

    /// Whether a value stands at a bound and is pushed outwards.
    pub fn is_at_active_bound(&self, value: f64, push: f64) -> bool {
        (value <= self.bounds[0] && push < 0.0) || (value >= self.bounds[1] && push > 0.0)
    }

    /// Information below which the data say nothing of the slot's value: one noise scale over all that is allowed.
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
        Term { effect, per_setting, start, free: free.to_vec(), fd_step: None }
    }

    /// Friction, a wind of which only x is fitted, by setting, and drag.
    fn layout() -> ParameterLayout {
        let mut wind = term("wind", true, &[true, false]);
        wind.start[1] = 0.5;
        ParameterLayout::new(&[1], vec![wind, term("quadratic_drag", false, &[true])], 2)
    }

    #[test]
    fn every_setting_has_its_own_numbers_and_what_is_not_fitted_stays() {
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

    /// A drag has one amplitude and no strength beside it; a gust's period is no amplitude.
    #[test]
    fn a_strength_is_of_every_term() {
        let terms = vec![term("quadratic_drag", false, &[true]), term("gust", false, &[true; 4])];
        let layout = ParameterLayout::new(&[], terms, 1);
        assert_eq!(
            layout.amplitude_directions(&[0.1, 0.4, -0.3, 2.0, 0.5], 9.81),
            [vec![(0, 0.1)], vec![(1, 0.4), (2, -0.3)]]
        );
        let layout = ParameterLayout::new(&[], vec![term("quadratic_drag", false, &[false])], 1);
        assert!(layout.amplitude_directions(&[], 9.81).is_empty());
    }

    /// A clock that starts later shifts a gust's phase as far as it has blown by then.
    #[test]
    fn effects_go_by_the_clock_of_the_trial() {
        let layout = ParameterLayout::new(&[], vec![term("gust", false, &[true; 4])], 1);
        let phase =
            |clock: f64| layout.effects_and_latents(&[1.0, 0.0, 2.0, 0.5], 0, clock).0[0].parameters["phase"];
        assert!((phase(0.0) - 0.5).abs() < 1e-12);
        assert!((phase(0.5) - (0.5 + std::f64::consts::FRAC_PI_2)).abs() < 1e-12);
    }
}
