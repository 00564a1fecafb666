//! Loads goals into lanes.

use super::super::contact_pair::NEVER_TOUCHED;
use super::super::goal::{ConditionLanes, GoalLanes};
use crate::world::compile::RolloutModel;
use crate::world::goal::GoalCondition;

impl GoalLanes {
    /// Loads a rollout's goal into a lane.
    pub fn fill(&mut self, lane: usize, model: &RolloutModel) {
        let Some(own) = &model.goal else { return };
        self.held[lane] = 0.0;
        self.needed[lane] = f64::from(own.hold_steps(model.time_step));
        if let (Some(counts), GoalCondition::Apart { after_touch, .. }) = (&mut self.apart, &own.condition) {
            counts[lane] = if *after_touch { 0.0 } else { 1.0 };
        }
        self.condition.fill(lane, &own.condition, model);
    }
}

impl ConditionLanes {
    fn fill(&mut self, lane: usize, own: &GoalCondition, model: &RolloutModel) {
        match (self, own) {
            (
                ConditionLanes::Discs { first, second, reach2 },
                GoalCondition::Contact { tolerance, .. } | GoalCondition::Apart { tolerance, .. },
            ) => {
                let radius = |i: usize| model.bodies[i].shape.disc_radius().expect("made for discs only");
                let radii = radius(*first) + radius(*second);
                reach2[lane] = (radii + tolerance) * (radii + tolerance);
            }
            (
                ConditionLanes::Outlines { limit, tolerance, .. },
                GoalCondition::Contact { tolerance: own, .. } | GoalCondition::Apart { tolerance: own, .. },
            ) => {
                (limit[lane], tolerance[lane]) = (NEVER_TOUCHED, *own);
            }
            (
                ConditionLanes::DiscStatic { tolerance, .. },
                GoalCondition::Contact { tolerance: own, .. } | GoalCondition::Apart { tolerance: own, .. },
            ) => {
                tolerance[lane] = *own;
            }
            (ConditionLanes::Inside { regions, low, high, .. }, GoalCondition::Inside { region, .. }) => {
                for k in 0..2 {
                    low[k][lane] = region.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
                    high[k][lane] = region.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
                }
                regions[lane].clone_from(region);
            }
            (
                ConditionLanes::Above { normal: [nx, ny], offset, radius, .. },
                GoalCondition::Above { body, normal, offset: own, .. },
            ) => {
                (nx[lane], ny[lane], offset[lane]) = (normal[0], normal[1], *own);
                radius[lane] = model.bodies[*body].shape.disc_radius().unwrap_or(0.0);
            }
            _ => {}
        }
    }
}
