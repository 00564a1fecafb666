//! Choice between family-specific and generic features.

use super::family_features::{self, FamilyFeatures};
use super::generic_features::{self, GenericFeatures};
use crate::task::solid::Solid;
use crate::task::{Task, ValidAction};

/// Feature set of a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeatureSet {
    /// [`family_features`]: one object at a time, in the family's order, represented by its bounding box.
    Family,
    /// [`generic_features`]: the same features for every family, with shapes, movability and roles in the goal.
    Generic,
}

/// Features of a task's scene and actions.
#[derive(Clone, Debug)]
pub enum FeatureExtractor {
    Family(Box<FamilyFeatures>),
    Generic(Box<GenericFeatures>),
}

impl FeatureSet {
    /// The feature set for tasks: family-specific features if all tasks are of one family and bounding boxes represent their
    /// objects exactly (discs and axis-aligned boxes), otherwise generic features.
    pub fn of(tasks: &[Task]) -> FeatureSet {
        let alike = |task: &Task| task.family == tasks[0].family && !has_hidden_shape(task);
        if tasks.iter().all(alike) { FeatureSet::Family } else { FeatureSet::Generic }
    }

    /// Version of the features; a policy needs the version that it was trained with.
    pub fn version(self) -> &'static str {
        match self {
            FeatureSet::Family => family_features::VERSION,
            FeatureSet::Generic => generic_features::VERSION,
        }
    }

    /// The feature set with this version.
    pub fn from_version(version: &str) -> Option<FeatureSet> {
        [FeatureSet::Family, FeatureSet::Generic].into_iter().find(|v| v.version() == version)
    }

    /// Feature extractor for a task.
    pub fn extractor(self, task: &Task) -> FeatureExtractor {
        match self {
            FeatureSet::Family => FeatureExtractor::Family(Box::new(FamilyFeatures::new(task))),
            FeatureSet::Generic => FeatureExtractor::Generic(Box::new(GenericFeatures::new(task))),
        }
    }

    /// Dimensions of the scene and action features of a task.
    pub fn dimensions(self, task: &Task) -> [usize; 2] {
        let look = self.extractor(task);
        let middle = task.actions().validate(&vec![0.5; task.actions().dimension()]);
        [look.scene().len(), middle.map_or(0, |a| look.action(&a).len())]
    }
}

impl FeatureExtractor {
    /// (n_scene,) scene features.
    pub fn scene(&self) -> Vec<f32> {
        match self {
            FeatureExtractor::Family(features) => features.scene(),
            FeatureExtractor::Generic(shared) => shared.scene(),
        }
    }

    /// (n_action,) action features.
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        match self {
            FeatureExtractor::Family(features) => features.action(action),
            FeatureExtractor::Generic(shared) => shared.action(action),
        }
    }
}

/// Whether an object of the scene is not represented exactly by its bounding box.
fn has_hidden_shape(task: &Task) -> bool {
    let space = task.actions();
    let ours = |name: &str| !space.components.iter().any(|c| c.target == name);
    let bodies = task.scene.bodies.iter().filter(|b| ours(&b.name)).filter_map(|b| b.placed());
    let fixed = task.scene.statics.iter().filter(|s| ours(&s.name)).map(|s| s.placed());
    bodies.map(Solid::Bounded).chain(fixed).any(|solid| match solid {
        Solid::Bounded(pieces) => match pieces.0.as_slice() {
            [one] => one.points.len() > 1 && !is_axis_aligned(&one.points),
            _ => true,
        },
        Solid::HalfPlane { normal: [x, y], .. } => x.abs().min(y.abs()) > 1e-9,
    })
}

/// Whether a convex outline is an axis-aligned box or line.
fn is_axis_aligned(points: &[[f64; 2]]) -> bool {
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
    fn paper_families_use_family_features() {
        for family in families().iter().filter(|f| ["bowling", "basketball"].contains(&f.name)) {
            assert_eq!(FeatureSet::of(&family.tasks()), FeatureSet::Family, "{}", family.name);
        }
        let both = [family("bowling").unwrap().tasks(), toy::tasks(1)].concat();
        assert_eq!(FeatureSet::of(&both), FeatureSet::Generic);
    }

    #[test]
    fn shapes_beyond_boxes_use_generic_features() {
        let check = |json: &str, angle: f64, wanted: FeatureSet| {
            let shape: Shape = crate::json::parse(json).unwrap();
            assert_eq!(FeatureSet::of(&[with(shape, angle)]), wanted, "{json} turned by {angle}");
        };
        let square = r#"{"type": "box", "half_width": 1, "half_height": 0.2}"#;
        check(square, 0.0, FeatureSet::Family);
        check(square, 0.3, FeatureSet::Generic);
        check(
            r#"{"type": "segment", "from": [-1, 0], "to": [1, 0], "radius": 0.1}"#,
            0.0,
            FeatureSet::Family,
        );
        check(
            r#"{"type": "segment", "from": [-1, 0], "to": [1, 1], "radius": 0.1}"#,
            0.0,
            FeatureSet::Generic,
        );
        check(
            r#"{"type": "polygon", "vertices": [[0, 0], [1, 0], [1, 1], [0, 1]]}"#,
            0.0,
            FeatureSet::Family,
        );
        check(r#"{"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]}"#, 0.0, FeatureSet::Generic);
        check(
            &format!(r#"{{"type": "compound", "pieces": [{square}, {square}]}}"#),
            0.0,
            FeatureSet::Generic,
        );
        assert_eq!(FeatureSet::of(&[with(Disc { radius: 0.4 }.into(), 1.0)]), FeatureSet::Family);
    }
}
