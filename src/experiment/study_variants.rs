//! Variants of a study: another hidden world, drag among the fitted parameters, fewer strategies.

use super::study::{Study, TRUE_LATENTS, TRUE_PHYSICS, with_drag};
use super::transfer::PolicySource;
use crate::error::Result;
use crate::explore::strategy;
use crate::policy::TrainingPhysics;
use crate::reality::HiddenConfig;

impl Study {
    /// The study in another hidden world, to which the rows of the true latents and the true physics refer.
    pub fn in_world(mut self, hidden: HiddenConfig) -> Study {
        let fixed = |effects| PolicySource::Simulated {
            training: TrainingPhysics::Fixed { latents: hidden.latents, effects },
        };
        for (row, school) in &mut self.schools {
            match row.as_str() {
                TRUE_LATENTS => *school = fixed(Vec::new()),
                TRUE_PHYSICS => *school = fixed(hidden.effects.clone()),
                _ => {}
            }
        }
        self.hidden = hidden;
        self
    }

    /// The study with the coefficient of linear drag estimated in every arm, with its weak prior.
    pub fn with_drag_fitted(mut self) -> Study {
        for arm in &mut self.arms {
            arm.estimate = with_drag(arm.estimate.clone());
        }
        self
    }

    /// The study with only those of the paper's arms whose strategy is named. An unknown name is an error.
    pub fn with_strategies(mut self, names: &[String]) -> Result<Study> {
        names.iter().try_for_each(|name| strategy(name).map(|_| ()))?;
        self.arms.retain(|arm| names.contains(&arm.name));
        self.diagnosed.retain(|name| names.contains(name));
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reality::standard;
    use crate::task::family;
    use crate::world::effect;

    #[test]
    fn variants_change_only_what_they_name() {
        let family = family("basketball").unwrap();
        let paper = Study::strategies(family);
        let hidden = HiddenConfig { effects: vec![effect::damping(0.95)], ..standard(family) };
        let physics = |study: &Study| study.schools.iter().find(|s| s.0 == TRUE_PHYSICS).unwrap().1.clone();
        let other = paper.clone().in_world(hidden.clone());
        assert_eq!(other.hidden, hidden);
        assert_ne!(physics(&other), physics(&paper));
        assert_eq!(other.clone().in_world(paper.hidden.clone()), paper);

        let drag = paper.clone().with_drag_fitted();
        assert!(drag.arms.iter().all(|a| a.estimate.cem.drag.is_some()));
        assert_eq!((&drag.hidden, &drag.schools), (&paper.hidden, &paper.schools));

        let few = paper.clone().with_strategies(&["rolling".into(), "mixed".into()]).unwrap();
        assert_eq!(few.arms.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(), ["rolling", "mixed"]);
        assert_eq!(few.afterwards().count(), 0);
        let unknown = paper.with_strategies(&["psychic".into()]).unwrap_err().to_string();
        assert!(unknown.contains("psychic") && unknown.contains("mixed"), "{unknown}");
    }

    #[test]
    fn a_study_without_learning_trials_has_estimates_but_no_policies() {
        let family = family("basketball").unwrap();
        let study = Study { trials: 0, ..Study::strategies(family) };
        study.validate().unwrap();
        let none = Vec::new();
        assert!(study.cells(&[]).is_empty() && study.rows(&none, &[]).is_empty());
    }
}
