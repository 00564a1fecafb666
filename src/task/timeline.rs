//! Validates a scene's interventions and puts them in order of time.

use super::intervention::Intervention;
use super::limits::{MAX_LENGTH_M, MAX_SPEED_M_S, MAX_SPIN_RAD_S, check_name_length, check_vector};
use super::scene::Scene;
use crate::error::{Error, Result, check_range};

/// Maximum number of interventions of a rollout.
pub const MAX_INTERVENTIONS: usize = 64;
/// Largest component of an impulse, N s; the limit for a body is [`MAX_SPEED_M_S`] times its mass.
const MAX_IMPULSE_N_S: f64 = 1e12;

/// The interventions of a scene in order of time: (time step, index in the list). Errors, whose field begins
/// with the intervention's index, unless every value is within its limits and every name exists at that time.
pub fn schedule(scene: &Scene) -> Result<Vec<(u32, usize)>> {
    let list = &scene.interventions;
    if list.len() > MAX_INTERVENTIONS {
        let allowed = format!("at most {MAX_INTERVENTIONS} interventions");
        return Err(Error::input("interventions", format!("{} interventions", list.len()), allowed));
    }
    if !list.is_empty() {
        scene.check_corners()?;
    }
    let under = |k: usize| move |e: Error| e.in_field(&format!("interventions[{k}]"));
    let mut order = Vec::with_capacity(list.len());
    for (k, own) in list.iter().enumerate() {
        order.push((step_at(scene, own.at()).map_err(under(k))?, k));
    }
    order.sort_by_key(|(step, _)| *step);
    let mut there = PresentObjects::of(scene);
    for (_, k) in &order {
        there.check(&list[*k], scene).map_err(under(*k))?;
    }
    Ok(order)
}

/// Names of all objects of a rollout in the engines' order: bodies, then statics; added ones follow the
/// scene's own in the order in which they are added.
pub fn object_names(scene: &Scene) -> Result<Vec<String>> {
    let order = schedule(scene)?;
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

/// The time step nearest to a time; errors, naming `at`, unless it is before the last step of the rollout.
pub fn step_at(scene: &Scene, at: f64) -> Result<u32> {
    let step = (at / scene.time_step).round();
    if step.is_finite() && at >= 0.0 && step < f64::from(scene.steps) {
        return Ok(step as u32);
    }
    let last = f64::from(scene.steps - 1) * scene.time_step;
    let allowed = format!(
        "a time from 0 to {last} s, before the last of the rollout's {} steps of {} s",
        scene.steps, scene.time_step
    );
    Err(Error::input("at", at, allowed))
}

/// The names of the objects in the scene at some time.
struct PresentObjects {
    bodies: Vec<String>,
    statics: Vec<String>,
    /// Removed objects; their names cannot be reused.
    gone: Vec<String>,
}

impl PresentObjects {
    fn of(scene: &Scene) -> PresentObjects {
        PresentObjects {
            bodies: scene.bodies.iter().map(|b| b.name.clone()).collect(),
            statics: scene.statics.iter().map(|s| s.name.clone()).collect(),
            gone: Vec::new(),
        }
    }

    /// Validates an intervention and applies it to the names; the engine validates the values of latents.
    fn check(&mut self, change: &Intervention, scene: &Scene) -> Result<()> {
        match change {
            Intervention::Impulse { body, impulse, point, .. } => {
                self.body(body)?;
                check_vector("impulse", *impulse, MAX_IMPULSE_N_S)?;
                point.map_or(Ok(()), |p| check_vector("point", p, MAX_LENGTH_M))
            }
            Intervention::Set { body, position, angle, velocity, angular_velocity, .. } => {
                self.body(body)?;
                if position.is_none() && angle.is_none() && velocity.is_none() && angular_velocity.is_none() {
                    let allowed = "at least one of position, angle, velocity and angular_velocity";
                    return Err(Error::input("set", "nothing", allowed));
                }
                position.map_or(Ok(()), |p| check_vector("position", p, MAX_LENGTH_M))?;
                angle.map_or(Ok(0.0), |a| check_range("angle", a, -1e6, 1e6))?;
                velocity.map_or(Ok(()), |v| check_vector("velocity", v, MAX_SPEED_M_S))?;
                angular_velocity
                    .map_or(Ok(0.0), |w| check_range("angular_velocity", w, -MAX_SPIN_RAD_S, MAX_SPIN_RAD_S))
                    .map(drop)
            }
            Intervention::Add { body, .. } => {
                body.validate().map_err(|e| e.in_field("body"))?;
                self.fresh("body.name", &body.name)?;
                if body.position.is_none() {
                    let allowed = "the position of the added body, m";
                    return Err(Error::input("body.position", "missing", allowed));
                }
                self.bodies.push(body.name.clone());
                let most = 64 - scene.bodies.len().min(64);
                let added = scene.interventions.iter().filter(|i| i.adds_body()).count();
                if added > most {
                    let value = format!("{added} added bodies");
                    let allowed = format!("at most {most} in addition to the scene's own");
                    return Err(Error::input("body", value, allowed));
                }
                Ok(())
            }
            Intervention::AddStatic { fixed, .. } => {
                fixed.validate().map_err(|e| e.in_field("static"))?;
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

    /// Errors unless `name` is that of a body (or a static, if `statics` is set) that is in the scene.
    fn named(&self, field: &str, name: &str, statics: bool) -> Result<()> {
        let fixed = self.statics.iter().filter(|_| statics);
        let known: Vec<&String> = self.bodies.iter().chain(fixed).collect();
        if known.iter().any(|k| *k == name) {
            return Ok(());
        }
        let value = if self.gone.iter().any(|g| g == name) {
            format!("{name:?}, which was removed earlier")
        } else {
            format!("{name:?}")
        };
        let known = known.iter().map(|k| format!("{k:?}")).collect::<Vec<_>>().join(", ");
        Err(Error::input(field, value, format!("an object in the scene at that time: one of {known}")))
    }

    /// Errors unless `name` is valid for an added object.
    fn fresh(&self, field: &str, name: &str) -> Result<()> {
        let mut taken = self.bodies.iter().chain(&self.statics).chain(&self.gone);
        check_name_length(field, name)?;
        if taken.any(|t| t == name) {
            let allowed = "a name that no other object of the rollout uses";
            return Err(Error::input(field, format!("{name:?}"), allowed));
        }
        Ok(())
    }
}
