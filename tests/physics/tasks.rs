//! The built-in tasks: numbers, splits, certificates and actions.

use iplw::reality::certify::{PERTURBATIONS, is_certificate_valid};
use iplw::task::{COLLECTIONS, Placement, Split, Task, families, family, read_families};
use iplw::world::Engine;

fn each_task(mut check: impl FnMut(&'static iplw::task::Family, &Task)) {
    for family in families() {
        for task in family.tasks() {
            check(family, &task);
        }
    }
}

#[test]
fn numbers_and_splits_match_the_paper() {
    for (name, splits, actions) in [("bowling", [60, 20, 20], 50_000), ("basketball", [15, 5, 5], 40_000)] {
        let tasks = family(name).unwrap().tasks();
        let counts = [Split::Train, Split::Validation, Split::Test]
            .map(|s| tasks.iter().filter(|t| t.split == s).count());
        assert_eq!(counts, splits, "{name}");
        assert!(tasks.iter().all(|t| t.actions().count() == actions));
    }
}

#[test]
fn scenes_are_valid_distinct_and_round_trip() {
    let mut seen = Vec::new();
    each_task(|_, task| {
        task.scene.validate().unwrap();
        let again = iplw::task::Scene::from_json(&task.scene.to_json()).unwrap();
        assert_eq!(again, task.scene, "{}", task.id);
        assert!(!seen.contains(&task.scene), "{} stands twice", task.id);
        seen.push(task.scene.clone());
    });
}

/// Every certificate, with the engine that serves tasks: the action and its perturbed copies solve.
#[test]
fn certificates_hold() {
    let mut failed = Vec::new();
    let mut count = 0;
    each_task(|family, task| {
        let certificate = task.certificate.as_ref().expect("built-in tasks are certified");
        count += 1;
        if !is_certificate_valid(family, &task.scene, certificate, Engine::Auto).unwrap() {
            failed.push(task.id.clone());
        }
    });
    // The perturbations differ from those of the search: a solution near the edge of its basin may lose
    // one of them. More than a few failures would mean that the certificates no longer match the physics.
    assert!(
        failed.len() * 20 <= count,
        "{} of {count} fail under {PERTURBATIONS} new perturbations: {failed:?}",
        failed.len()
    );
}

#[test]
fn solving_shares_are_in_phyres_range() {
    let of = |name: &str| {
        let tasks = family(name).unwrap().tasks();
        let mut shares: Vec<[f64; 2]> = tasks
            .iter()
            .map(|t| t.certificate.as_ref().map(|c| [c.solving_share, c.solving_share_undamped]).unwrap())
            .collect();
        shares.sort_by(|a, b| a[1].total_cmp(&b[1]));
        shares
    };
    let bowling = of("bowling");
    let mean = bowling.iter().map(|s| s[1]).sum::<f64>() / 100.0;
    assert!(bowling.iter().all(|s| (0.001..=0.23).contains(&s[1])));
    assert!(
        (0.081..=0.101).contains(&mean) && (0.079..=0.099).contains(&bowling[50][1]),
        "mean {mean}, median {}",
        bowling[50][1]
    );
    assert!(of("basketball").iter().all(|s| (0.002..=0.10).contains(&s[0])));
}

/// An action is placed or not, without error, and placed objects lie within bounds.
#[test]
fn every_action_is_placed_or_rejected() {
    each_task(|_, task| {
        let space = task.actions();
        let mut valid = 0;
        for index in (0..space.count()).step_by(space.count() / 50) {
            if let Placement::Valid(scene) = task.place(&space.at(index).unwrap()) {
                valid += 1;
                assert!(scene.bodies.iter().all(|b| b.position.is_some()));
                scene.validate().unwrap();
            }
        }
        assert!(valid >= 20, "{}: only {valid} of 50 actions can be placed", task.id);
    });
}

#[test]
fn rejects_actions_outside_the_space_by_name() {
    let task = &family("bowling").unwrap().tasks()[0];
    for (action, wanted) in [
        (vec![0.5, 0.5], "2 numbers"),
        (vec![0.5, 0.5, 1.5], "action[2]"),
        (vec![0.5, f64::NAN, 0.5], "action[1]"),
        (vec![f64::INFINITY, 0.5, 0.5], "action[0]"),
        (vec![-0.1, 0.5, 0.5], "action[0]"),
    ] {
        let error = task.actions().validate(&action).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
    assert!(task.actions().at(50_000).unwrap_err().to_string().contains("49999"));
}

/// The example families parse like users' families and have valid certificates.
#[test]
fn example_families_have_valid_certificates() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/families");
    let found = read_families(&folder).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.iter().map(|f| f.name).collect::<Vec<_>>(), ["bank", "shelf", "topple", "two_balls"]);
    for family in found {
        let tasks = family.tasks();
        let held = |t: &&Task| {
            is_certificate_valid(&family, &t.scene, t.certificate.as_ref().unwrap(), Engine::Auto).unwrap()
        };
        let count = tasks.iter().filter(held).count();
        // As above: a solution near the edge of its basin may fail a new perturbation.
        assert!(count + 1 >= tasks.len(), "{}: {count} of {}", family.name, tasks.len());
        assert!(tasks.iter().any(|t| t.split == Split::Test));
    }
}

/// Three tasks of each family of the collections: the first, a middle and the last certified one.
#[test]
fn collections_have_valid_certificates() {
    let (mut failed, mut count) = (Vec::new(), 0);
    for family in COLLECTIONS.iter().flat_map(|c| c.families().unwrap_or_else(|e| panic!("{}: {e}", c.name)))
    {
        let tasks = family.tasks();
        assert!(tasks.iter().any(|t| t.split == Split::Test), "{}", family.name);
        for task in [0, tasks.len() / 2, tasks.len() - 1].map(|i| &tasks[i]) {
            count += 1;
            if !is_certificate_valid(&family, &task.scene, task.certificate.as_ref().unwrap(), Engine::Auto)
                .unwrap()
            {
                failed.push(task.id.clone());
            }
        }
    }
    // As above: a solution near the edge of its basin may fail a new perturbation.
    assert!(
        failed.len() * 10 <= count,
        "{} of {count} fail under new perturbations: {failed:?}",
        failed.len()
    );
}
