//! `iplw agents`: agents compared over many families, from tables of outcomes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use iplw::error::{Error, Result};
use iplw::experiment::statistics::Summary;
use iplw::policy::agents::{Agent, AgentsConfig, Fold, Lessons, Setting, Tried, agent, fold, try_agent};
use iplw::policy::{Table, TrainConfig};
use iplw::progress::Silent;
use serde_json::{Value, json};

use super::cells::Cells;
use super::outcomes::{Read, read_all};
use super::output;

/// Compares agents over many families as PHYRE does: they learn from some tasks and have 100 attempts at each of others.
///
/// Within families they learn from 80 % of each one's tasks and are tried on the rest; across families they learn from 80 %
/// of the families and are tried on the others. No simulator is asked: tables of outcomes say what an action does. Writes
/// agents.json, and each fold as soon as it is known: stopped, it goes on where it was when it is begun again.
#[derive(clap::Args)]
pub struct Args {
    /// Directories that `iplw outcomes` wrote, one a family: of the world in which agents learn and are tried.
    #[arg(long, num_args = 1.., required = true, value_name = "DIR")]
    tables: Vec<PathBuf>,
    /// The same of the world that the simulation believes, with the same actions: for the agent simulate.
    #[arg(long, num_args = 1.., value_name = "DIR")]
    beliefs: Vec<PathBuf>,
    /// random, memory, dqn, simulate; all of them if not given, simulate if there are --beliefs.
    #[arg(long, value_delimiter = ',')]
    agents: Vec<String>,
    /// within, across; both if not given, across if there is more than one family.
    #[arg(long, value_delimiter = ',')]
    setting: Vec<String>,
    /// Ways to deal tasks to learning and trying, over which means and standard errors are taken.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    folds: u64,
    /// Valid actions of each training task that the DQN learns from; more of a task that few of them solve.
    #[arg(long)]
    per_task: Option<usize>,
    /// Updates of the DQN.
    #[arg(long)]
    batches: Option<usize>,
    /// Examples per update, half of them solving.
    #[arg(long)]
    batch_size: Option<usize>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Directory for results.
    #[arg(long, default_value = "agents")]
    out: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// AUCCESS x 100 within and across templates that were published for PHYRE-B.
const PUBLISHED: [(&str, f64, f64, &str); 4] = [
    ("RAND", 13.7, 13.0, "Bakhtin et al. 2019"),
    ("DQN", 77.6, 36.8, "Bakhtin et al. 2019"),
    ("Dec[Joint]", 80.0, 40.3, "Girdhar et al. 2020"),
    ("RPIN", 85.2, 42.2, "Qi et al. 2021"),
];
const NOT_THE_SAME: &str = "Published figures are of PHYRE-B: 25 templates of 100 tasks in Box2D, 100,000 actions a task. \
    The worlds are not the same: other families, physics, tasks and actions, so figures stand beside each other and do not compare.";

/// What is to be found out.
struct Plan {
    tables: World,
    beliefs: World,
    agents: Vec<Agent>,
    settings: Vec<Setting>,
    config: AgentsConfig,
}

/// Tables of a world, with what each says of itself and its digest.
#[derive(Default)]
struct World {
    tables: Vec<Table>,
    about: Vec<Value>,
    digests: Vec<String>,
}

pub fn run(args: &Args) -> Result<()> {
    let plan = plan(args)?;
    let (tables, beliefs) = (&plan.tables.tables, &plan.beliefs.tables);
    let mut folds = Vec::new();
    for setting in &plan.settings {
        for number in 0..args.folds as usize {
            folds.push(fold(tables, *setting, number, args.seed)?);
        }
    }
    let jobs: Vec<(&Agent, &Fold)> =
        plan.agents.iter().flat_map(|agent| folds.iter().map(move |fold| (agent, fold))).collect();
    let cells = Cells::new(&args.out, jobs.len())?;
    let named = |(agent, fold): &(&Agent, &Fold)| {
        let name = format!("{}-{}-{:03}", fold.setting.name(), agent.name, fold.number);
        let of = json!({"seed": args.seed, "config": plan.config, "tables": plan.tables.digests,
            "beliefs": if agent.simulates { &plan.beliefs.digests[..] } else { &[] }});
        (name, of)
    };
    let found: Vec<Tried> = cells.all(&jobs, named, |(agent, fold)| {
        let lessons = Lessons { tables, beliefs, fold, config: &plan.config };
        try_agent(agent, &lessons, &Silent)
    })?;
    cells.finish();
    let document = document(args, &plan, &jobs, &found);
    let path = args.out.join("agents.json");
    output::write_whole(&path, format!("{document:#}\n").as_bytes())?;
    if args.json {
        return output::print(&format!("{document:#}\n"));
    }
    output::print(&format!("{}results: {}\n", told(&plan, &document), path.display()))
}

/// Reads tables and options, and holds them against each other.
fn plan(args: &Args) -> Result<Plan> {
    let tables = read_all("--tables", &args.tables)?;
    let beliefs = matched(&tables, read_all("--beliefs", &args.beliefs)?)?;
    let names = match args.agents.as_slice() {
        [] => ["random", "memory", "dqn"]
            .into_iter()
            .chain((!beliefs.is_empty()).then_some("simulate"))
            .collect(),
        given => given.iter().map(String::as_str).collect::<Vec<_>>(),
    };
    let mut agents = Vec::new();
    for name in names {
        let agent = agent(name)?;
        if agent.simulates && beliefs.is_empty() {
            let allowed = format!("directories of tables of the believed world: {name} ranks by them");
            return Err(Error::input("--beliefs", "none", allowed));
        }
        if agents.iter().all(|a: &Agent| a.name != agent.name) {
            agents.push(agent);
        }
    }
    let mut settings = args.setting.iter().map(|s| Setting::from_name(s)).collect::<Result<Vec<_>>>()?;
    settings.sort_by_key(|s| Setting::ALL.iter().position(|known| known == s));
    settings.dedup();
    if settings.is_empty() {
        settings = Setting::ALL.into_iter().filter(|s| *s == Setting::Within || tables.len() > 1).collect();
    }
    let usual = AgentsConfig::standard();
    let train = TrainConfig {
        batches: args.batches.unwrap_or(usual.train.batches),
        batch_size: args.batch_size.unwrap_or(usual.train.batch_size),
        ..usual.train
    };
    let config = AgentsConfig { per_task: args.per_task.unwrap_or(usual.per_task), train, ..usual };
    config.validate()?;
    Ok(Plan { tables: tables.into(), beliefs: beliefs.into(), agents, settings, config })
}

impl From<Vec<Read>> for World {
    fn from(all: Vec<Read>) -> World {
        let mut world = World::default();
        for Read { table, about, digest } in all {
            world.tables.push(table);
            world.about.push(about);
            world.digests.push(format!("{digest:016x}"));
        }
        world
    }
}

/// Tables of what is believed, in the order of those that are tried; none, or one for each, of the same tasks and actions.
fn matched(tables: &[Read], mut beliefs: Vec<Read>) -> Result<Vec<Read>> {
    if beliefs.is_empty() {
        return Ok(beliefs);
    }
    let one = |real: &Read| {
        let name = real.table.family();
        let found = beliefs.iter().position(|b| b.table.family() == name);
        let belief = found.map(|i| beliefs.swap_remove(i)).ok_or_else(|| {
            Error::input("--beliefs", format!("none of {name}"), "a table for each of --tables")
        })?;
        let ids = |r: &Read| r.table.tasks().iter().map(|t| t.id.clone()).collect::<Vec<_>>();
        if belief.table.actions() != real.table.actions() || ids(&belief) != ids(real) {
            let value = format!("a table of {name} with other tasks or actions");
            return Err(Error::input(
                "--beliefs",
                value,
                "the tasks, --actions and --seed of its table in --tables",
            ));
        }
        if belief.digest == real.digest {
            let allowed = "a table of the world as it is believed: this one holds what the real world did";
            return Err(Error::input("--beliefs", format!("the table of {name} in --tables"), allowed));
        }
        Ok(belief)
    };
    tables.iter().map(one).collect()
}

fn document(args: &Args, plan: &Plan, jobs: &[(&Agent, &Fold)], found: &[Tried]) -> Value {
    let rows = |setting: Setting, name: &str| -> Vec<(&Fold, &Tried)> {
        let all = jobs.iter().zip(found).filter(|((a, f), _)| f.setting == setting && a.name == name);
        all.map(|((_, fold), tried)| (*fold, tried)).collect()
    };
    let mut settings = serde_json::Map::new();
    for setting in &plan.settings {
        let agents = plan.agents.iter().map(|a| (a.name.to_string(), summary(&rows(*setting, a.name))));
        settings.insert(setting.name().into(), Value::Object(agents.collect()));
    }
    let listed = |world: &World| -> Vec<Value> {
        let table = |(t, about): (&Table, &Value)| {
            json!({"family": t.family(), "digest": about["digest"], "world": about["world"], "latents": about["latents"],
                "effects": about["effects"], "engine": about["engine"], "tasks": t.tasks().len(), "actions": t.actions().len()})
        };
        world.tables.iter().zip(&world.about).map(table).collect()
    };
    let published = PUBLISHED
        .map(|(name, within, across, source)| json!({"name": name, "within": within, "across": across, "source": source}));
    json!({
        "format": "iplw.agents/1", "version": env!("CARGO_PKG_VERSION"), "seed": args.seed, "folds": args.folds,
        "config": plan.config, "tables": listed(&plan.tables),
        "beliefs": listed(&plan.beliefs), "settings": settings,
        "published": {"auccess_times_100": published, "note": NOT_THE_SAME},
    })
}

/// An agent in a setting: over folds, by family, and fold by fold.
fn summary(rows: &[(&Fold, &Tried)]) -> Value {
    let over = |of: fn(&Tried) -> f64| Summary::of(&rows.iter().map(|(_, t)| of(t)).collect::<Vec<_>>());
    let mut families: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, auccess) in rows.iter().flat_map(|(_, t)| &t.families) {
        families.entry(name).or_default().push(*auccess);
    }
    let families: BTreeMap<&str, Summary> = families.into_iter().map(|(n, v)| (n, Summary::of(&v))).collect();
    let fold = |(fold, tried): &(&Fold, &Tried)| {
        json!({"fold": fold.number, "seed": fold.seed, "learned_from": fold.train.len(), "auccess": tried.auccess,
            "best": tried.best, "families": tried.families, "solved_at": tried.solved_at})
    };
    json!({"auccess": over(|t| t.auccess), "best": over(|t| t.best), "families": families,
        "folds": rows.iter().map(fold).collect::<Vec<_>>()})
}

fn told(plan: &Plan, document: &Value) -> String {
    let cell = |value: &Value| match serde_json::from_value::<Summary>(value.clone()) {
        Ok(s) => {
            let hundred = |v: f64| 100.0 * v;
            Summary { mean: hundred(s.mean), standard_error: s.standard_error.map(hundred), ..s }.show(1)
        }
        Err(_) => String::new(),
    };
    let line = |name: &str, cells: Vec<String>| {
        let cells: String = cells.iter().map(|c| format!("{c:>16}")).collect();
        format!("{}\n", format!("{name:<12}{cells}").trim_end())
    };
    let of = |agent: &str, field: &str| -> Vec<String> {
        plan.settings.iter().map(|s| cell(&document["settings"][s.name()][agent][field])).collect()
    };
    let tasks: usize = plan.tables.tables.iter().map(|t| t.tasks().len()).sum();
    let mut text = format!(
        "AUCCESS x 100, mean +- standard error over {} folds; {} families, {tasks} tasks\n",
        document["folds"],
        plan.tables.tables.len()
    );
    text += &line("", plan.settings.iter().map(|s| s.name().to_string()).collect());
    for agent in &plan.agents {
        text += &line(agent.name, of(agent.name, "auccess"));
    }
    // The same for every agent: it is the tables' own.
    text += &line("best", plan.agents.first().map_or(Vec::new(), |a| of(a.name, "best")));
    text += &format!("{NOT_THE_SAME}\n");
    for (name, within, across, source) in PUBLISHED {
        let of = |s: &Setting| format!("{:.1}", if *s == Setting::Within { within } else { across });
        text += &format!("{}  {source}\n", line(name, plan.settings.iter().map(of).collect()).trim_end());
    }
    text
}
