//! Goal evaluation in every lane of a batch.

use super::contact_pair::{NEVER_TOUCHED, TRAVEL_TOLERANCE_M};
use super::disc_separation::{DiscSeparation, may_touch, with_static};
use super::outline::{OutlineCore, update_outlines};
use super::outline_separation::{closest, lowest};
use super::simd::{Mask, Register, V, Wide};
use super::state::{BatchState, BodyLanes};
use super::topology::{GoalTopology, Topology};
use crate::task::geometry::polygon_contains;
use crate::world::effect::LANES;

/// Maximum number of points of a region in a thread of a graphics processor.
pub const MAX_REGION_POINTS: usize = 16;

/// Goals in all lanes, of the same kind and between the same objects.
pub struct GoalLanes {
    pub condition: ConditionLanes,
    /// For `apart` goals: whether the time apart counts (0 or 1), which it may do only after a contact.
    pub apart: Option<V>,
    /// Steps for which the condition has held, and must hold.
    pub held: V,
    /// The latter is infinite in lanes without a rollout or with a reached goal.
    pub needed: V,
}

/// The condition in all lanes.
pub enum ConditionLanes {
    /// Squared centre distance up to which two discs count as touching.
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
    /// A body, and a body or a static after all bodies, at least one of them not a disc; and the sum of
    /// both bodies' `travel` below which they cannot be near enough.
    Outlines {
        between: [usize; 2],
        limit: V,
        tolerance: V,
    },
    /// Polygon and its bounding box, by lane.
    Inside {
        body: usize,
        regions: [Vec<[f64; 2]>; LANES],
        low: [V; 2],
        high: [V; 2],
    },
    /// A body, or its frame's origin, and the line that it must be above. `radius` is that of a disc if
    /// all bodies are discs.
    Above {
        body: usize,
        whole: bool,
        normal: [V; 2],
        offset: V,
        radius: V,
    },
    Never,
}

impl GoalLanes {
    /// Empty lanes for goals of a topology; `None` if it has no goal.
    pub fn new(topology: &Topology) -> Option<GoalLanes> {
        let none = V::all(0.0);
        let goal = topology.goal?;
        let condition = match goal {
            GoalTopology::Above { body, whole } => {
                ConditionLanes::Above { body, whole, normal: [none; 2], offset: none, radius: none }
            }
            GoalTopology::Inside { body } => {
                ConditionLanes::Inside { body, regions: Default::default(), low: [none; 2], high: [none; 2] }
            }
            GoalTopology::Contact { objects } | GoalTopology::Apart { objects } => {
                ConditionLanes::between(objects, topology)
            }
        };
        let apart = matches!(goal, GoalTopology::Apart { .. }).then_some(none);
        Some(GoalLanes { condition, apart, held: none, needed: V::all(f64::INFINITY) })
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        self.needed[lane] = f64::INFINITY;
    }

    /// Discards the distance bound of a lane's objects after one of them was moved.
    pub fn reset_limit(&mut self, lane: usize) {
        if let ConditionLanes::Outlines { limit, .. } = &mut self.condition {
            limit[lane] = NEVER_TOUCHED;
        }
    }

    /// Evaluates the goals; whether a lane has just reached its own.
    #[inline(always)]
    pub fn update<R: Register, const N: usize>(&mut self, state: &mut BatchState) -> bool {
        let none = Wide::all(0.0);
        let holds: Mask<R, N> = match &mut self.condition {
            ConditionLanes::Never => return false,
            ConditionLanes::Discs { first, second, reach2 } => {
                let (a, b) = (&state.bodies[*first].moving, &state.bodies[*second].moving);
                let (dx, dy) = (Wide::load(&b.x) - Wide::load(&a.x), Wide::load(&b.y) - Wide::load(&a.y));
                (dx * dx + dy * dy).at_most(Wide::load(reach2))
            }
            ConditionLanes::DiscStatic { body, fixed, tolerance } => {
                let mut least = Wide::all(f64::INFINITY);
                for piece in fixed {
                    let gap: DiscSeparation<R, N> = with_static(&state.bodies[*body], &state.statics[*piece]);
                    least = gap.separation.below(least);
                }
                least.at_most(Wide::load(tolerance))
            }
            ConditionLanes::Outlines { between, limit, tolerance } => {
                match within::<R, N>(state, *between, limit, tolerance) {
                    Some(within) => within,
                    None => none.less(none),
                }
            }
            ConditionLanes::Above { body, whole, normal, offset, radius } => {
                let normal = [Wide::load(&normal[0]), Wide::load(&normal[1])];
                let height: Wide<R, N> = if *whole {
                    min_along(state, *body, normal, radius)
                } else {
                    let [x, y]: [Wide<R, N>; 2] = origin(state, *body);
                    normal[0] * x + normal[1] * y
                };
                Wide::load(offset).at_most(height)
            }
            ConditionLanes::Inside { body, regions, low, high } => {
                let [x, y]: [Wide<R, N>; 2] = origin(state, *body);
                let across = Wide::load(&low[0]).at_most(x).and(x.at_most(Wide::load(&high[0])));
                let near = across.and(Wide::load(&low[1]).at_most(y)).and(y.at_most(Wide::load(&high[1])));
                if near.any() {
                    let (mut holds, mut px, mut py) = (V::all(0.0), V::all(0.0), V::all(0.0));
                    x.store(&mut px);
                    y.store(&mut py);
                    for l in 0..LANES {
                        holds[l] = f64::from(u8::from(polygon_contains(&regions[l], [px[l], py[l]])));
                    }
                    near.and(none.less(Wide::load(&holds)))
                } else {
                    near
                }
            }
        };
        let holds = match &mut self.apart {
            None => holds,
            Some(counts) => parted(holds, counts),
        };
        let held = holds.select(Wide::load(&self.held) + Wide::all(1.0), none);
        held.store(&mut self.held);
        Wide::load(&self.needed).at_most(held).any()
    }

    /// Number of further steps like the last one after which the goal is reached.
    pub fn steps_remaining(&self, lane: usize) -> Option<u32> {
        let unsolved = self.held[lane] > 0.0 && self.needed[lane].is_finite();
        unsolved.then(|| (self.needed[lane] - self.held[lane]) as u32)
    }
}

impl ConditionLanes {
    /// The distance of two objects.
    fn between([a, b]: [usize; 2], topology: &Topology) -> ConditionLanes {
        let (none, count) = (V::all(0.0), topology.bodies.len());
        let (first, other) = if a < count { (a, b) } else { (b, a) };
        if first >= count {
            return ConditionLanes::Never;
        }
        if !topology.is_disc(first) || (other < count && !topology.is_disc(other)) {
            let limit = V::all(f64::INFINITY);
            return ConditionLanes::Outlines { between: [first, other], limit, tolerance: none };
        }
        if other < count {
            return ConditionLanes::Discs { first, second: other, reach2: none };
        }
        let pieces = topology.statics.iter().enumerate().filter(|(_, (owner, _))| *owner == other - count);
        ConditionLanes::DiscStatic {
            body: first,
            fixed: pieces.map(|(piece, _)| piece).collect(),
            tolerance: none,
        }
    }
}

/// Whether two objects are no farther apart than `tolerance`; `None` if none of the lanes can be.
#[inline(always)]
fn within<R: Register, const N: usize>(
    state: &mut BatchState,
    [first, other]: [usize; 2],
    limit: &mut V,
    tolerance: &V,
) -> Option<Mask<R, N>> {
    let count = state.bodies.len();
    let mut travel = Wide::load(&state.bodies[first].travel);
    if other < count {
        travel = travel + Wide::load(&state.bodies[other].travel);
    }
    if !may_touch(limit, travel) {
        return None;
    }
    for body in [first, other].into_iter().filter(|b| *b < count) {
        let BodyLanes { moving, angle, .. } = &state.bodies[body];
        update_outlines::<R, N>(&mut state.frames[body], &mut state.outlines, moving, angle, state.tick);
    }
    let tolerance = Wide::load(tolerance);
    let mut least = Wide::all(f64::INFINITY);
    for a in state.outlines.iter().filter(|o| o.owner == first) {
        for b in state.outlines.iter().filter(|o| o.owner == other) {
            least = closest(a, b, tolerance).separation.below(least);
        }
    }
    let used = Wide::all(0.0).less(Wide::load(&state.dt));
    let free = (least - tolerance - Wide::all(TRAVEL_TOLERANCE_M)).above(Wide::all(0.0));
    used.select(travel + free, Wide::all(f64::INFINITY)).store(limit);
    Some(least.at_most(tolerance))
}

/// Whether objects that touch where `touch` is true have separated, once that counts.
#[inline(always)]
fn parted<R: Register, const N: usize>(touch: Mask<R, N>, counts: &mut V) -> Mask<R, N> {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let counted = touch.select(one, Wide::load(counts));
    counted.store(counts);
    none.less(touch.select(none, counted))
}

/// Minimum coordinate of a body along a direction, m; `radius` is that of a disc if no body has an outline.
#[inline(always)]
fn min_along<R: Register, const N: usize>(
    state: &mut BatchState,
    body: usize,
    [nx, ny]: [Wide<R, N>; 2],
    radius: &V,
) -> Wide<R, N> {
    let BodyLanes { moving, angle, .. } = &state.bodies[body];
    let Some(frame) = state.frames.get_mut(body) else {
        return nx * Wide::load(&moving.x) + ny * Wide::load(&moving.y) - Wide::load(radius);
    };
    update_outlines::<R, N>(frame, &mut state.outlines, moving, angle, state.tick);
    let mut least = Wide::all(f64::INFINITY);
    for outline in state.outlines.iter().filter(|o| o.owner == body) {
        if let OutlineCore::Corners { here, .. } = &outline.core {
            least = (lowest(here, nx, ny) - Wide::load(&outline.radius)).below(least);
        }
    }
    least
}

/// Position of the origin of a body's frame, m.
#[inline(always)]
fn origin<R: Register, const N: usize>(state: &mut BatchState, body: usize) -> [Wide<R, N>; 2] {
    let own = &state.bodies[body];
    let centre = [Wide::load(&own.moving.x), Wide::load(&own.moving.y)];
    let Some(frame) = state.frames.get_mut(body).filter(|f| !f.disc) else { return centre };
    frame.update_rotation::<R, N>(&own.angle);
    let (sine, cosine) = (Wide::<R, N>::load(&frame.sine), Wide::load(&frame.cosine));
    let (x, y) = (Wide::load(&frame.centre_x), Wide::load(&frame.centre_y));
    [centre[0] - (cosine * x - sine * y), centre[1] - (sine * x + cosine * y)]
}
