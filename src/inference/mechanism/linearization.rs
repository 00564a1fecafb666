//! Residuals of all segments with their derivatives, by simulation.

use nalgebra::{DMatrix, DVector};

use super::recording::{JointRecording, JointSegment};
use crate::world::mechanism::effect::JointParameter;
use crate::world::mechanism::{JointMotion, JointRollout, JointTerm, TorqueField, simulate};

/// Finite-difference step of a parameter in plausible sizes, and of an initial position and velocity relative to their scales.
const PARAMETER_STEP: f64 = 1e-3;
const STATE_STEP: f64 = 1e-4;
/// The same of a function of a torque field, relative to its size: joints that stick respond to finite torques nonlinearly.
const FIELD_STEP: f64 = 1e-2;

/// Effects with their values.
pub type Terms = Vec<JointTerm>;

/// A segment's residual and derivatives: one row per observation, joint by joint.
pub struct JointLinearization {
    pub residual: DVector<f64>,
    /// By parameter, and by initial position and velocity of each joint.
    pub jacobian: DMatrix<f64>,
    pub nuisances: DMatrix<f64>,
}

/// A parameter of a model.
#[derive(Clone, Copy)]
pub struct Slot {
    pub term: usize,
    pub parameter: usize,
}

/// Parameters of terms in order, those that are whole numbers left out.
pub fn slots(terms: &[JointTerm]) -> Vec<Slot> {
    let of = |(term, t): (usize, &JointTerm)| {
        let parameters = t.effect.parameters;
        let free = (0..parameters.len()).filter(|p| !parameters[*p].is_whole);
        free.map(move |parameter| Slot { term, parameter })
    };
    terms.iter().enumerate().flat_map(of).collect()
}

/// The declaration of a parameter.
pub fn declaration(terms: &[JointTerm], slot: Slot) -> &'static JointParameter {
    &terms[slot.term].effect.parameters[slot.parameter]
}

impl JointRecording<'_> {
    /// Plausible size of a parameter in its unit.
    pub fn plausible(&self, terms: &[JointTerm], slot: Slot) -> f64 {
        let parameter = declaration(terms, slot);
        parameter.plausible * self.scales[terms[slot.term].joint].of(parameter.scale)
    }

    /// Linearizations at parameter values and initial states (positions, then velocities, by segment); `None` if a simulation
    /// diverges.
    pub fn linearise(&self, terms: &[JointTerm], states: &[Vec<f64>]) -> Option<Vec<JointLinearization>> {
        let every: Vec<usize> = (0..self.segments.len()).collect();
        let all = self.linearizations(terms, &slots(terms), states, &every);
        let finite = |l: &JointLinearization| {
            l.residual.iter().chain(l.jacobian.iter()).chain(l.nuisances.iter()).all(|v| v.is_finite())
        };
        all.iter().all(finite).then_some(all)
    }

    /// The same by initial states alone, of some segments; residuals of segments that diverge are not finite.
    pub fn linearise_states(
        &self,
        terms: &[JointTerm],
        states: &[Vec<f64>],
        which: &[usize],
    ) -> Vec<JointLinearization> {
        self.linearizations(terms, &[], states, which)
    }

    /// Residuals of some segments, by the same.
    pub fn residuals(&self, terms: &[JointTerm], states: &[Vec<f64>], which: &[usize]) -> Vec<DVector<f64>> {
        let rollouts: Vec<JointRollout> =
            which.iter().map(|w| self.rollout(&self.segments[*w], terms, &states[*w])).collect();
        let of = |(motion, w): (JointMotion, &usize)| self.observed(&self.segments[*w]) - rows(&motion);
        simulate(&rollouts).into_iter().zip(which).map(of).collect()
    }

    fn linearizations(
        &self,
        terms: &[JointTerm],
        slots: &[Slot],
        states: &[Vec<f64>],
        which: &[usize],
    ) -> Vec<JointLinearization> {
        let joints = self.noise.len();
        let steps: Vec<f64> = slots.iter().map(|slot| self.step(terms, *slot)).collect();
        let state_step = |k: usize| {
            let scales = &self.scales[k % joints];
            STATE_STEP * if k < joints { scales.range } else { scales.velocity }
        };
        let mut rollouts = Vec::new();
        for w in which {
            let rollout = self.rollout(&self.segments[*w], terms, &states[*w]);
            rollouts.push(rollout.clone());
            for (slot, step) in slots.iter().zip(&steps) {
                let mut moved = rollout.clone();
                moved.terms[self.scene_terms.len() + slot.term].values[slot.parameter] += step;
                rollouts.push(moved);
            }
            for k in 0..2 * joints {
                let mut moved = rollout.clone();
                match k < joints {
                    true => moved.position[k] += state_step(k),
                    false => moved.velocity[k - joints] += state_step(k),
                }
                rollouts.push(moved);
            }
        }
        let motions = simulate(&rollouts);
        let each = motions.chunks(1 + slots.len() + 2 * joints).zip(which).map(|(motions, w)| {
            let base = rows(&motions[0]);
            let column = |k: usize, step: f64| (rows(&motions[1 + k]) - &base) / step;
            let jacobian: Vec<DVector<f64>> =
                steps.iter().enumerate().map(|(k, step)| column(k, *step)).collect();
            let nuisances: Vec<DVector<f64>> =
                (0..2 * joints).map(|k| column(slots.len() + k, state_step(k))).collect();
            let count = base.len();
            JointLinearization {
                residual: self.observed(&self.segments[*w]) - base,
                jacobian: DMatrix::from_fn(count, jacobian.len(), |i, k| jacobian[k][i]),
                nuisances: DMatrix::from_columns(&nuisances),
            }
        });
        each.collect()
    }

    /// Responses of all segments' observations to functions of a torque field of the sizes `torques`, N m.
    pub fn field_responses(
        &self,
        terms: &[JointTerm],
        states: &[Vec<f64>],
        field: &TorqueField,
        torques: &[f64],
    ) -> Option<Vec<DMatrix<f64>>> {
        let mut rollouts = Vec::new();
        for (segment, state) in self.segments.iter().zip(states) {
            let rollout = self.rollout(segment, terms, state);
            for (k, torque) in torques.iter().enumerate() {
                let coefficients = vec![(k, FIELD_STEP * torque)];
                rollouts.push(JointRollout { field: Some((field, coefficients)), ..rollout.clone() });
            }
            rollouts.push(rollout);
        }
        let motions = simulate(&rollouts);
        let each = motions.chunks(torques.len() + 1).map(|motions| {
            let base = rows(&motions[torques.len()]);
            let columns: Vec<DVector<f64>> =
                motions[..torques.len()].iter().map(|m| (rows(m) - &base) / FIELD_STEP).collect();
            DMatrix::from_fn(base.len(), columns.len(), |i, k| columns[k][i])
        });
        let all: Vec<DMatrix<f64>> = each.collect();
        all.iter().all(|m| m.iter().all(|v| v.is_finite())).then_some(all)
    }

    /// Observed positions of a segment, joint by joint.
    pub fn observed(&self, segment: &JointSegment) -> DVector<f64> {
        let positions = &self.trials[segment.trial].positions[segment.range.clone()];
        let joints = self.noise.len();
        DVector::from_fn(positions.len() * joints, |i, _| positions[i % positions.len()][i / positions.len()])
    }

    fn rollout(&self, segment: &JointSegment, terms: &[JointTerm], state: &[f64]) -> JointRollout<'_> {
        let trial = &self.trials[segment.trial];
        let times = &trial.times[segment.range.clone()];
        let (position, velocity) = state.split_at(self.noise.len());
        JointRollout {
            tree: self.tree,
            terms: self.scene_terms.iter().chain(terms).cloned().collect(),
            position: position.to_vec(),
            velocity: velocity.to_vec(),
            start: times[0],
            commands: &trial.commands,
            times,
            field: None,
        }
    }

    /// Step of a parameter, within its bounds.
    fn step(&self, terms: &[JointTerm], slot: Slot) -> f64 {
        let (parameter, value) = (declaration(terms, slot), terms[slot.term].values[slot.parameter]);
        let step = PARAMETER_STEP * self.plausible(terms, slot);
        if value + step > parameter.bounds[1] { -step } else { step }
    }
}

/// Positions joint by joint.
fn rows(motion: &JointMotion) -> DVector<f64> {
    DVector::from_vec(motion.positions.concat())
}
