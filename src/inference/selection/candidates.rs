//! Candidate effects from the registry, with initial values.
//!
//! The registry declares which effects are candidates and where their search starts (`SearchStrategy`), and
//! which parameters are amplitudes (`ParameterRole`).

use crate::inference::model::Term;
use crate::inference::segment::{Segment, SegmentKind};
use crate::task::Scene;
use crate::world::effect::{
    DataRange, Effect, EffectTarget, IdentifyingMotion, ParameterDeclaration, ParameterRole, REGISTRY,
    SearchStrategy, ShapeParameter,
};

/// Gravity in the plane of a table that is seen from above, m/s^2: a tilt of up to 17 degrees.
const MAX_GRAVITY_FROM_ABOVE: f64 = 3.0;

/// Properties of a recording on which the candidates depend.
#[derive(Clone, Copy, Debug)]
pub struct RecordingSummary {
    pub range: DataRange,
    /// Largest gravity of the scenes, m/s^2.
    pub gravity: f64,
    /// Whether there may be contacts.
    pub has_contacts: bool,
    /// Whether movable bodies may collide, and whether bodies may roll.
    pub has_collisions: bool,
    pub has_rolling: bool,
    /// Whether any segment starts from the scene's initial state.
    pub has_initial_segments: bool,
}

/// A candidate effect.
#[derive(Clone)]
pub struct Candidate {
    pub effect: &'static Effect,
    /// Initial values; amplitudes are set by the score test. At least one.
    pub starts: Vec<Term>,
    /// Initial values of large amplitude, with their gain over the base model, nats.
    pub strong_start: Option<(Term, f64)>,
}

/// Candidates for a recording of a scene.
pub fn candidates(scene: &Scene, ground: &RecordingSummary) -> Vec<Candidate> {
    let told = |e: &&'static Effect| match e.target() {
        EffectTarget::Contact => ground.has_contacts,
        EffectTarget::Body => true,
        // A free or observed initial state absorbs effects on placement.
        EffectTarget::Action => ground.has_initial_segments,
        EffectTarget::Motion | EffectTarget::Region | EffectTarget::Sensor => true,
    };
    let identified = |e: &&'static Effect| match e.identified_by {
        Some(IdentifyingMotion::Collision) => ground.has_collisions,
        Some(IdentifyingMotion::Rolling) => ground.has_rolling,
        Some(IdentifyingMotion::SeenFromAbove) => ground.gravity < MAX_GRAVITY_FROM_ABOVE,
        None => true,
    };
    let of = |e: &'static Effect| {
        let starts = match e.search {
            SearchStrategy::Excluded => return None,
            SearchStrategy::FromNeutral => vec![e.parameters.iter().map(|p| p.neutral).collect()],
            SearchStrategy::FromStarts(starts) => starts(&ground.range),
        };
        let per_setting = scene.per_setting.iter().any(|n| n == e.name);
        let free = vec![true; e.parameters.len()];
        let term =
            |start| Term { effect: e, per_setting, start, free: free.clone(), fd_step: None, bracket: None };
        Some(Candidate { effect: e, starts: starts.into_iter().map(term).collect(), strong_start: None })
    };
    REGISTRY.iter().copied().filter(told).filter(identified).filter_map(of).collect()
}

/// Prior standard deviation of a shape parameter, from the range of the data.
pub fn shape_sd(parameter: &ParameterDeclaration, range: &DataRange) -> f64 {
    let [x0, y0, x1, y1] = range.area;
    let extent = (x1 - x0).max(y1 - y0).max(1e-6);
    match parameter.role {
        ParameterRole::Shape(ShapeParameter::Place | ShapeParameter::Edge { .. } | ShapeParameter::Width) => {
            extent
        }
        ParameterRole::Shape(ShapeParameter::Velocity) => range.speed.max(1e-6),
        ParameterRole::Shape(ShapeParameter::Period | ShapeParameter::Time) => range.duration.max(1e-6),
        ParameterRole::Shape(ShapeParameter::Phase) => std::f64::consts::PI,
        ParameterRole::Shape(ShapeParameter::Power) | ParameterRole::Amplitude => 1.0,
    }
}

/// Summarises a recording.
pub fn summarise(segments: &[Segment]) -> RecordingSummary {
    let any = |of: &dyn Fn(&Segment) -> bool| segments.iter().any(of);
    RecordingSummary {
        range: data_range(segments),
        gravity: max_gravity(segments),
        has_contacts: segments.iter().any(|w| w.kind != SegmentKind::Flight),
        has_collisions: any(&|w| {
            w.kind == SegmentKind::Collision || (w.kind.uses_engine() && w.scene.bodies.len() > 1)
        }),
        has_rolling: any(&|w| w.kind == SegmentKind::Rolling || w.kind.uses_engine()),
        has_initial_segments: segments.iter().any(|w| w.kind == SegmentKind::FromInitialState),
    }
}

/// Largest gravity of the segments' scenes, m/s^2.
pub fn max_gravity(segments: &[Segment]) -> f64 {
    segments.iter().map(|w| w.scene.gravity[0].hypot(w.scene.gravity[1])).fold(0.0, f64::max)
}

/// Ranges of position, time and speed of a recording.
pub fn data_range(segments: &[Segment]) -> DataRange {
    let mut area = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut duration, mut path, mut time, mut count) = (0.0f64, 0.0, 0.0, 0usize);
    for w in segments {
        for p in w.observations.iter().filter(|p| p.weight > 0.0) {
            area = [
                area[0].min(p.position[0]),
                area[1].min(p.position[1]),
                area[2].max(p.position[0]),
                area[3].max(p.position[1]),
            ];
        }
        let last = w.observations.last().map_or(0.0, |p| p.time);
        duration = duration.max(w.start + last);
        let bodies = if w.kind == SegmentKind::Collision { 1 } else { w.scene.bodies.len() };
        for (a, b) in
            w.observations.iter().zip(w.observations.iter().skip(bodies)).filter(|(a, b)| a.body == b.body)
        {
            path += (b.position[0] - a.position[0]).hypot(b.position[1] - a.position[1]);
            time += b.time - a.time;
            count += 1;
        }
    }
    DataRange {
        area,
        duration,
        speed: if time > 0.0 { path / time } else { 1.0 },
        interval: time / count.max(1) as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{ball, bounces, flights, one_step_segments};

    fn names(segments: &[Segment]) -> Vec<&'static str> {
        candidates(&ball(), &summarise(segments)).iter().map(|c| c.effect.name).collect()
    }

    /// Contact effects are candidates where contacts may happen; placement effects where the initial state is
    /// the scene's.
    #[test]
    fn candidates_depend_on_the_recording() {
        let of = |acts: EffectTarget, names: &[&str]| {
            REGISTRY.iter().filter(|e| e.target() == acts && names.contains(&e.name)).count()
        };
        let flown = names(&flights([0.0, 0.0], 1).0);
        assert!(flown.contains(&"wind") && flown.contains(&"camera_tilt"));
        assert_eq!((of(EffectTarget::Contact, &flown), of(EffectTarget::Action, &flown)), (0, 0));
        assert!(of(EffectTarget::Contact, &names(&bounces(0.8, 1).0)) > 0);
        assert!(of(EffectTarget::Contact, &names(&one_step_segments(0.0).0)) > 0, "a leap may hit anything");
    }

    #[test]
    fn data_range_uses_weighted_observations() {
        let (mut segments, _) = flights([0.0, 0.0], 1);
        segments[0].observations[19].weight = 0.0;
        let span = data_range(&segments);
        assert!((span.area[2] - 3.0 * 0.72).abs() < 1e-9, "{:?}", span.area);
        assert!((span.duration - 0.76).abs() < 1e-9 && (span.interval - 0.04).abs() < 1e-9);
        // A parabola at 3 m/s sideways and 4 to -3.5 m/s upwards.
        assert!((3.0..5.0).contains(&span.speed));
    }
}
