//! The next step after a diagnosis, by its verdict.

use crate::inference::report::{Diagnosis, Verdict};
use crate::picture::report::Block;
use crate::report::words::{plain_names, sentence};

/// The next step, on a card.
pub fn next_step(d: &Diagnosis) -> Block {
    let mut steps = Vec::new();
    match d.verdict {
        Verdict::Named => steps.push(
            "Use the extended scene (extended_scene.json) in place of the scene: it contains the law with these values. Estimate, plan and \
             train in it."
                .to_string(),
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
    Block::Card { heading: "What to do next".into(), blocks: vec![Block::List(steps)] }
}
