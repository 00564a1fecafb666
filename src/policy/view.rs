//! How a policy looks at tasks: with features of its own family, or with those that all families share.

use super::features::{self, Features};
use super::shared::{self, Shared};
use crate::task::solid::Solid;
use crate::task::{Task, ValidAction};

/// Which features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// [`features`]: an object at a time, in the order in which the family names them. Sees boxes around things.
    Own,
    /// [`shared`]: the same numbers for every family, with shapes, what moves, and what the goal is about.
    Shared,
}

/// A task as it is looked at.
#[derive(Clone, Debug)]
pub enum Look {
    Own(Box<Features>),
    Shared(Box<Shared>),
}

impl View {
    /// What fits tasks: their family's own view if they are of one and it sees all there is: discs, and boxes that stand
    /// upright. A polygon, something turned or of several pieces it would take for the box around it.
    pub fn of(tasks: &[Task]) -> View {
        let alike = |task: &Task| task.family == tasks[0].family && !hides(task);
        if tasks.iter().all(alike) { View::Own } else { View::Shared }
    }

    /// Version of the features: a policy runs only on those it was trained on.
    pub fn version(self) -> &'static str {
        match self {
            View::Own => features::VERSION,
            View::Shared => shared::VERSION,
        }
    }

    /// The view of that version.
    pub fn from_version(version: &str) -> Option<View> {
        [View::Own, View::Shared].into_iter().find(|v| v.version() == version)
    }

    /// Reads a task's scene.
    pub fn look(self, task: &Task) -> Look {
        match self {
            View::Own => Look::Own(Box::new(Features::new(task))),
            View::Shared => Look::Shared(Box::new(Shared::new(task))),
        }
    }

    /// Numbers of scene and of action features of a task.
    pub fn dimensions(self, task: &Task) -> [usize; 2] {
        let look = self.look(task);
        let middle = task.actions().validate(&vec![0.5; task.actions().dimension()]);
        [look.scene().len(), middle.map_or(0, |a| look.action(&a).len())]
    }
}

impl Look {
    /// (n_scene,)
    pub fn scene(&self) -> Vec<f32> {
        match self {
            Look::Own(features) => features.scene(),
            Look::Shared(shared) => shared.scene(),
        }
    }

    /// (n_action,)
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        match self {
            Look::Own(features) => features.action(action),
            Look::Shared(shared) => shared.action(action),
        }
    }
}

/// Whether something that stands in the scene by itself is more than the box around it says.
fn hides(task: &Task) -> bool {
    let space = task.actions();
    let ours = |name: &str| !space.components.iter().any(|c| c.target == name);
    let bodies = task.scene.bodies.iter().filter(|b| ours(&b.name)).filter_map(|b| b.placed());
    let fixed = task.scene.statics.iter().filter(|s| ours(&s.name)).map(|s| s.placed());
    bodies.map(Solid::Bounded).chain(fixed).any(|solid| match solid {
        Solid::Bounded(pieces) => match pieces.0.as_slice() {
            [one] => one.points.len() > 1 && !upright(&one.points),
            _ => true,
        },
        Solid::HalfPlane { normal: [x, y], .. } => x.abs().min(y.abs()) > 1e-9,
    })
}

/// Whether a convex outline is an upright box, or a line along an axis.
fn upright(points: &[[f64; 2]]) -> bool {
    let alike = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0);
    let along = |p: [f64; 2], q: [f64; 2]| alike(p[0], q[0]) || alike(p[1], q[1]);
    match points {
        [p, q] => along(*p, *q),
        [a, b, c, d] => along(*a, *b) && along(*b, *c) && along(*c, *d) && along(*d, *a),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::scene::{Shape, Static};
    use crate::task::shape::Disc;
    use crate::task::{families, family};

    fn with(shape: Shape, angle: f64) -> Task {
        let mut task = toy::task(0.3);
        task.scene.statics = vec![Static {
            name: "thing".into(),
            shape,
            friction: 1.0,
            restitution: 0.5,
            position: [5.0, 5.0],
            angle,
        }];
        task
    }

    #[test]
    fn families_of_the_paper_are_seen_as_before() {
        for family in families().iter().filter(|f| ["bowling", "basketball"].contains(&f.name)) {
            assert_eq!(View::of(&family.tasks()), View::Own, "{}", family.name);
        }
        let both = [family("bowling").unwrap().tasks(), toy::tasks(1)].concat();
        assert_eq!(View::of(&both), View::Shared);
    }

    #[test]
    fn what_a_box_around_it_does_not_tell_is_looked_at_with_shapes() {
        let check = |json: &str, angle: f64, wanted: View| {
            let shape: Shape = crate::json::parse(json).unwrap();
            assert_eq!(View::of(&[with(shape, angle)]), wanted, "{json} turned by {angle}");
        };
        let square = r#"{"type": "box", "half_width": 1, "half_height": 0.2}"#;
        check(square, 0.0, View::Own);
        check(square, 0.3, View::Shared);
        check(r#"{"type": "segment", "from": [-1, 0], "to": [1, 0], "radius": 0.1}"#, 0.0, View::Own);
        check(r#"{"type": "segment", "from": [-1, 0], "to": [1, 1], "radius": 0.1}"#, 0.0, View::Shared);
        check(r#"{"type": "polygon", "vertices": [[0, 0], [1, 0], [1, 1], [0, 1]]}"#, 0.0, View::Own);
        check(r#"{"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]}"#, 0.0, View::Shared);
        check(&format!(r#"{{"type": "compound", "pieces": [{square}, {square}]}}"#), 0.0, View::Shared);
        assert_eq!(View::of(&[with(Disc { radius: 0.4 }.into(), 1.0)]), View::Own);
    }
}
