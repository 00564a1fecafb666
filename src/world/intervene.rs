//! Interventions: what they do to a rollout at work, the same for every engine.
//!
//! A rollout's things are all those that are ever in it: the scene's own first, then what comes in, each with whether it
//! is there now. An engine runs up to a change, lets [`carry_out`] work on what it knows of things and on their states, and
//! takes over what is different; what is not, it leaves alone to the bit, warm-start impulses included.
//!
//! - Impulse J at r from the centre of mass: v += J / m, omega += (r x J) / I.
//! - What comes in must be clear of everything; what is put elsewhere may overlap as much as resting contacts do.
//! - Tolerances (the gap that counts as touching, the overlap that is not pushed out) follow the smallest body so far: they
//!   become finer when a smaller one comes in, and stay when one is taken away, so that nothing else is moved by it.

use super::change::{Act, Change};
use super::goal::Party;
use super::latent::Latents;
use super::prepared::{Prepared, PreparedBody, PreparedStatic};
use super::rollout::Rollout;
use super::state::State;
use crate::error::{Error, Result};
use crate::task::Intervention;
use crate::task::scene::{Body, Static};
use crate::task::timeline::in_order;

/// Largest change of speed by one impulse, m/s: that of the fastest body.
const MOST_BLOW: f64 = 400.0;
/// Overlap with what a body is put beside, as a share of its smallest extent, that is taken for that of a contact.
const CONTACT_SHARE: f64 = 0.2;

/// Decides on a rollout's interventions, and puts what comes in behind the things that `prepared` has. `body` and `fixed`
/// prepare one that comes in, `anew` all of the scene's own with other latents.
pub fn decide(
    rollout: &Rollout,
    prepared: &mut Prepared,
    body: impl Fn(&Body) -> Result<PreparedBody>,
    fixed: impl Fn(&Static) -> PreparedStatic,
    anew: impl Fn(Latents) -> Result<Act>,
) -> Result<()> {
    let list = &rollout.scene.interventions;
    if list.is_empty() {
        return Ok(());
    }
    let mut latents = rollout.latents;
    for (step, number) in in_order(rollout.scene)? {
        let under = |e: Error| e.under(&format!("interventions[{number}]"));
        let act = match &list[number] {
            Intervention::Impulse { body, impulse, point, .. } => {
                Act::Push { body: known(prepared, body), impulse: *impulse, point: *point }
            }
            Intervention::Set { body, position, angle, velocity, angular_velocity, .. } => Act::Put {
                body: known(prepared, body),
                position: *position,
                angle: *angle,
                velocity: *velocity,
                omega: *angular_velocity,
            },
            Intervention::Add { body: own, .. } => {
                let own = body(own).map_err(|e| under(e.under("body")))?;
                prepared.bodies.push(PreparedBody { there: false, ..own });
                Act::Add(Party::Body(prepared.bodies.len() - 1))
            }
            Intervention::AddStatic { fixed: own, .. } => {
                prepared.statics.push(PreparedStatic { there: false, ..fixed(own) });
                Act::Add(Party::Static(prepared.statics.len() - 1))
            }
            Intervention::Remove { body, .. } => Act::Remove(named(prepared, body)),
            Intervention::Latents { density, friction, restitution, .. } => {
                let given = Latents { density: *density, friction: *friction, restitution: *restitution };
                given.validate().map_err(|e| e.without("latents")).map_err(under)?;
                latents = given.or(latents);
                anew(latents).map_err(under)?
            }
        };
        prepared.changes.push(Change { step, number, act });
    }
    bearable(prepared)
}

/// Errors where an impulse is more than its body bears.
fn bearable(prepared: &Prepared) -> Result<()> {
    let mut masses: Vec<f64> = prepared.bodies.iter().map(|b| b.mass).collect();
    for change in &prepared.changes {
        match &change.act {
            Act::Matter { bodies, .. } => {
                bodies.iter().zip(&mut masses).for_each(|(own, mass)| *mass = own.mass)
            }
            Act::Push { body, impulse, .. } => {
                let most = MOST_BLOW * masses[*body];
                if libm::hypot(impulse[0], impulse[1]) > most {
                    let field = format!("interventions[{}].impulse", change.number);
                    let allowed =
                        format!("at most {most} N s: {MOST_BLOW} m/s for this body of {} kg", masses[*body]);
                    return Err(Error::input(field, format!("{impulse:?}"), allowed));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Does a change to what is known of things and to the bodies' states (those of frames' origins; one that is not there is
/// nowhere). What is in the way, by its number (bodies, then statics), of something that has no place: then nothing is done.
pub fn carry_out(prepared: &mut Prepared, states: &mut [State], act: &Act) -> std::result::Result<(), usize> {
    match act {
        Act::Push { body, impulse, point } => {
            let own = &prepared.bodies[*body];
            states[*body] = pushed(own, states[*body], *impulse, *point);
        }
        Act::Put { body, position, angle, velocity, omega } => {
            let before = states[*body];
            let after = State {
                position: position.map_or(before.position, |p| p.map(|x| x + 0.0)),
                angle: angle.map_or(before.angle, |a| a + 0.0),
                velocity: velocity.map_or(before.velocity, |v| v.map(|x| x + 0.0)),
                omega: omega.map_or(before.omega, |w| w + 0.0),
            };
            if after.moved_from(&before) {
                in_the_way(prepared, states, *body, &after, CONTACT_SHARE).map_or(Ok(()), Err)?;
            }
            states[*body] = after;
        }
        Act::Add(Party::Body(i)) => {
            let start = prepared.bodies[*i].start();
            in_the_way(prepared, states, *i, &start, 0.0).map_or(Ok(()), Err)?;
            prepared.bodies[*i].there = true;
            prepared.touch = prepared.touch.min(prepared.bodies[*i].touch());
            states[*i] = start;
        }
        Act::Add(Party::Static(s)) => {
            let fixed = &prepared.statics[*s].shape;
            let overlaps = |i: &usize| {
                let (own, at) = (&prepared.bodies[*i], &states[*i]);
                own.there && fixed.gap_to(&own.shape.placed(at.position, at.angle)) < 0.0
            };
            (0..prepared.bodies.len()).find(overlaps).map_or(Ok(()), Err)?;
            prepared.statics[*s].there = true;
        }
        Act::Remove(Party::Body(i)) => {
            prepared.bodies[*i].there = false;
            states[*i] = State::NOWHERE;
        }
        Act::Remove(Party::Static(s)) => prepared.statics[*s].there = false,
        Act::Matter { bodies, statics } => {
            for (own, new) in prepared.bodies.iter_mut().zip(bodies) {
                (own.mass, own.inertia) = (new.mass, new.inertia);
                [own.friction, own.restitution] = new.surface;
            }
            for (own, new) in prepared.statics.iter_mut().zip(statics) {
                [own.friction, own.restitution] = *new;
            }
        }
    }
    Ok(())
}

/// The state after an impulse.
fn pushed(own: &PreparedBody, before: State, impulse: [f64; 2], point: Option<[f64; 2]>) -> State {
    let [ax, ay] = own.arm(before.angle);
    let turn = point.map_or(0.0, |[x, y]| {
        let (rx, ry) = (x - before.position[0] - ax, y - before.position[1] - ay);
        (rx * impulse[1] - ry * impulse[0]) / own.inertia
    });
    // The velocity is that of the origin, which turns about the centre of mass.
    let add = [impulse[0] / own.mass + turn * ay, impulse[1] / own.mass - turn * ax];
    State {
        velocity: [before.velocity[0] + add[0], before.velocity[1] + add[1]],
        omega: before.omega + turn,
        ..before
    }
}

/// The first thing that a body would overlap at a state, by more than a share of its smallest extent, or of the other body's if
/// that is smaller.
fn in_the_way(prepared: &Prepared, states: &[State], body: usize, at: &State, share: f64) -> Option<usize> {
    let extent = prepared.bodies[body].shape.smallest_extent();
    let give = share * extent;
    let own = prepared.bodies[body].shape.placed(at.position, at.angle);
    let others = prepared.bodies.iter().zip(states).enumerate();
    let mut others = others.filter(|(i, (other, _))| *i != body && other.there);
    let in_it = others.find(|(_, (other, at))| {
        let give = share * extent.min(other.shape.smallest_extent());
        own.gap_to(&other.shape.placed(at.position, at.angle)) < -give
    });
    let fixed = || {
        let mut statics = prepared.statics.iter().enumerate().filter(|(_, s)| s.there);
        statics.find(|(_, s)| s.shape.gap_to(&own) < -give).map(|(s, _)| prepared.bodies.len() + s)
    };
    in_it.map(|(i, _)| i).or_else(fixed)
}

/// Number of a body whose name [`in_order`] knows.
fn known(prepared: &Prepared, name: &str) -> usize {
    let found = prepared.bodies.iter().position(|b| b.name == name);
    found.expect("names of interventions are checked before")
}

fn named(prepared: &Prepared, name: &str) -> Party {
    match prepared.statics.iter().position(|s| s.name == name) {
        Some(fixed) => Party::Static(fixed),
        None => Party::Body(known(prepared, name)),
    }
}
