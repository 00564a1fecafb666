//! Latents to calibrate and effect terms with their parameters, laid out as one vector of numbers.

use crate::discover::path::Physics;
use crate::discover::window::Window;
use crate::task::scene::EffectTerm;
use crate::world::Latents;
use crate::world::effect::{Effect, ParameterDeclaration};
use crate::world::latent::FACTORS;

/// Difference for derivatives by a latent.
const LATENT_STEP: f64 = 2e-3;

/// Which numbers there are.
#[derive(Clone)]
pub struct Layout {
    pub terms: Vec<Term>,
    /// Latents first.
    pub slots: Vec<Slot>,
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
    pub difference: Option<f64>,
}

/// One number of the parameter vector.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    pub what: What,
    /// The setting it belongs to; all if none.
    pub setting: Option<usize>,
    pub bounds: [f64; 2],
    /// Difference for derivatives.
    pub step: f64,
    /// Whether the value is held and not fitted.
    pub is_fixed: bool,
    /// Precision by which the value is believed to be about nothing, in fits by least squares; 0 where nothing is believed.
    pub belief: f64,
}

/// What one number of the parameter vector stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Index into the latent factors.
    Latent(usize),
    /// Term and parameter.
    Parameter(usize, usize),
}

impl Layout {
    /// Latents (indices of factors) and terms; `settings` is the number of settings.
    pub fn new(latents: &[usize], terms: Vec<Term>, settings: usize) -> Layout {
        let latent = |l: &usize| Slot {
            what: What::Latent(*l),
            setting: None,
            bounds: FACTORS[*l].bounds,
            step: LATENT_STEP,
            is_fixed: false,
            belief: 0.0,
        };
        let mut slots: Vec<Slot> = latents.iter().map(latent).collect();
        for (t, term) in terms.iter().enumerate() {
            for (p, parameter) in term.effect.parameters.iter().enumerate().filter(|(p, _)| term.free[*p]) {
                let slot = |setting| Slot {
                    what: What::Parameter(t, p),
                    setting,
                    bounds: parameter.bounds,
                    step: term.difference.unwrap_or(parameter.fd_step),
                    is_fixed: false,
                    belief: 0.0,
                };
                match term.per_setting {
                    true => slots.extend((0..settings).map(|s| slot(Some(s)))),
                    false => slots.push(slot(None)),
                }
            }
        }
        Layout { terms, slots }
    }

    /// Values to start from: the scene's latents, the terms' own.
    pub fn start(&self, latents: &[f64; 3]) -> Vec<f64> {
        let value = |s: &Slot| match s.what {
            What::Latent(l) => latents[l],
            What::Parameter(t, p) => self.terms[t].start[p],
        };
        self.slots.iter().map(value).collect()
    }

    /// Number of latent slots; they come first.
    pub fn latents(&self) -> usize {
        self.slots.iter().filter(|s| matches!(s.what, What::Latent(_))).count()
    }

    /// The parameter that a slot stands for, unless it stands for a latent.
    pub fn parameter(&self, slot: usize) -> Option<&'static ParameterDeclaration> {
        match self.slots[slot].what {
            What::Parameter(t, p) => Some(&self.terms[t].effect.parameters[p]),
            What::Latent(_) => None,
        }
    }

    /// Whether a slot only shapes its effect.
    pub fn shapes(&self, slot: usize) -> bool {
        self.parameter(slot).is_some_and(|p| !p.is_amplitude())
    }

    /// Whether a slot moves an edge in space, which a path feels only where it crosses it.
    pub fn edged(&self, slot: usize) -> bool {
        self.parameter(slot).is_some_and(ParameterDeclaration::is_edge)
    }

    /// Whether any slot moves an edge in space.
    pub fn has_edges(&self) -> bool {
        (0..self.slots.len()).any(|i| self.edged(i))
    }

    /// Slots of a term.
    pub fn of_term(&self, term: usize) -> Vec<usize> {
        (0..self.slots.len())
            .filter(|i| matches!(self.slots[*i].what, What::Parameter(t, _) if t == term))
            .collect()
    }

    /// Of every term with amplitudes, their slots and by how much each changes if its deviation in the prior's coordinate grows
    /// by all of itself. `gravity`: of the scene, m/s^2.
    pub fn strengths(&self, values: &[f64], gravity: f64) -> Vec<Vec<(usize, f64)>> {
        let of = |t: usize| {
            let amplitudes = self.of_term(t).into_iter().filter(|i| !self.shapes(*i));
            let size = |i: usize| {
                let deviation = self.parameter(i).map(|p| p.prior_deviation(values[i], gravity));
                (i, deviation.map_or(0.0, |[size, slope]| size / slope))
            };
            let mut free = (0..self.terms[t].free.len())
                .filter(|p| self.terms[t].free[*p] && self.terms[t].effect.parameters[*p].is_amplitude());
            free.next().map(|_| amplitudes.map(size).collect())
        };
        (0..self.terms.len()).filter_map(of).collect()
    }

    /// Values of every term, and latents, for a setting.
    pub fn numbers(&self, values: &[f64], setting: usize) -> (Vec<Vec<f64>>, Latents) {
        let mut latents = [None; 3];
        let mut numbers: Vec<Vec<f64>> = self.terms.iter().map(|t| t.start.clone()).collect();
        for (slot, value) in self.slots.iter().zip(values) {
            if slot.setting.is_some_and(|s| s != setting) {
                continue;
            }
            match slot.what {
                What::Latent(l) => latents[l] = Some(*value),
                What::Parameter(t, p) => numbers[t][p] = *value,
            }
        }
        (numbers, Latents { density: latents[0], friction: latents[1], restitution: latents[2] })
    }

    /// Effects and latents for a setting, the clock shifted to a window's start.
    pub fn physics(&self, values: &[f64], setting: usize, clock: f64) -> (Vec<EffectTerm>, Latents) {
        let (numbers, latents) = self.numbers(values, setting);
        let of = |(term, numbers): (&Term, &Vec<f64>)| term.effect.term_at_clock(numbers, clock);
        (self.terms.iter().zip(&numbers).map(of).collect(), latents)
    }

    /// What acts in a window that is integrated here, and effects besides.
    pub fn path<'a>(
        &self,
        window: &'a Window,
        values: &[f64],
        besides: &[(&'static Effect, Vec<f64>)],
    ) -> Physics<'a> {
        let (numbers, latents) = self.numbers(values, window.setting);
        let own = self.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice()));
        let besides = besides.iter().map(|(effect, n)| (*effect, n.as_slice()));
        Physics::new(window, &own.chain(besides).collect::<Vec<_>>(), &latents)
    }
}

impl Slot {
    /// The index of the latent factor that it is, if it is one.
    pub fn latent(&self) -> Option<usize> {
        match self.what {
            What::Latent(l) => Some(l),
            What::Parameter(..) => None,
        }
    }

    /// Whether a value stands at a bound and is pushed outwards.
    pub fn is_stuck(&self, value: f64, push: f64) -> bool {
        (value <= self.bounds[0] && push < 0.0) || (value >= self.bounds[1] && push > 0.0)
    }

    /// Information below which the data say nothing of the slot's value: one noise scale over all that is allowed.
    pub fn ridge(&self) -> f64 {
        let most = if matches!(self.what, What::Latent(_)) { 2.0 } else { 1e3 };
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
        Term { effect, per_setting, start, free: free.to_vec(), difference: None }
    }

    /// Friction, a wind of which only x is fitted, by setting, and drag.
    fn layout() -> Layout {
        let mut wind = term("wind", true, &[true, false]);
        wind.start[1] = 0.5;
        Layout::new(&[1], vec![wind, term("quadratic_drag", false, &[true])], 2)
    }

    #[test]
    fn every_setting_has_its_own_numbers_and_what_is_not_fitted_stays() {
        let layout = layout();
        assert_eq!((layout.slots.len(), layout.latents()), (4, 1));
        assert_eq!((layout.of_term(0), layout.of_term(1)), (vec![1, 2], vec![3]));
        for (setting, wind) in [(0, 0.1), (1, 0.2)] {
            let (numbers, latents) = layout.numbers(&[0.7, 0.1, 0.2, 0.03], setting);
            assert_eq!(numbers, [vec![wind, 0.5], vec![0.03]]);
            assert_eq!((latents.density, latents.friction), (None, Some(0.7)));
        }
        assert_eq!(layout.start(&[9.0, 0.4, 9.0]), [0.4, 0.0, 0.0, 0.0]);
    }

    /// A drag has one amplitude and no strength beside it; a gust's period is no amplitude.
    #[test]
    fn a_strength_is_of_every_term() {
        let terms = vec![term("quadratic_drag", false, &[true]), term("gust", false, &[true; 4])];
        let layout = Layout::new(&[], terms, 1);
        assert_eq!(
            layout.strengths(&[0.1, 0.4, -0.3, 2.0, 0.5], 9.81),
            [vec![(0, 0.1)], vec![(1, 0.4), (2, -0.3)]]
        );
        let layout = Layout::new(&[], vec![term("quadratic_drag", false, &[false])], 1);
        assert!(layout.strengths(&[], 9.81).is_empty());
    }

    /// A clock that starts later shifts a gust's phase as far as it has blown by then.
    #[test]
    fn effects_go_by_the_clock_of_the_trial() {
        let layout = Layout::new(&[], vec![term("gust", false, &[true; 4])], 1);
        let phase = |clock: f64| layout.physics(&[1.0, 0.0, 2.0, 0.5], 0, clock).0[0].parameters["phase"];
        assert!((phase(0.0) - 0.5).abs() < 1e-12);
        assert!((phase(0.5) - (0.5 + std::f64::consts::FRAC_PI_2)).abs() < 1e-12);
    }
}
