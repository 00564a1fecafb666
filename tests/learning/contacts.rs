//! Motions with contacts: nothing is named where nothing is hidden, and what is wrong in the scene is found.

use iplw::inference::report::{Diagnosis, Verdict};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;

use crate::worlds::contact_motion::{ContactWorld, KINDS, Wrong, contact_world};

const SEED: u64 = 401;

fn diagnosed(world: &ContactWorld) -> Diagnosis {
    let found = diagnose(&world.scene, &world.trials, &DiagnosisConfig::standard(SEED), &NoProgress);
    found.expect("a diagnosis").diagnosis
}

/// The diagnosis of a wrong scene, with the quantity that is wrong and its value in nature.
fn diagnosed_wrong(kind: &str, wrong: Wrong) -> (Diagnosis, &'static str, f64) {
    let world = contact_world(kind, wrong, SEED);
    let (name, truth) = world.wrong.expect("a wrong quantity");
    (diagnosed(&world), name, truth)
}

#[test]
fn nothing_is_named_where_nothing_is_hidden() {
    for kind in KINDS {
        let found = diagnosed(&contact_world(kind, Wrong::Nothing, SEED));
        assert_eq!(found.verdict, Verdict::None, "{kind}: {}", found.reason);
        // Impacts of two corners at once are not used, and bounces too low to be seen neither.
        let unused = !found.unused_contacts.is_empty();
        match kind {
            "tossed_box" => assert!(unused),
            "two_discs" | "two_balls" | "block_to_rest" => assert!(!unused, "{:?}", found.unused_contacts),
            _ => {}
        }
    }
}

/// Friction of slides and restitution of collisions are latents: their intervals hold the truth, and nothing is named.
#[test]
fn wrong_coefficients_are_estimated() {
    for (kind, wrong) in [
        ("slide_to_roll", Wrong::Friction),
        ("block_to_rest", Wrong::Friction),
        ("two_balls", Wrong::Restitution),
        ("two_gliders", Wrong::Restitution),
        ("tossed_box", Wrong::Restitution),
        ("two_blocks", Wrong::Restitution),
    ] {
        let (found, name, truth) = diagnosed_wrong(kind, wrong);
        assert_eq!(found.verdict, Verdict::None, "{kind}: {}", found.reason);
        let latent = found.calibrated.iter().find(|c| c.name == name).unwrap();
        let [Some(low), Some(high)] = latent.ci95 else { panic!("{kind}: {latent:?}") };
        // The interval and as much on either side.
        let half = 0.5 * (high - low);
        assert!((low - half..high + half).contains(&truth) && half < 0.05, "{kind}: {latent:?} for {truth}");
    }
}

#[test]
fn wrong_masses_inertias_and_thresholds_are_named() {
    for (kind, wrong) in [
        ("two_discs", Wrong::MassRatio),
        ("roll_on_incline", Wrong::Inertia),
        ("bouncing_ball", Wrong::Threshold),
    ] {
        let (found, name, truth) = diagnosed_wrong(kind, wrong);
        let (effect, _) = name.split_once('.').unwrap();
        let sets = &found.rivals;
        assert!(sets.iter().any(|set| set == &[effect]), "{kind}: {sets:?}, {}", found.reason);
        if let Some(own) = found.effects.iter().find(|e| e.name == effect) {
            let [Some(low), Some(high)] = own.parameters[0].ci95 else { panic!("{kind}: {own:?}") };
            assert!((0.95 * low..1.05 * high).contains(&truth), "{kind}: {own:?} for {truth}");
            assert!(high / low < 1.6, "{kind}: {own:?}");
        }
    }
}
