//! What is kept of pairs of outlines, and of contacts of two points between those that push.

use super::outline::Outline;
use super::simd::V;
use super::touching::Met;

/// Two outlines that may touch.
pub struct Near {
    /// Indices of outlines; the first is a body's.
    pub outlines: [usize; 2],
    pub met: Met,
    /// Sum of both bodies' `travel` below which they cannot touch.
    pub limit: V,
    pub friction: V,
    pub restitution: V,
    /// Its contact, if it pushes.
    pub slot: Option<usize>,
}

/// A contact: two outlines that push each other in some lane.
#[derive(Clone)]
pub struct Manifold {
    /// Index of its [`Near`].
    pub near: usize,
    /// Unit normal from the first to the second.
    pub nx: V,
    pub ny: V,
    pub friction: V,
    /// How many of the points there can be.
    pub count: usize,
    pub points: [Point; 2],
    /// Versions of both bodies when a visit last changed nothing.
    pub seen: [u32; 2],
}

/// A point of a contact.
#[derive(Clone, Copy)]
pub struct Point {
    /// The corners it is made of; 0 for none.
    pub id: V,
    /// Arms about the centre of mass of the first, and of the second, of an impulse along the normal, and of one across it, m.
    pub first: [V; 2],
    pub second: [V; 2],
    /// Accumulated normal, tangential and bias impulse, N s.
    pub jn: V,
    pub jt: V,
    pub jb: V,
    /// Target speeds, m/s.
    pub bounce: V,
    pub bias: V,
    /// As `state::Pair` has it.
    pub slip: V,
    /// Effective masses, kg: 0 in lanes where the point does not push.
    pub normal_mass: V,
    pub tangent_mass: V,
}

impl Near {
    /// Of a body's outline and another's; `first` and `other` as [`Met`] has them.
    fn new(outlines: [usize; 2], first: usize, other: usize) -> Near {
        Near {
            outlines,
            met: Met::new(first, other),
            limit: V::all(f64::INFINITY),
            friction: V::all(0.0),
            restitution: V::all(0.0),
            slot: None,
        }
    }
}

impl Manifold {
    /// Forgets a lane's impulses.
    pub fn clear(&mut self, lane: usize) {
        (self.nx[lane], self.ny[lane]) = (0.0, 0.0);
        for point in &mut self.points {
            (point.jn[lane], point.jt[lane], point.id[lane]) = (0.0, 0.0, 0.0);
            (point.normal_mass[lane], point.tangent_mass[lane]) = (0.0, 0.0);
            for arm in point.first.iter_mut().chain(&mut point.second) {
                arm[lane] = 0.0;
            }
        }
    }

    /// One that pushes nowhere.
    pub fn empty() -> Manifold {
        let none = V::all(0.0);
        let point = Point {
            id: none,
            first: [none; 2],
            second: [none; 2],
            jn: none,
            jt: none,
            jb: none,
            bounce: none,
            bias: none,
            slip: none,
            normal_mass: none,
            tangent_mass: none,
        };
        Manifold {
            near: 0,
            nx: none,
            ny: none,
            friction: none,
            count: 0,
            points: [point; 2],
            seen: [u32::MAX; 2],
        }
    }
}

/// All pairs of outlines of which at least one is of a body that is no disc, in an order in which those next to each other seldom
/// share a body: then the processor is at work on several contacts at once.
///
/// Source: the rounds of a tournament in which all meet all (circle method); what stands still meets a body in the round in which that
/// has no other.
///
/// What comes in later, beyond the scene's `own` bodies and statics, is behind all of these, so that it is as if it were not there
/// as long as it is not.
pub fn pairs(
    outlines: &[Outline],
    bodies: usize,
    own: [usize; 2],
    disc: impl Fn(usize) -> bool,
) -> Vec<Near> {
    let mut all = Vec::new();
    for (a, first) in outlines.iter().enumerate().filter(|(_, o)| o.owner < bodies) {
        for (b, second) in outlines.iter().enumerate().skip(a + 1) {
            let same = first.owner == second.owner;
            let discs = disc(first.owner) && (second.owner >= bodies || disc(second.owner));
            if !same && !discs {
                all.push(Near::new([a, b], first.owner, second.owner));
            }
        }
    }
    let rounds = own[0] | 1;
    let round = |a: usize, b: usize| if b < bodies { (a + b) % rounds } else { (2 * a) % rounds };
    let late = |i: usize| if i < bodies { i >= own[0] } else { i - bodies >= own[1] };
    all.sort_by_key(|Near { met, .. }| (late(met.first) || late(met.other), round(met.first, met.other)));
    all
}
