//! `iplw.family/1`: a family of tasks as a TOML file. `docs/reference/formats.md` documents each field.

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::candidate_sampler::{CandidateSampler, MAX_CANDIDATES, ParameterRange, SampledParameter};
use super::candidate_source::CandidateSource;
use super::certificate::{Selection, SolvingShareBin};
use super::claims::{Claims, EstimateClaim, JumpStartClaim};
use super::family::Family;
use super::presets::{LabelCounts, Learning};
use super::real::RealPhysics;
use super::scene_list::SceneList;
use super::template::Template;
use crate::error::{Error, InvalidInput, Result, abbreviate, check_count, check_format, check_range};
use crate::rng;
use crate::task::expression::Expression;

/// Prior mean and standard deviation of density (kg/m^2), friction and restitution where none is given.
pub const DEFAULT_PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (0.5, 0.25), (0.5, 0.25)];
/// The value of a family's `format` field.
pub const FAMILY_FORMAT: &str = "iplw.family/1";
/// Maximum size of a family's file, bytes.
pub const MAX_FILE_BYTES: usize = 1 << 20;

/// Maximum number of parameters.
const MAX_PARAMETERS: usize = 32;
/// Maximum number of derived values, and of requirements.
const MAX_VALUES: usize = 200;
/// Maximum number of tasks of a family.
const MAX_TASKS: usize = 1000;
/// Maximum number of valid actions sampled to estimate a share.
const MAX_SAMPLED_ACTIONS: usize = 100_000;
/// Reserved names: custom tasks, policies of any family, commands, experiments.
const RESERVED_NAMES: [&str; 10] = [
    "custom",
    "any",
    "check",
    "import",
    "quickstart",
    "strategies",
    "latents",
    "policies",
    "grounding",
    "harder",
];

/// Parses a family without its certified tasks, from a single file. Errors name the line or the field.
pub fn parse(text: &str) -> Result<Family> {
    parse_beside(text, &|file| {
        let allowed = "parameters and a `scene`: a family given as text cannot refer to other files";
        Err(Error::input("candidates.scenes", format!("{file:?}"), allowed))
    })
}

/// The same, but the list of scenes may be in a file next to it: `beside` returns the text of a file by name.
pub fn parse_beside(text: &str, beside: &dyn Fn(&str) -> Result<String>) -> Result<Family> {
    if text.len() > MAX_FILE_BYTES {
        let allowed = format!("at most {MAX_FILE_BYTES} bytes");
        return Err(Error::input("", format!("{} bytes", text.len()), allowed));
    }
    let file: FamilyFile = from_toml(text)?;
    check_format(&file.format, FAMILY_FORMAT)?;
    name("name", &file.name)?;
    if let Some(taken) = RESERVED_NAMES.iter().find(|t| **t == file.name) {
        return Err(Error::input("name", format!("{taken:?}"), "a name that is not reserved"));
    }
    line("about", &file.about)?;
    let gymnasium = file.gymnasium.clone().unwrap_or_default();
    if !gymnasium.is_empty() {
        line("gymnasium", &gymnasium)?;
    }
    let (source, content) = source(&file, beside)?;
    let digest = digest(&file.name, &file.candidates, &content, &file.real);
    file.real.validate().map_err(|e| e.in_field("real"))?;
    let split = [file.tasks.train, file.tasks.validation, file.tasks.test];
    let family = Family {
        name: leak(file.name),
        about: leak(file.about),
        gymnasium: leak(gymnasium),
        source,
        split,
        selection: selection(file.tasks)?,
        real_physics: file.real,
        prior: file.prior.read()?,
        learning: file.learning.read()?,
        surface_actions: bounded("surface_actions", file.surface_actions, 1, MAX_SAMPLED_ACTIONS)?,
        claims: file.claims.read(),
        digest,
        tasks: Vec::new(),
    };
    family.checked()
}

/// The whole file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FamilyFile {
    format: String,
    name: String,
    about: String,
    gymnasium: Option<String>,
    candidates: CandidatesTable,
    scene: Option<toml::Table>,
    real: RealPhysics,
    #[serde(default)]
    prior: PriorTable,
    tasks: TasksTable,
    #[serde(default)]
    learning: LearningTable,
    #[serde(default = "default_surface_actions")]
    surface_actions: usize,
    #[serde(default)]
    claims: ClaimsTable,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CandidatesTable {
    #[serde(default)]
    parameters: toml::Table,
    #[serde(default)]
    values: toml::Table,
    #[serde(default)]
    require: Vec<String>,
    count: Option<usize>,
    /// Instead of all these and of `scene`: the name of a file in the same folder.
    scenes: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TasksTable {
    train: usize,
    validation: usize,
    test: usize,
    bins: Vec<SolvingShareBin>,
    sample: usize,
    #[serde(default)]
    in_real_world: bool,
}

/// Mean and standard deviation of each factor.
#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct PriorTable {
    density: [f64; 2],
    friction: [f64; 2],
    restitution: [f64; 2],
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct LearningTable {
    batches: Option<usize>,
    batch_size: Option<usize>,
    labels: Option<usize>,
    study_labels: Option<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ClaimsTable {
    estimates: Vec<EstimateClaimTable>,
    /// (better, worse)
    jump_starts: Vec<[String; 2]>,
    all_trials: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EstimateClaimTable {
    text: String,
    better: String,
    worse: String,
    factors: Vec<String>,
}

impl Default for PriorTable {
    /// The paper's prior.
    fn default() -> Self {
        let [density, friction, restitution] = DEFAULT_PRIOR.map(|(mean, sd)| [mean, sd]);
        PriorTable { density, friction, restitution }
    }
}

impl PriorTable {
    fn read(&self) -> Result<[(f64, f64); 3]> {
        let of = [("density", self.density), ("friction", self.friction), ("restitution", self.restitution)];
        for (name, [mean, deviation]) in of {
            check_range(&format!("prior.{name}[0]"), mean, 0.0, 1e6)?;
            check_range(&format!("prior.{name}[1]"), deviation, 1e-6, 1e6)?;
        }
        Ok(of.map(|(_, [mean, deviation])| (mean, deviation)))
    }
}

impl LearningTable {
    fn read(&self) -> Result<Learning> {
        let usual = Learning::STANDARD;
        let batch_size =
            bounded("learning.batch_size", self.batch_size.unwrap_or(usual.batch_size), 2, 1024)?;
        if batch_size % 2 == 1 {
            let allowed = "an even number: half of a batch are solving actions";
            return Err(Error::input("learning.batch_size", batch_size, allowed));
        }
        let labels = |field: &str, given: Option<usize>, usual: LabelCounts| {
            let per_task = bounded(field, given.unwrap_or(usual.per_task), 2, MAX_SAMPLED_ACTIONS)?;
            Ok(LabelCounts { per_task, ..usual })
        };
        Ok(Learning {
            batches: bounded("learning.batches", self.batches.unwrap_or(usual.batches), 1, 100_000)?,
            batch_size,
            labels: labels("learning.labels", self.labels, usual.labels)?,
            study_labels: labels("learning.study_labels", self.study_labels, usual.study_labels)?,
        })
    }
}

impl ClaimsTable {
    fn read(self) -> Claims {
        let nearer = |c: EstimateClaimTable| EstimateClaim {
            text: leak(c.text),
            better: leak(c.better),
            worse: leak(c.worse),
            factors: c.factors.into_iter().map(leak).collect::<Vec<_>>().leak(),
        };
        let ahead = |[better, worse]: [String; 2]| JumpStartClaim {
            text: leak(format!("{better} beats {worse}")),
            better: leak(better),
            worse: leak(worse),
        };
        Claims {
            estimates: self.estimates.into_iter().map(nearer).collect::<Vec<_>>().leak(),
            jump_starts: self.jump_starts.into_iter().map(ahead).collect::<Vec<_>>().leak(),
            all_trials: self.all_trials,
        }
    }
}

/// Leaks a text: families live as long as the program.
fn leak(text: String) -> &'static str {
    text.leak()
}

fn default_surface_actions() -> usize {
    600
}

/// Parses TOML; an error names line and path.
fn from_toml<T: DeserializeOwned>(text: &str) -> Result<T> {
    let refuse = |path: String, error: &toml::de::Error| {
        let line = error.span().map(|s| text.as_bytes()[..s.start.min(text.len())].iter());
        let place =
            line.map_or(String::new(), |l| format!("line {}", 1 + l.filter(|b| **b == b'\n').count()));
        let reason = abbreviate(&error.message().replace('\n', ", "));
        let allowed = format!("what {FAMILY_FORMAT} allows ({reason})");
        let field = abbreviate(if path == "." { "" } else { &path });
        Error::Input(InvalidInput { place, field, value: String::new(), allowed })
    };
    let read = toml::Deserializer::parse(text).map_err(|e| refuse(String::new(), &e))?;
    serde_path_to_error::deserialize(read).map_err(|e| refuse(e.path().to_string(), e.inner()))
}

/// The source of the candidates, and a text that identifies their scenes.
fn source(file: &FamilyFile, beside: &dyn Fn(&str) -> Result<String>) -> Result<(CandidateSource, String)> {
    match (&file.scene, &file.candidates.scenes) {
        (Some(scene), None) => {
            let (recipe, names) = recipe(&file.candidates)?;
            let template = Template::new(scene, &names)?;
            let content = serde_json::to_string(scene).unwrap_or_default();
            Ok((CandidateSource::Drawn { recipe, template }, content))
        }
        (None, Some(scenes)) => {
            let drawn = &file.candidates;
            let all =
                [drawn.parameters.len(), drawn.values.len(), drawn.require.len(), drawn.count.iter().len()];
            if all != [0; 4] {
                let value = "given together with parameters, values, require or count";
                let allowed = "`candidates.scenes` alone, without parameters, values, require and count";
                return Err(Error::input("candidates.scenes", value, allowed));
            }
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
            if scenes.is_empty() || scenes.starts_with('.') || !scenes.chars().all(plain) {
                let allowed = "the name of a file in the same folder: a to z, 0 to 9, _, - and .";
                return Err(Error::input("candidates.scenes", format!("{scenes:?}"), allowed));
            }
            let content = beside(scenes)?;
            Ok((CandidateSource::Listed(SceneList::parse(scenes, &content)?), content))
        }
        (Some(_), Some(_)) => {
            let allowed = "either `scene` or `candidates.scenes`, a file with one scene per line";
            Err(Error::input("candidates.scenes", "given together with `scene`", allowed))
        }
        (None, None) => {
            let allowed = "a table, or `candidates.scenes`, a file with one scene per line";
            Err(Error::input("scene", "missing", allowed))
        }
    }
}

/// The sampler, and the names available in expressions, in order.
fn recipe(from: &CandidatesTable) -> Result<(CandidateSampler, Vec<String>)> {
    for (field, number, most) in [
        ("parameters", from.parameters.len(), MAX_PARAMETERS),
        ("values", from.values.len(), MAX_VALUES),
        ("require", from.require.len(), MAX_VALUES),
    ] {
        if number > most {
            let allowed = format!("at most {most}");
            return Err(Error::input(format!("candidates.{field}"), format!("{number}"), allowed));
        }
    }
    let mut recipe = CandidateSampler::default();
    let mut names: Vec<String> = Vec::new();
    for (key, value) in &from.parameters {
        let field = format!("candidates.parameters.{key}");
        name(&field, key)?;
        recipe.parameters.push(SampledParameter { name: key.clone(), range: range(&field, value)? });
        names.push(key.clone());
    }
    for (key, value) in &from.values {
        let field = format!("candidates.values.{key}");
        name(&field, key)?;
        if names.contains(key) {
            return Err(Error::input(field, format!("{key:?}"), "a name that is not in use"));
        }
        recipe.values.push(match value {
            toml::Value::String(text) => Expression::parse(&field, text, &names)?,
            other => Expression::number(number(&field, other)?),
        });
        names.push(key.clone());
    }
    for (i, text) in from.require.iter().enumerate() {
        let rule = Expression::parse(&format!("candidates.require[{i}]"), text, &names)?;
        recipe.require.push((text.clone(), rule));
    }
    if let Some(count) = from.count {
        recipe.count = Some(bounded("candidates.count", count, 1, MAX_CANDIDATES)?);
    }
    let points = recipe.parameters.iter().try_fold(1usize, |n, p| match &p.range {
        ParameterRange::Among(values) => n.checked_mul(values.len()),
        ParameterRange::Between(..) => Some(n),
    });
    match points {
        Some(1..=MAX_CANDIDATES) => Ok((recipe, names)),
        _ => {
            let allowed = format!(
                "a grid of at most {MAX_CANDIDATES} points; with `low` and `high` a parameter is sampled instead"
            );
            Err(Error::input("candidates.parameters", "a larger grid", allowed))
        }
    }
}

/// Parses a list, `{ from, to, step }` or `{ low, high }`.
fn range(field: &str, value: &toml::Value) -> Result<ParameterRange> {
    const ALLOWED: &str = "a list of numbers, { from, to, step } or { low, high }";
    let refuse = || Error::input(field, abbreviate(&value.to_string()), ALLOWED);
    match value {
        toml::Value::Array(items) if !items.is_empty() => {
            let each = items.iter().enumerate().map(|(i, v)| number(&format!("{field}[{i}]"), v));
            each.collect::<Result<Vec<f64>>>().map(ParameterRange::Among)
        }
        toml::Value::Table(table) => {
            let keys: Vec<&str> = table.keys().map(String::as_str).collect();
            let get = |key: &str| number(&format!("{field}.{key}"), &table[key]);
            let all = |wanted: &[&str]| keys.len() == wanted.len() && wanted.iter().all(|k| keys.contains(k));
            if all(&["low", "high"]) {
                let (low, high) = (get("low")?, get("high")?);
                return Ok(ParameterRange::Between(
                    low,
                    check_range(&format!("{field}.high"), high, low, 1e9)?,
                ));
            }
            if !all(&["from", "to", "step"]) {
                return Err(refuse());
            }
            let (from, to, step) = (get("from")?, get("to")?, get("step")?);
            let most = (to - from) / (MAX_CANDIDATES as f64);
            if !(to >= from && step > 0.0 && step >= most) {
                return Err(refuse());
            }
            // Tolerates a last value beyond `to` by rounding.
            let last = ((to - from) / step + 1e-9).floor() as usize;
            Ok(ParameterRange::Among((0..=last).map(|i| from + i as f64 * step).collect()))
        }
        _ => Err(refuse()),
    }
}

fn selection(from: TasksTable) -> Result<Selection> {
    let mut least = 0.0;
    for (i, bin) in from.bins.iter().enumerate() {
        least = check_range(&format!("tasks.bins[{i}].from"), bin.from, least, 1.0)?;
        least = check_range(&format!("tasks.bins[{i}].to"), bin.to, least, 1.0)?;
        bounded(&format!("tasks.bins[{i}].tasks"), bin.tasks, 1, MAX_TASKS)?;
    }
    if from.bins.first().is_some_and(|b| b.to == 0.0) {
        return Err(Error::input("tasks.bins[0].to", 0, "a share above 0: every task needs a solution"));
    }
    let sample = bounded("tasks.sample", from.sample, 10, MAX_SAMPLED_ACTIONS)?;
    let selection = Selection { bins: from.bins, in_real_world: from.in_real_world, sample };
    let dealt = [from.train, from.validation, from.test].iter().fold(0usize, |n, m| n.saturating_add(*m));
    bounded("tasks.train + validation + test", dealt, 1, MAX_TASKS)?;
    if dealt != selection.n_tasks() {
        let value = format!("{} in total, but train, validation and test are {dealt}", selection.n_tasks());
        let allowed = "as many tasks as train, validation and test together";
        return Err(Error::input("tasks.bins", value, allowed));
    }
    Ok(selection)
}

/// Digest of everything that certified tasks depend on, as 16 hexadecimal digits; whitespace, comments, bins
/// and presets do not change it.
fn digest(name: &str, candidates: &CandidatesTable, scene: &str, real: &RealPhysics) -> String {
    let text = |table: &toml::Table| serde_json::to_string(table).unwrap_or_default();
    let drawn = format!("{:?} {:?}", candidates.require, candidates.count);
    let (parameters, values) = (text(&candidates.parameters), text(&candidates.values));
    let all = [name, &parameters, &values, &drawn, scene, &real.fingerprint()].join("\n");
    format!("{:016x}", rng::derive_seed(0, &all, 0))
}

fn name(field: &str, text: &str) -> Result<()> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let fits = (1..=40).contains(&text.len()) && text.starts_with(|c: char| c.is_ascii_lowercase());
    if fits && text.chars().all(plain) {
        return Ok(());
    }
    let allowed = "1 to 40 of a to z, 0 to 9 and _, a letter first";
    Err(Error::input(field, format!("{text:?}"), allowed))
}

fn line(field: &str, text: &str) -> Result<()> {
    if (1..=200).contains(&text.len()) && !text.contains(char::is_control) {
        return Ok(());
    }
    Err(Error::input(field, format!("{text:?}"), "one line of 1 to 200 bytes"))
}

fn number(field: &str, value: &toml::Value) -> Result<f64> {
    let found = match value {
        toml::Value::Integer(v) => *v as f64,
        toml::Value::Float(v) => *v,
        other => return Err(Error::input(field, abbreviate(&other.to_string()), "a number")),
    };
    check_range(field, found, -1e9, 1e9)
}

fn bounded(field: &str, value: usize, low: usize, high: usize) -> Result<usize> {
    check_count(field, value, low, high).map(|()| value)
}
