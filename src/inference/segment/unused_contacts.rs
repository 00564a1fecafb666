//! Contacts that no segment uses, by reason.

use std::collections::BTreeMap;

use super::contact_detection::Obstacle;
use super::definition::Segment;
use super::single_body::{BodyObservations, MIN_OBSERVATIONS_AROUND_BOUNCE};
use crate::inference::report::UnusedContacts;

/// The reason of each contact of a trial's bodies that no segment uses.
pub fn unused_contacts(observed: &[BodyObservations], segments: &[Segment]) -> Vec<String> {
    let uses = |w: &Segment, name: &str, time: f64| {
        let last = w.observations.iter().map(|p| p.time).fold(0.0, f64::max);
        (w.kind.is_impact() || w.kind.is_supported())
            && w.scene.bodies.iter().any(|b| b.name == name)
            && (w.start..=w.start + last).contains(&time)
    };
    let unused = |own: &BodyObservations| -> Vec<String> {
        let name = &own.trial.scene.bodies[own.body].name;
        let rest =
            contacts(own).into_iter().filter(|(_, time)| !segments.iter().any(|w| uses(w, name, *time)));
        rest.map(|(obstacle, _)| reason(own, obstacle)).collect()
    };
    observed.iter().flat_map(unused).collect()
}

/// Numbers of contacts by reason.
pub fn counted<'a>(reasons: impl Iterator<Item = &'a str>) -> Vec<UnusedContacts> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    reasons.for_each(|reason| *counts.entry(reason).or_default() += 1);
    counts.into_iter().map(|(reason, count)| UnusedContacts { reason: reason.into(), count }).collect()
}

/// Obstacles that a body touches one after the other, each with the first time, s. Two bodies touch each other once.
fn contacts(observed: &BodyObservations) -> Vec<(Obstacle, f64)> {
    let mut out: Vec<(Obstacle, f64)> = Vec::new();
    let mut last = None;
    for (contact, (time, _)) in observed.contacts.iter().zip(&observed.rows) {
        let obstacle = contact.map(|c| c.obstacle);
        if obstacle != last
            && let Some(obstacle) = obstacle
            && !matches!(obstacle, Obstacle::Body(other) if other < observed.body)
        {
            out.push((obstacle, *time));
        }
        last = obstacle;
    }
    out
}

fn reason(own: &BodyObservations, obstacle: Obstacle) -> String {
    let scene = &own.trial.scene;
    let has_angle = |k: usize| own.trial.observed.bodies[k].angle.iter().any(|a| a.is_finite());
    let round = |k: usize| scene.bodies[k].shape.disc_radius().is_some();
    let bodies = match obstacle {
        Obstacle::Body(other) => vec![own.body, other],
        Obstacle::Static(_) => vec![own.body],
    };
    if bodies.iter().any(|k| !round(*k) && !has_angle(*k)) {
        return "impacts of bodies that are not round, without observed angles".into();
    }
    if !bodies.iter().all(|k| round(*k)) {
        return format!(
            "impacts of bodies that are not round: of two corners at once or one soon after another, or with fewer than {MIN_OBSERVATIONS_AROUND_BOUNCE} observations of free motion before or after"
        );
    }
    match obstacle {
        Obstacle::Static(_) => format!(
            "impacts on fixed objects with fewer than {MIN_OBSERVATIONS_AROUND_BOUNCE} observations of free motion before or after"
        ),
        Obstacle::Body(_) => format!(
            "collisions with fewer than {MIN_OBSERVATIONS_AROUND_BOUNCE} observations of free motion before or after"
        ),
    }
}

#[cfg(test)]
mod tests {
    use crate::inference::segment::{counted, segment_trials};
    use crate::progress::NoProgress;
    use crate::reality::trials_from_csv;
    use crate::task::Scene;

    fn of_bounce(shape: &str, rows_before: u32) -> Vec<(String, usize)> {
        let scene = Scene::from_json(&format!(
            r#"{{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
                "bodies": [{{"name": "body", "shape": {shape}}}],
                "statics": [{{"name": "floor", "shape": {{"type": "halfspace", "normal": [0, 1], "offset": 0}}}}]}}"#
        ))
        .unwrap();
        let mut csv = String::from("trial,t,body,x,y\n");
        for i in 0..40 {
            let t = 0.01 * (f64::from(i) - f64::from(rows_before));
            let speed = if t < 0.0 { -3.0 } else { 2.0 };
            csv += &format!("a,{},body,{t},{}\n", 0.01 * f64::from(i), 0.05 + speed * t - 4.905 * t * t);
        }
        let trials = trials_from_csv(&csv, &scene).unwrap();
        let found = segment_trials(&scene, &trials, &[0], 8, &NoProgress).unwrap();
        let reasons = found.unused_contacts.iter().map(|(_, reason)| reason.as_str());
        counted(reasons).into_iter().map(|u| (u.reason, u.count)).collect()
    }

    #[test]
    fn unused_contacts_are_counted_by_reason() {
        let disc = r#"{"type": "disc", "radius": 0.05}"#;
        assert_eq!(of_bounce(disc, 15), []);
        let few = of_bounce(disc, 3);
        assert!(
            few.len() == 1 && few[0].0.starts_with("impacts on fixed objects") && few[0].1 == 1,
            "{few:?}"
        );
        let block = of_bounce(r#"{"type": "box", "half_width": 0.05, "half_height": 0.05}"#, 15);
        assert_eq!(block, [("impacts of bodies that are not round, without observed angles".to_string(), 1)]);
    }
}
