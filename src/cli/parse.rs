//! Parsers of option values such as `linear_drag:c=0.223` and `damping=0.8,friction=0.5`.

use std::path::Path;

use iplw::commands::{parse_effect, parse_latents, parse_number, parse_pairs};
use iplw::error::{Error, Result};
use iplw::estimate::ParameterSamples;
use iplw::estimate::surface::RelatedEnvironment;
use iplw::reality::{HiddenConfig, real_world};
use iplw::task::scene::EffectTerm;
use iplw::task::{Family, Split, Task, family};
use iplw::world::{Engine, Latents};

/// Parses all `--effect` options.
pub fn effects(texts: &[String]) -> Result<Vec<EffectTerm>> {
    texts.iter().map(|text| Ok(parse_effect(text)?.0)).collect()
}

/// `density=..,friction=..,restitution=..`; missing latents are left to the scene.
pub fn latents(text: &str) -> Result<Latents> {
    parse_latents(text)?.0.checked("latents.")
}

/// Tasks of a family, or the single task `family:number`.
pub fn tasks(name: &str) -> Result<(Vec<Task>, &'static Family)> {
    let family = family(name.split(':').next().unwrap_or(name))?;
    let all = family.tasks();
    if name == family.name {
        return Ok((all, family));
    }
    match all.into_iter().find(|t| t.id == name) {
        Some(task) => Ok((vec![task], family)),
        None => Err(Error::NotFound {
            kind: "task",
            id: name.into(),
            known: vec![format!("{}:000, {0}:001, ...", family.name)],
        }),
    }
}

/// Reads the posterior samples given by `--posterior`.
pub fn parameter_samples(path: &Path) -> Result<ParameterSamples> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    ParameterSamples::from_json(&text).map_err(|e| e.in_file(path.display()))
}

/// Tasks of a family with the splits of `--fold`.
pub fn fold(tasks: Vec<Task>, family: &Family, fold: Option<u64>) -> Result<Vec<Task>> {
    match fold {
        None => Ok(tasks),
        Some(fold) if tasks.len() > 1 => Ok(family.fold(fold)),
        Some(fold) => {
            Err(Error::input("--fold", fold, "no fold for a single task; it splits the tasks of a family"))
        }
    }
}

/// The split named by `--split`.
pub fn part(name: &str) -> Result<Split> {
    let allowed = "train, validation or test";
    Split::named(name).ok_or_else(|| Error::input("--split", format!("{name:?}"), allowed))
}

/// The family's hidden world with `--real` applied; its `seed` selects among the worlds of a family that draws hidden numbers.
pub fn real(text: &str, family: &Family) -> Result<HiddenConfig> {
    let mut seed = 0;
    for (key, value) in parse_pairs("--real", text)? {
        if key == "seed" {
            let invalid = |_| Error::input("--real seed", format!("{value:?}"), "a whole number from 0");
            seed = value.parse().map_err(invalid)?;
        }
    }
    world("--real", text, real_world(family, seed))
}

/// The family's hidden world with `--real` applied and with further effects; one that the world already has is replaced.
pub fn hidden(effects: &[String], real_world: &str, family: &Family) -> Result<HiddenConfig> {
    let added = self::effects(effects)?;
    let mut config = real(real_world, family)?;
    config.effects.retain(|own| added.iter().all(|new| new.name != own.name));
    config.effects.extend(added);
    Ok(config)
}

/// A known environment given by `--related`, with `base` latents and no effects by default.
pub fn related(text: &str, base: [f64; 3]) -> Result<RelatedEnvironment> {
    let plain = HiddenConfig {
        latents: Latents::of(base),
        effects: Vec::new(),
        engine: Engine::Auto,
        noise: 0.0,
        budget: None,
        seed: 0,
    };
    let found = world("--related", text, plain.clone())?;
    if (found.noise, found.engine) != (plain.noise, plain.engine) {
        let allowed = "damping, density, friction, restitution";
        return Err(Error::input("--related", format!("{text:?}"), allowed));
    }
    let values = found.latents.values();
    let latents = std::array::from_fn(|i| values[i].unwrap_or(base[i]));
    Ok(RelatedEnvironment { latents, effects: found.effects })
}

fn world(option: &str, text: &str, base: HiddenConfig) -> Result<HiddenConfig> {
    let mut config = base;
    for (key, value) in parse_pairs(option, text)? {
        let field = format!("{option} {key}");
        match key.as_str() {
            "damping" => {
                let kept = Some(parse_number(&field, &value)?);
                config.effects =
                    iplw::commands::effects(kept, None, &format!("{option} "))?.unwrap_or_default();
            }
            "density" | "mass" => config.latents.density = Some(parse_number(&field, &value)?),
            "friction" => config.latents.friction = Some(parse_number(&field, &value)?),
            "restitution" => config.latents.restitution = Some(parse_number(&field, &value)?),
            "noise" => config.noise = parse_number(&field, &value)?,
            "engine" => config.engine = Engine::from_name(&value)?,
            "seed" if option == "--real" => {}
            _ => {
                let allowed = "damping, density, friction, restitution, noise, engine, seed";
                return Err(Error::input(option, format!("{key:?}"), allowed));
            }
        }
    }
    config.latents.validate()?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_latents_and_effects_within_bounds() {
        assert_eq!(latents("friction=0.5").unwrap(), Latents { friction: Some(0.5), ..Latents::default() });
        assert_eq!(parse_effect("linear_drag:c=0.2").unwrap().0.parameters["c"], 0.2);
        for bad in ["friction=-1", "grip=1", "friction", "friction=nan", "friction=1e999"] {
            assert!(latents(bad).is_err(), "{bad}");
        }
        for bad in ["drag", "linear_drag:k=1", "linear_drag:c=-1", "linear_drag:c"] {
            assert!(parse_effect(bad).is_err(), "{bad}");
        }
    }

    /// Given effects are added to the family's, or replace one of the same name; `--real` changes the family's.
    #[test]
    fn options_extend_the_hidden_world() {
        let bowling = family("bowling").unwrap();
        let of = |effects: &[&str], real: &str| {
            let effects: Vec<String> = effects.iter().map(|e| e.to_string()).collect();
            hidden(&effects, real, bowling).unwrap()
        };
        let names = |effects: &[&str], real: &str| {
            of(effects, real).effects.iter().map(|e| e.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(&[], ""), ["linear_drag"]);
        assert_eq!(names(&["wind:ax=1", "lift:s=1"], "friction=0.3"), ["linear_drag", "wind", "lift"]);
        assert_eq!(names(&["wind:ax=1"], "damping=1"), ["wind"]);
        let replaced = of(&["linear_drag:c=0.1"], "").effects;
        assert_eq!((replaced.len(), replaced[0].parameters["c"]), (1, 0.1));
        assert_eq!(of(&[], "seed=4").seed, 4);
        for (effect, real) in [("wind:ax=x", ""), ("wind", ""), ("wind:ax=1", "seed=-1")] {
            assert!(hidden(&[effect.into()], real, bowling).is_err(), "{effect} {real}");
        }
    }
}
