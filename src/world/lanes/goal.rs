//! The goal of a batch, in every lane.

use super::contact::{Gap, with_static};
use super::fill::radius;
use super::piece::pieces;
use super::simd::{Mask, Register, V, Wide};
use super::state::State;
use crate::task::geometry::polygon_contains;
use crate::world::effect::LANES;
use crate::world::goal::{Condition, Party};
use crate::world::prepare::Prepared;

/// A goal in every lane; all lanes' goals are of one kind and between the same parties.
pub struct GoalLanes {
    condition: ConditionLanes,
    /// Steps for which the condition has held, and must hold.
    pub held: V,
    /// The latter is infinite in lanes without a rollout or whose goal has been reached.
    pub needed: V,
}

#[expect(clippy::large_enum_variant, reason = "there is one in a batch")]
enum ConditionLanes {
    /// Squared distance of centres up to which two discs count as touching.
    Discs {
        first: usize,
        second: usize,
        reach2: V,
    },
    /// The static's pieces.
    DiscStatic {
        body: usize,
        fixed: Vec<usize>,
        tolerance: V,
    },
    /// Polygon and the box around it, by lane.
    Inside {
        body: usize,
        regions: [Vec<[f64; 2]>; LANES],
        low: [V; 2],
        high: [V; 2],
    },
    Never,
}

impl GoalLanes {
    /// Empty lanes for goals like this one.
    pub fn new(condition: &Condition, prepared: &Prepared) -> GoalLanes {
        let none = V::all(0.0);
        let condition = match condition {
            Condition::Inside { body, .. } => ConditionLanes::Inside {
                body: *body,
                regions: Default::default(),
                low: [none; 2],
                high: [none; 2],
            },
            Condition::Contact { parties, .. } => match *parties {
                [Party::Body(first), Party::Body(second)] => {
                    ConditionLanes::Discs { first, second, reach2: none }
                }
                [Party::Body(b), Party::Static(s)] | [Party::Static(s), Party::Body(b)] => {
                    let of_it = pieces(prepared).enumerate().filter(|(_, (owner, _))| *owner == s);
                    let fixed = of_it.map(|(piece, _)| piece).collect();
                    ConditionLanes::DiscStatic { body: b, fixed, tolerance: none }
                }
                [Party::Static(_), Party::Static(_)] => ConditionLanes::Never,
            },
        };
        GoalLanes { condition, held: none, needed: V::all(f64::INFINITY) }
    }

    /// Puts a rollout's goal into a lane.
    pub fn fill(&mut self, lane: usize, prepared: &Prepared) {
        let Some(own) = &prepared.goal else { return };
        self.held[lane] = 0.0;
        self.needed[lane] = f64::from(own.hold_steps(prepared.time_step));
        self.condition.fill(lane, &own.condition, prepared);
    }

    /// Leaves a lane empty.
    pub fn clear(&mut self, lane: usize) {
        self.needed[lane] = f64::INFINITY;
    }

    /// Follows the goals; whether a lane has just reached its own.
    #[inline(always)]
    pub fn judge<R: Register, const N: usize>(&mut self, state: &State) -> bool {
        let none = Wide::all(0.0);
        let holds: Mask<R, N> = match &self.condition {
            ConditionLanes::Never => return false,
            ConditionLanes::Discs { first, second, reach2 } => {
                let (a, b) = (&state.bodies[*first].moving, &state.bodies[*second].moving);
                let (dx, dy) = (Wide::load(&b.x) - Wide::load(&a.x), Wide::load(&b.y) - Wide::load(&a.y));
                (dx * dx + dy * dy).at_most(Wide::load(reach2))
            }
            ConditionLanes::DiscStatic { body, fixed, tolerance } => {
                let within = |piece: &usize| {
                    let gap: Gap<R, N> = with_static(&state.bodies[*body], &state.statics[*piece]);
                    gap.separation.at_most(Wide::load(tolerance))
                };
                let first = within(&fixed[0]);
                fixed[1..].iter().fold(first, |any, piece| any.or(within(piece)))
            }
            ConditionLanes::Inside { body, regions, low, high } => {
                let at = &state.bodies[*body].moving;
                let (x, y) = (Wide::load(&at.x), Wide::load(&at.y));
                let across = Wide::load(&low[0]).at_most(x).and(x.at_most(Wide::load(&high[0])));
                let near = across.and(Wide::load(&low[1]).at_most(y)).and(y.at_most(Wide::load(&high[1])));
                if near.any() {
                    let mut holds = V::all(0.0);
                    for l in 0..LANES {
                        holds[l] = f64::from(u8::from(polygon_contains(&regions[l], [at.x[l], at.y[l]])));
                    }
                    near.and(none.less(Wide::load(&holds)))
                } else {
                    near
                }
            }
        };
        let held = holds.select(Wide::load(&self.held) + Wide::all(1.0), none);
        held.store(&mut self.held);
        Wide::load(&self.needed).at_most(held).any()
    }

    /// After how many more steps like the last one the goal is reached.
    pub fn steps_to_go(&self, lane: usize) -> Option<u32> {
        let unsolved = self.held[lane] > 0.0 && self.needed[lane].is_finite();
        unsolved.then(|| (self.needed[lane] - self.held[lane]) as u32)
    }
}

impl ConditionLanes {
    fn fill(&mut self, lane: usize, own: &Condition, prepared: &Prepared) {
        match (self, own) {
            (ConditionLanes::Discs { first, second, reach2 }, Condition::Contact { tolerance, .. }) => {
                let radii = radius(&prepared.bodies[*first]) + radius(&prepared.bodies[*second]);
                reach2[lane] = (radii + tolerance) * (radii + tolerance);
            }
            (ConditionLanes::DiscStatic { tolerance, .. }, Condition::Contact { tolerance: own, .. }) => {
                tolerance[lane] = *own;
            }
            (ConditionLanes::Inside { regions, low, high, .. }, Condition::Inside { region, .. }) => {
                for k in 0..2 {
                    low[k][lane] = region.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
                    high[k][lane] = region.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
                }
                regions[lane].clone_from(region);
            }
            _ => {}
        }
    }
}
