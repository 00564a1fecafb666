//! The next step after a diagnosis, by its verdict.

use super::document::DiagnosisDocument;
use crate::inference::report::Verdict;
use crate::number::significant;
use crate::picture::report::Block;
use crate::report::words::{plain_names, sentence};

/// The next step, on a card.
pub fn next_step(document: &DiagnosisDocument) -> Block {
    let d = &document.diagnosis;
    let mut steps = Vec::new();
    match d.verdict {
        Verdict::Named => steps.push(
            format!(
            "Simulate with extended_scene.json from now on: it is the scene with this law and these values, for estimates, plans and \
             trainings.{}",
            range_of_validity(document)
        ),
        ),
        Verdict::None => steps.push(
            "The scene needs no extension for motions such as these. Record faster, longer or other motions to test it further."
                .to_string(),
        ),
        Verdict::Unknown if d.residual_law.as_ref().is_some_and(|l| l.offered) => steps.push(
            "The extended scene contains an empirical law of the remaining acceleration, which holds for motions such as these only."
                .to_string(),
        ),
        Verdict::Unknown => steps.push(
            "Check the recording (scale, clock, camera angle, air movements); the section on missing acceleration shows where the error \
             acts."
                .to_string(),
        ),
        Verdict::Ambiguous | Verdict::InsufficientData => {}
    }
    if let Some(next) = &d.next_experiment {
        steps.push(sentence(&plain_names(&next.action)));
        if next.why != d.reason {
            steps.push(format!("Why: {}", sentence(&plain_names(&next.why))));
        }
    }
    if steps.is_empty() {
        steps.push("Record more trials, with other speeds and directions, and repeat the diagnosis.".into());
    }
    let blocks = match steps.as_slice() {
        [one] => vec![Block::Text(one.clone())],
        _ => vec![Block::List(steps)],
    };
    Block::card("What to do next", blocks)
}

/// The speeds at which the law was observed.
fn range_of_validity(document: &DiagnosisDocument) -> String {
    let speeds = document.evidence.points.lengths(["vx", "vy"]);
    let end = |of: fn(f64, f64) -> f64| speeds.iter().copied().reduce(of);
    match (end(f64::min), end(f64::max)) {
        (Some(low), Some(high)) => format!(
            " The law was observed at speeds from {} to {} m/s; beyond them it is an extrapolation.",
            significant(low, 2),
            significant(high, 2)
        ),
        _ => String::new(),
    }
}
