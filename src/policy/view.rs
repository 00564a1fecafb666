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

/// Whether every corner of a convex outline is one of the box around it.
fn upright(points: &[[f64; 2]]) -> bool {
    let end = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick);
    let at_end = |axis: usize, v: f64| {
        let (low, high) = (end(axis, f64::min), end(axis, f64::max));
        low.zip(high).is_some_and(|(l, h)| (v - l).abs().min((v - h).abs()) <= 1e-9 * (h - l).max(1.0))
    };
    points.iter().all(|[x, y]| at_end(0, *x) && at_end(1, *y))
        // A line from corner to corner is upright only if it is as thin as the box.
        && (points.len() > 2 || points.windows(2).all(|p| p[0][0] == p[1][0] || p[0][1] == p[1][1]))
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
        check(r#"{"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]}"#, 0.0, View::Shared);
        check(&format!(r#"{{"type": "compound", "pieces": [{square}, {square}]}}"#), 0.0, View::Shared);
        assert_eq!(View::of(&[with(Disc { radius: 0.4 }.into(), 1.0)]), View::Own);
    }
}
