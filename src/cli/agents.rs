//! `iplw agents`: comparison of agents over many families, from tables of outcomes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use iplw::error::{Error, Result};
use iplw::experiment::statistics::Summary;
use iplw::policy::agents::{
    Agent, AgentsConfig, Fold, FoldResult, GeneralizationSetting, TrainingSet, agent, evaluate_agent, fold,
};
use iplw::policy::{OutcomeTable, TrainConfig};
use iplw::progress::NoProgress;
use serde_json::{Value, json};

use super::cell_store::CellStore;
use super::outcomes::{OutcomesTable, read_all};
use super::output;

/// Compare agents on tables of outcomes: AUCCESS within and across families.
///
/// Compares agents over many families as PHYRE does: they learn from some tasks and have 100 attempts at each of the others.
///
/// Within families, agents learn from 80 % of each family's tasks and are evaluated on the rest; across families, they learn from 80 % of
/// the families and are evaluated on the others. Outcomes of actions are looked up in tables, without simulation. Writes agents.json and a
/// file for each fold, from which an interrupted run resumes.
#[derive(clap::Args)]
pub struct Args {
    /// Directories of `iplw outcomes`, one for each family, of the world for learning and evaluation.
    #[arg(long, num_args = 1.., required = true, value_name = "DIR")]
    tables: Vec<PathBuf>,
    /// The same for the simulated world, with the same actions; needed by the agent `simulate`.
    #[arg(long, num_args = 1.., value_name = "DIR")]
    posteriors: Vec<PathBuf>,
    /// Agents: random, memory, dqn, simulate [default: all; simulate only with --posteriors]
    #[arg(long, value_delimiter = ',')]
    agents: Vec<String>,
    /// Settings: within, across [default: both; across only with several families]
    #[arg(long, value_delimiter = ',')]
    setting: Vec<String>,
    /// Number of folds: random splits into training and test tasks.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    folds: u64,
    /// Valid actions per training task for the DQN; more if few solve the task [default: the standard number]
    #[arg(long)]
    per_task: Option<usize>,
    /// Gradient updates of the DQN [default: the standard number]
    #[arg(long)]
    batches: Option<usize>,
    /// Examples per update, half of them successes [default: the standard number]
    #[arg(long)]
    batch_size: Option<usize>,
    /// Random seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Output directory.
    #[arg(long, default_value = "agents")]
    out: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Published AUCCESS x 100 for PHYRE-B, within and across templates.
const PUBLISHED: [(&str, f64, f64, &str); 4] = [
    ("RAND", 13.7, 13.0, "Bakhtin et al. 2019"),
    ("DQN", 77.6, 36.8, "Bakhtin et al. 2019"),
    ("Dec[Joint]", 80.0, 40.3, "Girdhar et al. 2020"),
    ("RPIN", 85.2, 42.2, "Qi et al. 2021"),
];
const COMPARABILITY_NOTE: &str = "Published figures are for PHYRE-B: 25 templates of 100 tasks in Box2D, 100,000 actions per task. \
    They are not comparable: the worlds are not the same (other families, physics, tasks and actions).";

/// Input and configuration of a comparison.
struct Comparison {
    tables: TableSet,
    posteriors: TableSet,
    agents: Vec<Agent>,
    settings: Vec<GeneralizationSetting>,
    config: AgentsConfig,
}

/// Tables of a world, with the metadata and digest of each.
#[derive(Default)]
struct TableSet {
    tables: Vec<OutcomeTable>,
    about: Vec<Value>,
    digests: Vec<String>,
}

pub fn run(args: &Args) -> Result<()> {
    let plan = comparison(args)?;
    let (tables, posteriors) = (&plan.tables.tables, &plan.posteriors.tables);
    let mut folds = Vec::new();
    for setting in &plan.settings {
        for number in 0..args.folds as usize {
            folds.push(fold(tables, *setting, number, args.seed)?);
        }
    }
    let jobs: Vec<(&Agent, &Fold)> =
        plan.agents.iter().flat_map(|agent| folds.iter().map(move |fold| (agent, fold))).collect();
    let cells = CellStore::new(&args.out, jobs.len())?;
    let named = |(agent, fold): &(&Agent, &Fold)| {
        let name = format!("{}-{}-{:03}", fold.setting.name(), agent.name, fold.number);
        let of = json!({"seed": args.seed, "config": plan.config, "tables": plan.tables.digests,
            "beliefs": if agent.simulates { &plan.posteriors.digests[..] } else { &[] }});
        (name, of)
    };
    let found: Vec<FoldResult> = cells.compute_all(&jobs, named, |(agent, fold)| {
        let lessons = TrainingSet { tables, posteriors, fold, config: &plan.config };
        evaluate_agent(agent, &lessons, &NoProgress)
    })?;
    cells.finish();
    let document = document(args, &plan, &jobs, &found);
    let path = args.out.join("agents.json");
    output::write_whole(&path, format!("{document:#}\n").as_bytes())?;
    if args.json {
        return output::print(&format!("{document:#}\n"));
    }
    output::print(&format!("{}results: {}\n", summary_table(&plan, &document), path.display()))
}

/// Reads tables and options, and checks that they match.
fn comparison(args: &Args) -> Result<Comparison> {
    let tables = read_all("--tables", &args.tables)?;
    let posteriors = match_tables(&tables, read_all("--posteriors", &args.posteriors)?)?;
    let names = match args.agents.as_slice() {
        [] => ["random", "memory", "dqn"]
            .into_iter()
            .chain((!posteriors.is_empty()).then_some("simulate"))
            .collect(),
        given => given.iter().map(String::as_str).collect::<Vec<_>>(),
    };
    let mut agents = Vec::new();
    for name in names {
        let agent = agent(name)?;
        if agent.simulates && posteriors.is_empty() {
            let allowed = format!("directories of tables of the simulated world, which {name} needs");
            return Err(Error::input("--posteriors", "none", allowed));
        }
        if agents.iter().all(|a: &Agent| a.name != agent.name) {
            agents.push(agent);
        }
    }
    let mut settings =
        args.setting.iter().map(|s| GeneralizationSetting::from_name(s)).collect::<Result<Vec<_>>>()?;
    settings.sort_by_key(|s| GeneralizationSetting::ALL.iter().position(|known| known == s));
    settings.dedup();
    if settings.is_empty() {
        settings = GeneralizationSetting::ALL
            .into_iter()
            .filter(|s| *s == GeneralizationSetting::Within || tables.len() > 1)
            .collect();
    }
    let usual = AgentsConfig::standard();
    let train = TrainConfig {
        batches: args.batches.unwrap_or(usual.train.batches),
        batch_size: args.batch_size.unwrap_or(usual.train.batch_size),
        ..usual.train
    };
    let config = AgentsConfig { per_task: args.per_task.unwrap_or(usual.per_task), train, ..usual };
    config.validate()?;
    Ok(Comparison { tables: tables.into(), posteriors: posteriors.into(), agents, settings, config })
}

impl From<Vec<OutcomesTable>> for TableSet {
    fn from(all: Vec<OutcomesTable>) -> TableSet {
        let mut world = TableSet::default();
        for OutcomesTable { table, about, digest } in all {
            world.tables.push(table);
            world.about.push(about);
            world.digests.push(format!("{digest:016x}"));
        }
        world
    }
}

/// Tables of the simulated world in the order of the others: none, or one for each with the same tasks and actions.
fn match_tables(tables: &[OutcomesTable], mut posteriors: Vec<OutcomesTable>) -> Result<Vec<OutcomesTable>> {
    if posteriors.is_empty() {
        return Ok(posteriors);
    }
    let one = |real: &OutcomesTable| {
        let name = real.table.family();
        let found = posteriors.iter().position(|b| b.table.family() == name);
        let simulated = found.map(|i| posteriors.swap_remove(i)).ok_or_else(|| {
            Error::input("--posteriors", format!("none of {name}"), "a table for each of --tables")
        })?;
        let ids = |r: &OutcomesTable| r.table.tasks().iter().map(|t| t.id.clone()).collect::<Vec<_>>();
        if simulated.table.actions() != real.table.actions() || ids(&simulated) != ids(real) {
            let value = format!("a table of {name} with other tasks or actions");
            return Err(Error::input(
                "--posteriors",
                value,
                "the tasks, --actions and --seed of its table in --tables",
            ));
        }
        if simulated.digest == real.digest {
            let allowed = "a table of the simulated world; this one has the outcomes of the real world";
            return Err(Error::input("--posteriors", format!("the table of {name} in --tables"), allowed));
        }
        Ok(simulated)
    };
    tables.iter().map(one).collect()
}

fn document(args: &Args, plan: &Comparison, jobs: &[(&Agent, &Fold)], found: &[FoldResult]) -> Value {
    let rows = |setting: GeneralizationSetting, name: &str| -> Vec<(&Fold, &FoldResult)> {
        let all = jobs.iter().zip(found).filter(|((a, f), _)| f.setting == setting && a.name == name);
        all.map(|((_, fold), tried)| (*fold, tried)).collect()
    };
    let mut settings = serde_json::Map::new();
    for setting in &plan.settings {
        let agents = plan.agents.iter().map(|a| (a.name.to_string(), summary(&rows(*setting, a.name))));
        settings.insert(setting.name().into(), Value::Object(agents.collect()));
    }
    let listed = |world: &TableSet| -> Vec<Value> {
        let table = |(t, about): (&OutcomeTable, &Value)| {
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
        "posteriors": listed(&plan.posteriors), "settings": settings,
        "published": {"auccess_times_100": published, "note": COMPARABILITY_NOTE},
    })
}

/// Results of an agent in a setting: over folds, by family, and by fold.
fn summary(rows: &[(&Fold, &FoldResult)]) -> Value {
    let over = |of: fn(&FoldResult) -> f64| Summary::of(&rows.iter().map(|(_, t)| of(t)).collect::<Vec<_>>());
    let mut families: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, auccess) in rows.iter().flat_map(|(_, t)| &t.families) {
        families.entry(name).or_default().push(*auccess);
    }
    let families: BTreeMap<&str, Summary> = families.into_iter().map(|(n, v)| (n, Summary::of(&v))).collect();
    let fold = |(fold, tried): &(&Fold, &FoldResult)| {
        json!({"fold": fold.number, "seed": fold.seed, "learned_from": fold.train.len(), "auccess": tried.auccess,
            "best": tried.best, "families": tried.families, "solved_at": tried.solved_at})
    };
    json!({"auccess": over(|t| t.auccess), "best": over(|t| t.best), "families": families,
        "folds": rows.iter().map(fold).collect::<Vec<_>>()})
}

fn summary_table(plan: &Comparison, document: &Value) -> String {
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
    // The best possible score is the same for every agent.
    text += &line("best", plan.agents.first().map_or(Vec::new(), |a| of(a.name, "best")));
    text += &format!("{COMPARABILITY_NOTE}\n");
    for (name, within, across, source) in PUBLISHED {
        let of = |s: &GeneralizationSetting| {
            format!("{:.1}", if *s == GeneralizationSetting::Within { within } else { across })
        };
        text += &format!("{}  {source}\n", line(name, plan.settings.iter().map(of).collect()).trim_end());
    }
    text
}
