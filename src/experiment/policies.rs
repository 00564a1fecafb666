//! The study of policies that know what is not known: at the point, over draws, and tuned on what was measured.
//!
//! Past the source, which trains at the point of exact trials.

use super::EstimateConfig;
use super::past_point::{NOISE, POLICIES, WITH_DRAG, WITHOUT};
use super::strategies::Arm;
use super::study::{Study, with_drag};
use crate::task::Family;

impl Study {
    /// Of 20 interactions seen with 5 mm of noise: where the simulation knows that there may be drag, and where it does not.
    pub fn policies(family: &Family) -> Study {
        let mut study = Study::base(POLICIES, family);
        study.hidden.noise = NOISE;
        let few =
            EstimateConfig { rounds: 4, actions: 5, settled: 0.0, ..EstimateConfig::fast(family.prior) };
        study.arms = vec![
            Arm { name: WITH_DRAG.into(), estimate: with_drag(few.clone()) },
            Arm { name: WITHOUT.into(), estimate: few },
        ];
        study.rounds = vec![4];
        study.past_point = study.arms.iter().map(|arm| arm.name.clone()).collect();
        study
    }
}
