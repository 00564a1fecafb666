//! Copies the initial state of one lane, and topologies, to and from a sequence of numbers: the input of the GPU kernel.
//!
//! One function lists the numbers; the port decides whether it writes or reads them. Data that every step computes
//! anew are not copied.

use super::goal::{ConditionLanes, GoalLanes};
use super::outline::{BodyFrame, Corner, OutlineCore, PieceOutline};
use super::state::{BatchState, BodyLanes, DiscPair, StaticCore, StaticLanes};
use super::topology::{GoalTopology, Topology};

/// Writes numbers, or reads them in the order in which they were written.
pub trait Port {
    /// Writes the value, or replaces it by the one that was written.
    fn number(&mut self, value: &mut f64);

    /// The same for several.
    fn numbers<const N: usize>(&mut self, values: [&mut f64; N]) {
        values.into_iter().for_each(|value| self.number(value));
    }

    /// The same for whole numbers.
    fn wholes<const N: usize>(&mut self, values: [&mut usize; N]) {
        values.into_iter().for_each(|value| *value = self.whole(*value));
    }

    /// The same for truth values.
    fn flags<const N: usize>(&mut self, values: [&mut bool; N]) {
        values.into_iter().for_each(|value| *value = self.whole(usize::from(*value)) == 1);
    }

    /// The same for a whole number.
    fn whole(&mut self, value: usize) -> usize {
        let mut number = value as f64;
        self.number(&mut number);
        number as usize
    }
}

/// Appends the numbers to a vector.
#[cfg(not(kernel))]
pub struct NumberWriter<'a>(pub &'a mut Vec<f64>);

#[cfg(not(kernel))]
impl Port for NumberWriter<'_> {
    fn number(&mut self, value: &mut f64) {
        self.0.push(*value);
    }
}

/// Reads the numbers from a slice.
pub struct NumberReader<'a>(pub &'a [f64]);

impl Port for NumberReader<'_> {
    fn number(&mut self, value: &mut f64) {
        if let [first, rest @ ..] = self.0 {
            (*value, self.0) = (*first, rest);
        }
    }
}

impl Topology {
    /// Copies the topology.
    pub fn exchange(&mut self, port: &mut impl Port) {
        resize(&mut self.bodies, port);
        for pieces in &mut self.bodies {
            wholes(pieces, port);
        }
        resize(&mut self.statics, port);
        self.statics.iter_mut().for_each(|(owner, corners)| port.wholes([owner, corners]));
        port.wholes(self.own.each_mut());
        wholes(&mut self.motion_laws, port);
        wholes(&mut self.contact_laws, port);
        port.flags([&mut self.clocked, &mut self.contacts_established]);
        let mut time_step = f64::from_bits(self.time_step);
        port.number(&mut time_step);
        self.time_step = time_step.to_bits();
        let [mut kind, mut a, mut b] = match self.goal {
            None => [0; 3],
            Some(GoalTopology::Inside { body }) => [1, body, 0],
            Some(GoalTopology::Contact { objects: [a, b] }) => [2, a, b],
            Some(GoalTopology::Apart { objects: [a, b] }) => [3, a, b],
            Some(GoalTopology::Above { body, whole }) => [4, body, usize::from(whole)],
        };
        port.wholes([&mut kind, &mut a, &mut b]);
        self.goal = match kind {
            1 => Some(GoalTopology::Inside { body: a }),
            2 => Some(GoalTopology::Contact { objects: [a, b] }),
            3 => Some(GoalTopology::Apart { objects: [a, b] }),
            4 => Some(GoalTopology::Above { body: a, whole: b == 1 }),
            _ => None,
        };
    }
}

fn resize<T: Clone + Default>(values: &mut Vec<T>, port: &mut impl Port) {
    let count = port.whole(values.len());
    values.resize(count, T::default());
}

fn wholes(values: &mut Vec<usize>, port: &mut impl Port) {
    resize(values, port);
    values.iter_mut().for_each(|value| *value = port.whole(*value));
}

impl BatchState {
    /// Copies the state of a lane at the start of a rollout.
    pub fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        let mut steps = self.tick - self.start_tick[lane];
        port.number(&mut steps);
        self.start_tick[lane] = self.tick - steps;
        port.numbers([&mut self.dt[lane], &mut self.kick_x[lane], &mut self.kick_y[lane]]);
        port.numbers([&mut self.contact_margin[lane], &mut self.slop[lane], &mut self.bias_rate[lane]]);
        self.bodies.iter_mut().for_each(|body| body.exchange(lane, port));
        self.statics.iter_mut().for_each(|fixed| fixed.exchange(lane, port));
        self.frames.iter_mut().for_each(|frame| frame.exchange(lane, port));
        self.outlines.iter_mut().for_each(|outline| outline.exchange(lane, port));
        let start = self.start_tick[lane];
        self.pairs.iter_mut().for_each(|pair| pair.exchange(lane, start, port));
        self.exchange_outline_pairs(lane, port);
        for law in self.motion_laws.iter_mut().chain(&mut self.contact_laws) {
            law.constants.iter_mut().for_each(|constant| port.number(&mut constant[lane]));
        }
    }

    fn exchange_outline_pairs(&mut self, lane: usize, port: &mut impl Port) {
        let start = self.start_tick[lane];
        let BatchState { near, free_manifolds, .. } = self;
        for near in near {
            port.numbers([&mut near.limit[lane], &mut near.friction[lane], &mut near.restitution[lane]]);
            exchange_time(&mut near.contact.last_touch[lane], start, port);
            // A rollout begins without manifolds.
            free_manifolds.extend(near.slot.take());
        }
    }
}

/// A tick, relative to the start of the lane's rollout.
fn exchange_time(tick: &mut f64, start: f64, port: &mut impl Port) {
    let mut since_start = *tick - start;
    port.number(&mut since_start);
    *tick = since_start + start;
}

impl BodyLanes {
    fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        let m = &mut self.moving;
        port.numbers([&mut m.x[lane], &mut m.y[lane], &mut m.vx[lane], &mut m.vy[lane], &mut m.omega[lane]]);
        port.numbers([&mut self.angle[lane], &mut self.bias_x[lane], &mut self.bias_y[lane]]);
        port.numbers([&mut self.radius[lane], &mut self.inv_mass[lane], &mut self.spin_per_impulse[lane]]);
        port.numbers([&mut self.travel[lane], &mut self.rolling[lane]]);
    }
}

impl StaticLanes {
    fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        port.number(&mut self.radius[lane]);
        match &mut self.core {
            StaticCore::Point { x, y } => port.numbers([&mut x[lane], &mut y[lane]]),
            StaticCore::Plane { nx, ny, offset } => {
                port.numbers([&mut nx[lane], &mut ny[lane], &mut offset[lane]]);
            }
            StaticCore::Polygon(edges) => {
                for e in edges {
                    port.numbers([&mut e.ax[lane], &mut e.ay[lane], &mut e.nx[lane], &mut e.ny[lane]]);
                    port.number(&mut e.length[lane]);
                }
            }
        }
    }
}

impl BodyFrame {
    fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        port.numbers([&mut self.inv_inertia[lane], &mut self.bias_omega[lane], &mut self.extent[lane]]);
        port.numbers([&mut self.centre_x[lane], &mut self.centre_y[lane]]);
        self.turned = -1.0;
    }
}

impl PieceOutline {
    fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        port.number(&mut self.radius[lane]);
        match &mut self.core {
            OutlineCore::Plane { nx, ny, offset } => {
                port.numbers([&mut nx[lane], &mut ny[lane], &mut offset[lane]]);
            }
            // Corners of bodies are turned anew in every step; those of statics stay.
            OutlineCore::Corners { here, own } if own.is_empty() => exchange_corners(here, lane, port),
            OutlineCore::Corners { own, .. } => {
                exchange_corners(own, lane, port);
                let [x, y] = &mut self.middle;
                port.numbers([&mut x[lane], &mut y[lane], &mut self.inner[lane]]);
            }
        }
    }
}

fn exchange_corners(corners: &mut [Corner], lane: usize, port: &mut impl Port) {
    for c in corners {
        port.numbers([&mut c.x[lane], &mut c.y[lane], &mut c.nx[lane], &mut c.ny[lane]]);
    }
}

impl DiscPair {
    fn exchange(&mut self, lane: usize, start: f64, port: &mut impl Port) {
        port.numbers([&mut self.limit[lane], &mut self.jn[lane], &mut self.jt[lane]]);
        port.numbers([&mut self.full_normal_mass[lane], &mut self.full_tangent_mass[lane]]);
        port.numbers([&mut self.friction[lane], &mut self.restitution[lane]]);
        exchange_time(&mut self.contact.last_touch[lane], start, port);
        self.pushed = true;
    }
}

impl GoalLanes {
    /// Copies the goal of a lane.
    pub fn exchange(&mut self, lane: usize, port: &mut impl Port) {
        port.numbers([&mut self.held[lane], &mut self.needed[lane]]);
        if let Some(apart) = &mut self.apart {
            port.number(&mut apart[lane]);
        }
        match &mut self.condition {
            ConditionLanes::Never => {}
            ConditionLanes::Discs { reach2, .. } => port.number(&mut reach2[lane]),
            ConditionLanes::DiscStatic { tolerance, .. } => port.number(&mut tolerance[lane]),
            ConditionLanes::Outlines { limit, tolerance, .. } => {
                port.numbers([&mut limit[lane], &mut tolerance[lane]]);
            }
            ConditionLanes::Inside { regions, low, high, .. } => {
                low.iter_mut().chain(high).for_each(|edge| port.number(&mut edge[lane]));
                resize(&mut regions[lane], port);
                regions[lane].iter_mut().for_each(|[x, y]| port.numbers([x, y]));
            }
            ConditionLanes::Above { normal: [nx, ny], offset, radius, .. } => {
                port.numbers([&mut nx[lane], &mut ny[lane], &mut offset[lane], &mut radius[lane]]);
            }
        }
    }
}
