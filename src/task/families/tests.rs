//! Properties of every built-in family's file, and the errors of invalid files.

use super::*;

/// Golden: the numbers of all scenes of the grids, 4,690 and 66 scenes, are those of the first
/// implementation.
#[test]
fn candidates_of_the_papers_families_are_unchanged() {
    let found = ["bowling", "basketball"].map(|name| {
        let family = family(name).unwrap();
        let scenes: Vec<String> = family.candidates(CANDIDATE_SEED).map(|s| s.to_json()).collect();
        assert_eq!(scenes.len(), family.draws(CANDIDATE_SEED).unwrap().candidates.len());
        let digest = scenes.iter().fold(0, |sum, scene| crate::rng::derive_seed(sum, scene, 0));
        format!("{name}: {} {digest:016x}", scenes.len())
    });
    assert_eq!(found, ["bowling: 4690 cbd816c20d093ef1", "basketball: 66 8602e0f9b41d3d11"]);
}

#[test]
fn built_in_families_parse_with_their_tasks() {
    for (text, certified) in BUILT_IN {
        let family = parse_family(text).unwrap();
        let name = family.name;
        let found = CertifiedTasks::from_json(certified).unwrap();
        assert_eq!(found.to_json(), certified.replace("\r\n", "\n"), "{name}");
        assert!(family.with_tasks(found).unwrap_or_else(|e| panic!("{name}: {e}")).tasks().len() >= 3);
    }
    assert!(family(DEFAULT_FAMILY).is_ok());
}

const SMALL: &str = r#"
format = "iplw.family/1"
name = "drop"
about = "let a ball fall into a box"

[candidates]
count = 5
require = ["w < 2 * gap"]

[candidates.parameters]
w = { low = 1, high = 2 }
n = [1, 2]
m = { from = 0, to = 1, step = 0.5 }

[candidates.values]
gap = "w + n + m"

[scene]
bodies = [{ name = "red", shape = { type = "disc", radius = 0.5 } }]
statics = [{ name = "floor", shape = { type = "box", half_width = "= gap", half_height = 0.5 } }]

[scene.goal]
type = "contact"
bodies = ["red", "floor"]

[scene.action]
components = [{ target = "red", set = "x", low = -5, high = 5 }]

[real]
density = 1
friction = 0.5
restitution = 0.5
damping = 0.9

[tasks]
train = 1
validation = 1
test = 1
sample = 50
bins = [{ from = 0.1, to = 1, tasks = 3 }]
"#;

/// Asserts that a family is rejected, and that the error contains a text.
fn assert_rejected(text: &str, wanted: &str) {
    let error = parse_family(text).map(|f| f.name).expect_err(wanted).to_string();
    assert!(error.contains(wanted), "{error:?} does not say {wanted:?}");
    assert_eq!(error.lines().count(), 1, "{error}");
}

#[test]
fn errors_name_the_invalid_field() {
    let family = parse_family(SMALL).unwrap();
    assert_eq!(family.candidates(0).count(), 5);
    assert_eq!(family.prior, [(1.0, 0.5), (0.5, 0.25), (0.5, 0.25)]);
    for (from, to, wanted) in [
        ("iplw.family/1", "iplw.family/9", "`format` is \"iplw.family/9\"; allowed: \"iplw.family/1\""),
        ("\"drop\"", "\"Drop it\"", "`name` is \"Drop it\"; allowed: 1 to 40 of a to z"),
        ("\"drop\"", "\"latents\"", "`name` is \"latents\""),
        ("\"drop\"", "3", "line 3: `name`; allowed: what iplw.family/1 allows (invalid type: integer `3`"),
        ("let a ball", "let\\na ball", "`about` is"),
        ("about =", "abuot =", "line 4: `abuot`"),
        ("[scene]", "[scene", "line 18"),
        ("count = 5", "count = 0", "`candidates.count` is 0; allowed: a whole number from 1 to 100000"),
        ("count = 5", "count = -5", "`candidates.count`"),
        ("w < 2", "w <", "`candidates.require[0]` is \"w < * gap\"; allowed: an expression (a number"),
        (
            "w < 2 * gap",
            "w > 20",
            "`candidates.require[0]` is \"w > 20\"; allowed: something that draws meet",
        ),
        ("w = {", "W = {", "`candidates.parameters.W` is \"W\""),
        ("low = 1, high = 2", "low = 1", "allowed: a list of numbers, { from, to, step } or { low, high }"),
        (
            "low = 1, high = 2",
            "low = 3, high = 2",
            "`candidates.parameters.w.high` is 2; allowed: a number from 3",
        ),
        ("low = 1, high = 2", "low = nan, high = 2", "`candidates.parameters.w.low` is NaN"),
        ("[1, 2]", "[]", "`candidates.parameters.n` is []"),
        ("[1, 2]", "[1, \"2\"]", "`candidates.parameters.n[1]` is \"2\"; allowed: a number"),
        ("step = 0.5", "step = 0", "`candidates.parameters.m` is"),
        ("step = 0.5", "step = 1e-9", "`candidates.parameters.m` is"),
        ("gap = \"", "n = \"", "`candidates.values.n` is \"n\"; allowed: a name that is not in use"),
        (
            "w + n",
            "w + q",
            "`candidates.values.gap` is \"w + q + m\"; allowed: an expression (`q` is not known",
        ),
        ("w + n + m", "w / (m - m)", "`candidates.values` is without a finite number in 2000 of 2000"),
        ("= gap", "= gap +", "`scene.statics[0].shape.half_width` is \" gap +\""),
        ("= gap", "= -gap", "`scene.statics[0].shape.half_width` is -"),
        ("radius = 0.5", "raduis = 0.5", "`scene.bodies[0].shape`"),
        ("\"floor\"]", "\"wall\"]", "`scene.goal.bodies[1]` is \"wall\""),
        ("[scene.goal]", "[scene.gaol]", "scene.gaol"),
        ("low = -5", "low = \"= -w\"", "`scene.action` is not the same in all candidates"),
        ("set = \"x\"", "set = \"radius\"", "`scene.action.components[0].low` is -5"),
        ("friction = 0.5", "friction = -1", "`real.friction` is -1; allowed: a number from 0 to 100"),
        ("friction = 0.5", "", "`real`; allowed: what iplw.family/1 allows (missing field `friction`)"),
        ("damping = 0.9", "damping = 0", "`real.damping` is 0"),
        ("sample = 50", "sample = 0", "`tasks.sample` is 0; allowed: a whole number from 10"),
        ("from = 0.1", "from = 2", "`tasks.bins[0].from` is 2; allowed: a number from 0 to 1"),
        ("tasks = 3", "tasks = 4", "`tasks.bins` is 4 in total, but train, validation and test are 3"),
        ("[real]", "[prior]\ndensity = [1, 0]\n[real]", "`prior.density[1]` is 0"),
        (
            "[real]",
            "[learning]\nbatch_size = 3\n[real]",
            "`learning.batch_size` is 3; allowed: an even number",
        ),
    ] {
        assert!(SMALL.contains(from), "{from}");
        assert_rejected(&SMALL.replacen(from, to, 1), wanted);
    }
}

#[test]
fn rejects_malformed_and_oversized_files() {
    assert_rejected("", "missing field `format`");
    assert_rejected(&SMALL.replace("[real]", "[[real]]"), "real");
    assert_rejected(&"a".repeat(2 << 20), "at most 1048576 bytes");
    let list = ["1"; 30_000].join(", ");
    assert_rejected(
        &SMALL.replace("[1, 2]", &format!("[{list}]")).replace("{ low = 1, high = 2 }", &format!("[{list}]")),
        "a larger grid",
    );
}

#[test]
fn rejects_certified_tasks_of_another_family() {
    let family = || parse_family(SMALL).unwrap();
    let row = |candidate| CertifiedRow {
        candidate,
        certificate: Certificate {
            action: vec![0.5],
            seed: 1,
            solving_share: 0.5,
            solving_share_undamped: 0.5,
        },
    };
    let good = CertifiedTasks {
        format: CERTIFIED_FORMAT.into(),
        family: "drop".into(),
        digest: family().digest.clone(),
        rows: vec![row(0), row(2), row(4)],
    };
    let tasks = family().with_tasks(good.clone()).unwrap().tasks();
    assert_eq!((tasks.len(), tasks[2].id.as_str()), (3, "drop:002"));
    let check = |change: &dyn Fn(&mut CertifiedTasks), wanted: &str| {
        let mut bad = good.clone();
        change(&mut bad);
        let error = family().with_tasks(bad).map(|f| f.name).expect_err(wanted).to_string();
        assert!(error.contains(wanted), "{error}");
    };
    check(&|c| c.digest = "0".into(), "`digest` is \"0\"");
    check(&|c| c.family = "fall".into(), "`family` is \"fall\"");
    check(&|c| drop(c.rows.pop()), "`rows` is 2 tasks; allowed: 3");
    check(&|c| c.rows[1].candidate = 5, "`rows[1].candidate` is 5; allowed: a number below 5");
    check(&|c| c.rows[2].certificate.action = vec![1.5], "`rows[2].action[0]` is 1.5");

    // Fields that do not affect the tasks may change; others may not.
    let digest = |from: &str, to: &str| parse_family(&SMALL.replace(from, to)).unwrap().digest.clone();
    assert_eq!(digest("about = ", "# a note\nabout  =  "), good.digest);
    for (from, to) in
        [("half_height = 0.5", "half_height = 0.6"), ("damping = 0.9", "damping = 0.8"), ("w <", "w <=")]
    {
        assert_ne!(digest(from, to), good.digest, "{from}");
    }
}

/// Scenes are the uncalibrated simulation: what carries latents has the prior's means, whatever the file says.
#[test]
fn scenes_of_families_have_the_prior_means() {
    let families = COLLECTIONS.iter().flat_map(|c| c.families().unwrap());
    let all: Vec<Family> = families.collect();
    for family in all.iter().chain(super::families().iter().copied()) {
        let [density, friction, restitution] = family.prior_means();
        for task in family.tasks() {
            let scene = &task.scene;
            let bodies = scene.bodies.iter().filter(|b| scene.carries_latents(&b.name));
            for body in bodies {
                assert_eq!(
                    (body.mass, body.density, body.friction, body.restitution),
                    (None, Some(density), friction, restitution),
                    "{} of {}",
                    body.name,
                    task.id
                );
            }
        }
    }
}
