//! Segments: their kinds, observations, nuisances and surfaces.

use super::contact_geometry::{ContactFeature, RoundedCorner};
use crate::inference::data::smoothing::PolynomialSmooth;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{Track, Trajectory};
use crate::world::effect::{self, ActiveEffect};
use crate::world::{Latents, Rollout};

/// Kind of a segment; it determines which nuisance parameters its initial state has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentKind {
    /// One body between contacts; nuisances x, y, vx, vy. The scene has no other body and no static, so that
    /// no perturbed initial state can collide.
    Flight,
    /// A few observations before and after one bounce of a disc or a corner on a static; nuisances x, y, vx, vy, omega, and the
    /// offset of the surface along its normal; of a corner also the error of the body's angle.
    Contact,
    /// A few observations of a disc before an impact on a static and after it, while the static supports the disc; nuisances as
    /// of a contact.
    Landing,
    /// A few observations of two bodies before and after they collide, all of the first, then all of the second; nuisances x, y,
    /// vx, vy, omega of each, and the excess of their distance at contact over that of their outlines; unless both are discs also
    /// the errors of their angles.
    Collision,
    /// A disc rolling on a straight static; nuisances are its distance and speed along it, and the offset and
    /// slope of the surface.
    Rolling,
    /// A body that slides on a straight static, and rolls or rests from some time on; nuisances as of a rolling one, and
    /// the spin of a disc.
    Sliding,
    /// The beginning of a trial whose initial state is known exactly, up to the predictability horizon; no
    /// nuisances.
    FromInitialState,
    /// One-step-ahead prediction from a fully observed state (velocities and spins included); no nuisances.
    OneStep,
    /// A few observations of all bodies of a trial; nuisances x, y, vx, vy, omega of each body. Simulated
    /// with all contacts; short, so that a collision does not hide what precedes it.
    MultiStep,
}

impl SegmentKind {
    /// Whether it is a flight, or flights before and after a bounce: random accelerations act in these.
    pub fn is_airborne(self) -> bool {
        matches!(self, SegmentKind::Flight) || self.is_impact()
    }

    /// Whether bodies bounce off a static or each other in it.
    pub fn is_impact(self) -> bool {
        matches!(self, SegmentKind::Contact | SegmentKind::Landing | SegmentKind::Collision)
    }

    /// Whether it has a free initial state and is simulated without an engine.
    pub fn has_free_initial_state(self) -> bool {
        self.is_airborne() || self.is_supported()
    }

    /// Whether a straight static supports the body.
    pub fn is_supported(self) -> bool {
        matches!(self, SegmentKind::Rolling | SegmentKind::Sliding)
    }

    /// Whether a physics engine simulates it, with all contacts.
    pub fn uses_engine(self) -> bool {
        matches!(self, SegmentKind::FromInitialState | SegmentKind::OneStep | SegmentKind::MultiStep)
    }

    /// Axis of a position or velocity among the nuisances; `None` for others.
    pub fn axis_of_nuisance(self, index: usize) -> Option<usize> {
        let of_body = match self {
            SegmentKind::Flight | SegmentKind::Contact | SegmentKind::Landing => index,
            SegmentKind::Collision if index < 2 * BODY_NUISANCES => index % BODY_NUISANCES,
            _ => return None,
        };
        (of_body < 4).then_some(of_body % 2)
    }

    /// Whether its initial state is known, so that it has no nuisance parameters.
    pub fn has_known_initial_state(self) -> bool {
        matches!(self, SegmentKind::FromInitialState | SegmentKind::OneStep)
    }

    /// Whether a collision can make it diverge from its simulation under the true model.
    pub fn is_chaotic(self) -> bool {
        matches!(self, SegmentKind::OneStep | SegmentKind::MultiStep)
    }
}

/// Number of nuisances of a body in a collision; the excess of the distance at contact follows those of both.
pub const BODY_NUISANCES: usize = 5;
/// Numbers of nuisances of a contact and of a collision without the errors of angles, which follow.
pub const CONTACT_NUISANCES: usize = BODY_NUISANCES + 1;
pub const COLLISION_NUISANCES: usize = 2 * BODY_NUISANCES + 1;

/// Minimum number of observations of a flight: 4 nuisances must leave residual degrees of freedom.
pub const MIN_FLIGHT_OBSERVATIONS: usize = 7;

/// Whether any segment has a known initial state.
pub fn any_known_initial_state(segments: &[Segment]) -> bool {
    segments.iter().any(|w| w.kind.has_known_initial_state())
}

/// Whether any segment is a one-step prediction.
pub fn any_one_step(segments: &[Segment]) -> bool {
    segments.iter().any(|w| w.kind == SegmentKind::OneStep)
}

/// Whether any segment has several steps from an estimated initial state; collisions can make those diverge.
pub fn any_multi_step(segments: &[Segment]) -> bool {
    segments.iter().any(|w| w.kind == SegmentKind::MultiStep)
}

/// A piece of a trial that is simulated from an initial state of its own.
#[derive(Clone)]
pub struct Segment {
    /// Index of the trial.
    pub trial: usize,
    /// Index of the setting.
    pub setting: usize,
    pub kind: SegmentKind,
    /// The simulated scene.
    pub scene: Scene,
    /// Clock time at the start, s.
    pub start: f64,
    /// Whether contacts may exist before the start: the segment starts in the middle of a trial.
    pub contacts_established: bool,
    /// In order of time.
    pub observations: Vec<Observation>,
    /// Initial values of the nuisance parameters; see [`SegmentKind`].
    pub nuisances: Vec<f64>,
    /// Surface of a contact, landing, rolling or sliding segment.
    pub surface: Option<Surface>,
    /// The discs of a collision segment.
    pub pair: Option<CollidingPair>,
    /// Effects of the scene.
    pub scene_effects: Vec<ActiveEffect>,
    /// Polynomial fit of the observations, for the noise estimate.
    pub smooth: Option<PolynomialSmooth>,
    /// Variation within the blocks whose means the observations are.
    pub within_blocks: WithinBlockVariation,
}

/// One observed position.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index into the segment's bodies.
    pub body: usize,
    /// Time since the segment's start, s.
    pub time: f64,
    /// m
    pub position: [f64; 2],
    /// Number of observations that it is the mean of (1 unless the segment is long); 0 for an outlier.
    pub weight: f64,
}

/// The straight piece of a static that a body bounces off, or rolls or slides along.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Index of the static.
    pub static_index: usize,
    /// Away from the static.
    pub normal: [f64; 2],
    /// A disc's or block's centre is at `normal . p = level` when it touches, m.
    pub level: f64,
    /// Coefficients of the body and of the static, and whether each carries the latents.
    pub friction: [f64; 2],
    pub restitution: [f64; 2],
    pub carries_latents: [bool; 2],
    /// Radius of a disc; half the size of another body, m.
    pub radius: f64,
    /// Moment of inertia over mass and radius squared; infinite for a block that lies on the static.
    pub inertia: f64,
    /// The corner of a body other than a disc that bounces off the static; its place is at `normal . p = level` when it touches.
    pub corner: Option<RoundedCorner>,
    /// Prior standard deviation of the angle of a body with a corner, rad.
    pub angle_prior_sd: f64,
    /// Prior standard deviation of the spin, rad/s; small if the spin was observed.
    pub spin_prior_sd: f64,
}

/// Two bodies that collide.
#[derive(Clone, Copy, Debug)]
pub struct CollidingPair {
    /// Their indices in the trial's scene.
    pub bodies: [usize; 2],
    /// The parts of their outlines that touch.
    pub features: [ContactFeature; 2],
    /// Half the size of the smaller one, m.
    pub size: f64,
    /// Whether each carries the latents.
    pub carries_latents: [bool; 2],
    /// Prior standard deviations of the spins, rad/s; small where the spin was observed.
    pub spin_prior_sd: [f64; 2],
    /// Prior standard deviations of the angles, rad; 0 for discs.
    pub angle_prior_sd: [f64; 2],
}

impl Surface {
    /// The surface with the corner of a body in the state that some nuisances describe.
    pub fn with_angle(&self, nuisances: &[f64]) -> Surface {
        let error = nuisances.get(CONTACT_NUISANCES).copied().unwrap_or(0.0);
        Surface { corner: self.corner.map(|corner| corner.turned_by(error)), ..*self }
    }
}

impl CollidingPair {
    /// The pair with the angles that some nuisances describe.
    pub fn with_angles(&self, nuisances: &[f64]) -> CollidingPair {
        let error = |k: usize| nuisances.get(COLLISION_NUISANCES + k).copied().unwrap_or(0.0);
        CollidingPair { features: [0, 1].map(|k| self.features[k].turned_by(error(k))), ..*self }
    }
}

/// Variation within blocks of averaged observations.
#[derive(Clone, Copy, Debug, Default)]
pub struct WithinBlockVariation {
    /// Number of observations less the number of blocks.
    pub merged_count: usize,
    /// Sum of squared deviations from the block means, of both coordinates, m^2.
    pub sum_of_squares: f64,
}

impl Segment {
    /// A segment of a validated scene, without nuisances, surface and polynomial fit, of the first trial.
    pub fn new(kind: SegmentKind, scene: Scene, start: f64, observations: Vec<Observation>) -> Segment {
        let scene_effects = effect::scene_effects(&scene).unwrap_or_default();
        let nuisances = Vec::new();
        let (trial, setting, contacts_established, surface, pair, smooth) = (0, 0, false, None, None, None);
        let within_blocks = WithinBlockVariation::default();
        Segment {
            trial,
            setting,
            kind,
            scene,
            start,
            contacts_established,
            observations,
            nuisances,
            surface,
            pair,
            scene_effects,
            smooth,
            within_blocks,
        }
    }

    /// Rollout of a scene of the segment; contacts are established if it starts in the middle of a trial.
    pub fn rollout<'a>(
        &self,
        scene: &'a Scene,
        (effects, latents): &'a (Vec<EffectTerm>, Latents),
    ) -> Rollout<'a> {
        Rollout {
            latents: *latents,
            effects,
            stop_at_goal: false,
            contacts_established: self.contacts_established,
            ..Rollout::of(scene)
        }
    }

    /// Number of used coordinates of an impact segment beyond its nuisances; a surface's offset and errors of angles are held by
    /// their priors.
    pub fn impact_degrees_of_freedom(&self) -> f64 {
        let used = self.observations.iter().filter(|p| p.weight > 0.0).count();
        let most = if self.kind == SegmentKind::Collision { COLLISION_NUISANCES } else { CONTACT_NUISANCES };
        2.0 * used as f64 - (self.nuisances.len().min(most) as f64 - 1.0)
    }

    /// Index of the observation at the segment's start time, if there is one.
    pub fn start_index(&self, observed: &Trajectory) -> Option<usize> {
        observed.times.iter().position(|t| *t == self.start)
    }
}

/// Position of a body at an observation, m; `None` if it was not observed.
pub fn observed_position(track: &Track, i: usize) -> Option<[f64; 2]> {
    (track.x[i].is_finite() && track.y[i].is_finite()).then(|| [track.x[i], track.y[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::scene::EffectTerm;

    /// A scene's damping acts in segments as an effect, in addition to the scene's effects.
    #[test]
    fn damping_is_a_scene_effect() {
        let wind = EffectTerm { name: "wind".into(), parameters: [("ax".to_string(), 1.0)].into() };
        let own = |damping: f64| {
            let scene = Scene { damping: Some(damping), effects: vec![wind.clone()], ..Scene::empty() };
            let own = Segment::new(SegmentKind::Flight, scene, 0.0, Vec::new()).scene_effects;
            own.iter().map(|a| a.effect.name).collect::<Vec<_>>()
        };
        assert_eq!(own(0.8), ["linear_drag", "wind"]);
        assert_eq!(own(1.0), ["wind"], "a body that keeps all of its speed is not damped");
    }
}
