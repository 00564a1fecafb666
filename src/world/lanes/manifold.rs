//! Pairs of outlines and their contact manifolds.

use super::contact_pair::ContactPair;
use super::outline::PieceOutline;
use super::simd::V;

/// Two outlines that may touch.
pub struct OutlinePair {
    /// Indices of outlines; the first is a body's.
    pub outlines: [usize; 2],
    pub contact: ContactPair,
    /// Sum of both bodies' `travel` below which they cannot touch.
    pub limit: V,
    pub friction: V,
    pub restitution: V,
    /// Its contact manifold, if it is active.
    pub slot: Option<usize>,
}

/// A contact manifold: two outlines that push each other in some lane.
#[derive(Clone)]
pub struct Manifold {
    /// Index of its [`OutlinePair`].
    pub near: usize,
    /// Unit normal from the first to the second.
    pub nx: V,
    pub ny: V,
    pub friction: V,
    /// Number of points.
    pub count: usize,
    pub points: [ManifoldPoint; 2],
    /// Solver versions of both bodies at the last visit that changed nothing.
    pub seen: [u32; 2],
}

/// A point of a contact manifold.
#[derive(Clone, Copy)]
pub struct ManifoldPoint {
    /// Id of the corners that form it; 0 for none.
    pub id: V,
    /// Lever arms about the centres of mass of the first and of the second body, of a normal and of a
    /// tangential impulse, m.
    pub first: [V; 2],
    pub second: [V; 2],
    /// Accumulated normal, tangential and bias impulse, N s.
    pub jn: V,
    pub jt: V,
    pub jb: V,
    /// Target velocities, m/s.
    pub bounce: V,
    pub bias: V,
    /// As in `state::DiscPair`.
    pub slip: V,
    /// Effective masses, kg: 0 in lanes where the point is not active.
    pub normal_mass: V,
    pub tangent_mass: V,
}

impl OutlinePair {
    /// A pair of a body's outline and another's; `first` and `other` as in [`ContactPair`].
    fn new(outlines: [usize; 2], first: usize, other: usize) -> OutlinePair {
        OutlinePair {
            outlines,
            contact: ContactPair::new(first, other),
            limit: V::all(f64::INFINITY),
            friction: V::all(0.0),
            restitution: V::all(0.0),
            slot: None,
        }
    }
}

impl Manifold {
    /// Resets a lane's impulses.
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

    /// A manifold without active points.
    pub fn empty() -> Manifold {
        let none = V::all(0.0);
        let point = ManifoldPoint {
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

/// All pairs of outlines with at least one body that is not a disc, in an order in which neighbours rarely
/// share a body, so that the processor can work on several contacts at once.
///
/// Source: the rounds of a round-robin tournament (circle method); a static meets a body in the round in
/// which the body has no other opponent.
///
/// Pairs of added objects, beyond the scene's `own` bodies and statics, follow all others, so that they do
/// not change the order while they are absent.
pub fn pairs(
    outlines: &[PieceOutline],
    bodies: usize,
    own: [usize; 2],
    disc: impl Fn(usize) -> bool,
) -> Vec<OutlinePair> {
    let mut candidates = Vec::new();
    for (a, first) in outlines.iter().enumerate().filter(|(_, o)| o.owner < bodies) {
        for (b, second) in outlines.iter().enumerate().skip(a + 1) {
            let same = first.owner == second.owner;
            let discs = disc(first.owner) && (second.owner >= bodies || disc(second.owner));
            if !same && !discs {
                candidates.push(([a, b], [first.owner, second.owner]));
            }
        }
    }
    let rounds = own[0] | 1;
    let round = |[a, b]: [usize; 2]| if b < bodies { (a + b) % rounds } else { (2 * a) % rounds };
    let is_late = |i: usize| if i < bodies { i >= own[0] } else { i - bodies >= own[1] };
    let mut pairs = Vec::with_capacity(candidates.len());
    for late in [false, true] {
        for now in 0..rounds {
            let chosen = candidates
                .iter()
                .filter(|(_, owners)| owners.iter().any(|o| is_late(*o)) == late && round(*owners) == now);
            pairs.extend(chosen.map(|(pair, [first, other])| OutlinePair::new(*pair, *first, *other)));
        }
    }
    pairs
}
