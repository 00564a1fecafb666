//! A scene's interventions in time: when each happens, and that it can.

use super::intervention::Intervention;
use super::limits::{FAR, FAST, FAST_SPIN, vector};
use super::scene::Scene;
use crate::error::{Error, Result, within};

/// Most interventions in a rollout: engines stop at each.
pub const MOST_INTERVENTIONS: usize = 64;
/// Largest impulse in either direction, N s; what a body bears is less ([`FAST`] times its mass).
const MOST_IMPULSE: f64 = 1e12;

/// The interventions of a scene in the order in which they happen: (time step, number in the list). Errors, whose
/// fields begin with the intervention's number, unless every value is within its limits and every name that of
/// something that is there at that moment.
pub fn in_order(scene: &Scene) -> Result<Vec<(u32, usize)>> {
    let list = &scene.interventions;
    if list.len() > MOST_INTERVENTIONS {
        let allowed = format!("at most {MOST_INTERVENTIONS} interventions");
        return Err(Error::input("interventions", format!("{} interventions", list.len()), allowed));
    }
    let under = |k: usize| move |e: Error| e.under(&format!("interventions[{k}]"));
    let mut order = Vec::with_capacity(list.len());
    for (k, own) in list.iter().enumerate() {
        order.push((moment(scene, own.at()).map_err(under(k))?, k));
    }
    order.sort_by_key(|(step, _)| *step);
    let mut there = There::of(scene);
    for (_, k) in &order {
        there.check(&list[*k], scene).map_err(under(*k))?;
    }
    Ok(order)
}

/// Names of all that is ever in the scene, as engines number it: bodies, then statics, what comes in behind each in the
/// order in which it does.
pub fn things(scene: &Scene) -> Result<Vec<String>> {
    let order = in_order(scene)?;
    let added = || order.iter().map(|(_, k)| &scene.interventions[*k]);
    let bodies = added().filter_map(|i| match i {
        Intervention::Add { body, .. } => Some(&body.name),
        _ => None,
    });
    let statics = added().filter_map(|i| match i {
        Intervention::AddStatic { fixed, .. } => Some(&fixed.name),
        _ => None,
    });
    let bodies = scene.bodies.iter().map(|b| &b.name).chain(bodies);
    Ok(bodies.chain(scene.statics.iter().map(|s| &s.name).chain(statics)).cloned().collect())
}

/// The time step that is nearest to a moment; errors, about `at`, unless a rollout has another one after it.
pub fn moment(scene: &Scene, at: f64) -> Result<u32> {
    let step = (at / scene.time_step).round();
    if step.is_finite() && at >= 0.0 && step < f64::from(scene.steps) {
        return Ok(step as u32);
    }
    let last = f64::from(scene.steps - 1) * scene.time_step;
    let allowed = format!(
        "a moment from 0 to {last} s, before the last of the rollout's {} steps of {} s",
        scene.steps, scene.time_step
    );
    Err(Error::input("at", at, allowed))
}

/// What is in the scene at some moment, by name.
struct There {
    bodies: Vec<String>,
    statics: Vec<String>,
    /// What was there once, and is not to be confused with what comes in.
    gone: Vec<String>,
}

impl There {
    fn of(scene: &Scene) -> There {
        There {
            bodies: scene.bodies.iter().map(|b| b.name.clone()).collect(),
            statics: scene.statics.iter().map(|s| s.name.clone()).collect(),
            gone: Vec::new(),
        }
    }

    /// Takes an intervention in; the numbers of latents are the engine's to judge.
    fn check(&mut self, change: &Intervention, scene: &Scene) -> Result<()> {
        match change {
            Intervention::Impulse { body, impulse, point, .. } => {
                self.body(body)?;
                vector("impulse", *impulse, MOST_IMPULSE)?;
                point.map_or(Ok(()), |p| vector("point", p, FAR))
            }
            Intervention::Set { body, position, angle, velocity, angular_velocity, .. } => {
                self.body(body)?;
                if position.is_none() && angle.is_none() && velocity.is_none() && angular_velocity.is_none() {
                    let allowed = "at least one of position, angle, velocity and angular_velocity";
                    return Err(Error::input("set", "nothing", allowed));
                }
                position.map_or(Ok(()), |p| vector("position", p, FAR))?;
                angle.map_or(Ok(0.0), |a| within("angle", a, -1e6, 1e6))?;
                velocity.map_or(Ok(()), |v| vector("velocity", v, FAST))?;
                angular_velocity
                    .map_or(Ok(0.0), |w| within("angular_velocity", w, -FAST_SPIN, FAST_SPIN))
                    .map(drop)
            }
            Intervention::Add { body, .. } => {
                body.validate().map_err(|e| e.under("body"))?;
                self.fresh("body.name", &body.name)?;
                if body.position.is_none() {
                    return Err(Error::input("body.position", "missing", "where the body comes in, m"));
                }
                self.bodies.push(body.name.clone());
                let most = 64 - scene.bodies.len().min(64);
                let added = scene.interventions.iter().filter(|i| i.adds_body()).count();
                if added > most {
                    let value = format!("{added} bodies that come in");
                    return Err(Error::input(
                        "body",
                        value,
                        format!("at most {most} beside the scene's own"),
                    ));
                }
                Ok(())
            }
            Intervention::AddStatic { fixed, .. } => {
                fixed.validate().map_err(|e| e.under("static"))?;
                self.fresh("static.name", &fixed.name)?;
                self.statics.push(fixed.name.clone());
                Ok(())
            }
            Intervention::Remove { body, .. } => {
                self.named("body", body, true)?;
                self.bodies.retain(|b| b != body);
                self.statics.retain(|s| s != body);
                self.gone.push(body.clone());
                Ok(())
            }
            Intervention::Latents { density: None, friction: None, restitution: None, .. } => {
                let allowed = "at least one of density, friction and restitution";
                Err(Error::input("latents", "nothing", allowed))
            }
            Intervention::Latents { .. } => Ok(()),
        }
    }

    fn body(&self, name: &str) -> Result<()> {
        self.named("body", name, false)
    }

    /// Errors unless `name` is that of a body (or a static) that is there.
    fn named(&self, field: &str, name: &str, statics: bool) -> Result<()> {
        let fixed = self.statics.iter().filter(|_| statics);
        let known: Vec<&String> = self.bodies.iter().chain(fixed).collect();
        if known.iter().any(|k| *k == name) {
            return Ok(());
        }
        let value = if self.gone.iter().any(|g| g == name) {
            format!("{name:?}, taken away before")
        } else {
            format!("{name:?}")
        };
        let known = known.iter().map(|k| format!("{k:?}")).collect::<Vec<_>>().join(", ");
        Err(Error::input(field, value, format!("what is there then: one of {known}")))
    }

    /// Errors unless `name` may be given to what comes in.
    fn fresh(&self, field: &str, name: &str) -> Result<()> {
        let mut taken = self.bodies.iter().chain(&self.statics).chain(&self.gone);
        if name.is_empty() || name.len() > 100 {
            return Err(Error::input(field, format!("{name:?}"), "a name of 1 to 100 characters"));
        }
        if taken.any(|t| t == name) {
            return Err(Error::input(field, format!("{name:?}"), "a name that nothing else has or had"));
        }
        Ok(())
    }
}
