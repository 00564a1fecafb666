//! Study of policies under parameter uncertainty: trained at the point estimate, over posterior draws, and fine-tuned on measurements.
//!
//! Beyond the source, which trains at the point estimate from noise-free trials.

use super::EstimateConfig;
use super::posterior_training::{MEASUREMENT_NOISE_SD_M, POLICIES, WITH_DRAG, WITHOUT_DRAG};
use super::strategies::Arm;
use super::study::{Study, with_drag};
use crate::task::Family;

impl Study {
    /// 20 interactions with 5 mm of measurement noise, with and without drag as a parameter of the simulation.
    pub fn policies(family: &Family) -> Study {
        let mut study = Study::base(POLICIES, family);
        study.hidden.noise = MEASUREMENT_NOISE_SD_M;
        let few =
            EstimateConfig { rounds: 4, actions: 5, settled: 0.0, ..EstimateConfig::fast(family.prior) };
        study.arms = vec![
            Arm { name: WITH_DRAG.into(), estimate: with_drag(few.clone()) },
            Arm { name: WITHOUT_DRAG.into(), estimate: few },
        ];
        study.rounds = vec![4];
        study.past_point = study.arms.iter().map(|arm| arm.name.clone()).collect();
        study
    }
}
