//! Toy tasks without physics, for tests: a disc is placed above a resting ball, and a geometric rule determines the solving actions.
//! The rule is mirrored between tasks, so a policy that memorises one task fails on the next.

use super::data::{Dataset, Example};
use super::outcome_table::OutcomeTable;
use crate::task::action::{ActionComponent, ActionQuantity, ActionSpace, Discretisation};
use crate::task::scene::{Body, Goal, Scene};
use crate::task::shape::Disc;
use crate::task::{Split, Task, ValidAction};

/// A 10 m wide scene with a ball at `x` (share of the width) and a second ball on the side with more space.
pub fn task(x: f64) -> Task {
    let ball = |name: &str, position: Option<[f64; 2]>| Body {
        name: name.into(),
        shape: Disc { radius: 0.5 }.into(),
        mass: None,
        density: None,
        friction: 0.5,
        restitution: 0.5,
        position,
        angle: 0.0,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
        inertia: None,
    };
    let partner = if x < 0.5 { x + 0.35 } else { x - 0.35 };
    let set = |set, low, high| ActionComponent { target: "red".into(), set, low, high };
    let scene = Scene {
        name: format!("toy {x}"),
        bodies: vec![
            ball("green", Some([10.0 * x, 0.5])),
            ball("blue", Some([10.0 * partner, 0.5])),
            ball("red", None),
        ],
        goal: Some(Goal::Contact {
            bodies: ["green".into(), "blue".into()],
            hold_s: 0.0,
            tolerance: 0.01,
            stop: None,
        }),
        action: Some(ActionSpace {
            components: vec![
                set(ActionQuantity::X, 0.0, 10.0),
                set(ActionQuantity::Y, 2.0, 10.0),
                set(ActionQuantity::Radius, 0.1, 1.0),
            ],
            bounds: Some([-1.0, 0.0, 11.0, 11.0]),
            discrete: Discretisation::Sequence { count: 5000 },
        }),
        ..Scene::empty()
    };
    scene.validate().expect("a toy scene is valid");
    Task { id: format!("toy:{x}"), family: "toy".into(), split: Split::Train, scene, certificate: None }
}

/// The rule: red falls on the half of green that faces away from blue, and is not too small.
pub fn solves(task: &Task, action: &ValidAction) -> bool {
    let x = |i: usize| task.scene.bodies[i].position.map_or(0.0, |p| p[0]);
    let v = action.values();
    let radius = 0.1 + 0.9 * v[2];
    let offset = (10.0 * v[0] - x(0)) / (radius + 0.5) * (x(0) - x(1)).signum();
    (0.1..0.7).contains(&offset) && radius > 0.3
}

/// `per_task` labelled actions of each task.
pub fn dataset(tasks: &[Task], per_task: usize) -> Dataset {
    let mut rows = Vec::new();
    for (t, task) in tasks.iter().enumerate() {
        for i in 0..per_task {
            let action = task.actions().at((i * 37 + t * 101) % 5000).expect("an index below 5000");
            let solved = solves(task, &action);
            rows.push(Example { task: t, action, solved });
        }
    }
    Dataset { tasks: tasks.to_vec(), rows }
}

/// A table of the first `actions` actions in `tasks`; `outcome` maps the indices of task and action to a code.
pub fn table(
    family: &str,
    tasks: &[Task],
    actions: usize,
    outcome: impl Fn(usize, usize) -> i8,
) -> OutcomeTable {
    let tasks: Vec<Task> = tasks
        .iter()
        .map(|t| Task { family: family.into(), id: t.id.replace("toy", family), ..t.clone() })
        .collect();
    let chosen = (0..actions).map(|i| tasks[0].actions().at(i).expect("an index below 5000")).collect();
    let outcomes = (0..tasks.len()).flat_map(|t| (0..actions).map(move |i| (t, i)));
    let outcomes = outcomes.map(|(t, i)| outcome(t, i)).collect();
    OutcomeTable::new(family, tasks, chosen, outcomes).expect("a toy table is valid")
}

/// A table of outcomes by the toy rule.
pub fn ruled(family: &str, tasks: &[Task], actions: usize) -> OutcomeTable {
    let action = |t: usize, i: usize| tasks[t].actions().at(i).expect("an index below 5000");
    table(family, tasks, actions, |t, i| if solves(&tasks[t], &action(t, i)) { 1 } else { -1 })
}

/// `n` tasks with the ball at different positions.
pub fn tasks(n: usize) -> Vec<Task> {
    (0..n).map(|i| task(0.06 + 0.88 * (i as f64 + 0.5) / n as f64)).collect()
}
