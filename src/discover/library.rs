//! The library of candidates: every row of the effect registry, with places to start its search from.
//!
//! Effects join as candidates by standing in the registry; their own files say whether a search may try them and where
//! it should start (`Search`), of which parameters they vanish and which only shape them (`Role`).

use super::model::Term;
use super::window::{Segment, SegmentKind};
use crate::task::Scene;
use crate::world::effect::{
    DataRange, Effect, EffectTarget, ParameterDeclaration, ParameterRole, REGISTRY, SearchStrategy,
    ShapeParameter,
};

/// What decides which effects can be told at all, and where their search starts.
#[derive(Clone, Copy, Debug)]
pub struct RecordingSummary {
    pub range: DataRange,
    /// Whether anything touches anything.
    pub has_contacts: bool,
    /// Whether any stretch starts where the scene says, and not where something was seen or may be.
    pub has_initial_segments: bool,
}

/// An effect that a search may try.
pub struct Candidate {
    pub effect: &'static Effect,
    /// Where searches start, whose amplitudes the linearisation at nothing gives; at least one.
    pub starts: Vec<Term>,
    /// A start at a size that the linearisation does not lead to, and how much better it is than the base model, nats.
    pub strong_start: Option<(Term, f64)>,
}

/// Candidates of a scene's recording.
pub fn candidates(scene: &Scene, ground: &RecordingSummary) -> Vec<Candidate> {
    let told = |e: &&'static Effect| match e.target() {
        EffectTarget::Contact => ground.has_contacts,
        // A free start takes up whatever a placement does, and one that was seen holds it.
        EffectTarget::Action => ground.has_initial_segments,
        EffectTarget::Motion | EffectTarget::Region | EffectTarget::Sensor => true,
    };
    let of = |e: &'static Effect| {
        let starts = match e.search {
            SearchStrategy::Excluded => return None,
            SearchStrategy::FromNeutral => vec![e.parameters.iter().map(|p| p.neutral).collect()],
            SearchStrategy::FromStarts(starts) => starts(&ground.range),
        };
        let per_setting = scene.per_setting.iter().any(|n| n == e.name);
        let free = vec![true; e.parameters.len()];
        let term = |start| Term { effect: e, per_setting, start, free: free.clone(), fd_step: None };
        Some(Candidate { effect: e, starts: starts.into_iter().map(term).collect(), strong_start: None })
    };
    REGISTRY.iter().copied().filter(told).filter_map(of).collect()
}

/// Prior standard deviation of a shape parameter over what the data span.
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

/// What a recording is of.
pub fn summarise(windows: &[Segment]) -> RecordingSummary {
    RecordingSummary {
        range: data_range(windows),
        has_contacts: windows.iter().any(|w| w.kind != SegmentKind::Flight),
        has_initial_segments: windows.iter().any(|w| w.kind == SegmentKind::FromInitialState),
    }
}

/// Strongest gravity of some segments' scenes, m/s^2.
pub fn max_gravity(windows: &[Segment]) -> f64 {
    windows.iter().map(|w| w.scene.gravity[0].hypot(w.scene.gravity[1])).fold(0.0, f64::max)
}

/// What a recording spans.
pub fn data_range(windows: &[Segment]) -> DataRange {
    let mut area = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut duration, mut path, mut time, mut count) = (0.0f64, 0.0, 0.0, 0usize);
    for w in windows {
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
        let bodies = w.scene.bodies.len();
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
    use crate::discover::fixture::{ball, bounces, flights, one_step_segments};

    fn names(windows: &[Segment]) -> Vec<&'static str> {
        candidates(&ball(), &summarise(windows)).iter().map(|c| c.effect.name).collect()
    }

    /// What acts at contacts is a candidate where something touches; what is off in placing, where a start is the scene's.
    #[test]
    fn candidates_are_what_can_show_at_all() {
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
    fn a_span_is_what_was_seen_that_counts() {
        let (mut windows, _) = flights([0.0, 0.0], 1);
        windows[0].observations[19].weight = 0.0;
        let span = data_range(&windows);
        assert!((span.area[2] - 3.0 * 0.72).abs() < 1e-9, "{:?}", span.area);
        assert!((span.duration - 0.76).abs() < 1e-9 && (span.interval - 0.04).abs() < 1e-9);
        // Along a parabola at 3 m/s sideways and 4 to -3.5 m/s upwards.
        assert!((3.0..5.0).contains(&span.speed));
    }
}
