//! `iplw tasks`: task families and tasks.

mod check;
mod family_import;
mod import;
mod journal;

use iplw::error::{Error, Result};
use iplw::reality::certify::certify;
use iplw::task::{Family, Split, families, family};
use serde_json::{Value, json};

use super::output;
use super::task_sources::TaskSources;

/// List task families, tasks, splits and action spaces; check or import families.
///
/// Lists all families, or the tasks of one family.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<TasksCommand>,
    /// Family [default: all]
    name: Option<String>,
    /// Print JSON with scenes, certificates, splits and action spaces.
    #[arg(long)]
    json: bool,
    /// Certify the family's tasks again and print the certificates (takes minutes).
    #[arg(long)]
    certify: bool,
    /// Random seed of the certification.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    families: TaskSources,
}

#[derive(clap::Subcommand)]
enum TasksCommand {
    /// Check a family of your own: sample candidates and certify tasks.
    ///
    /// Reads a family file (`iplw.family/1`, docs/reference/formats.md), samples candidates, and computes for each one the share of valid
    /// actions that solve it in the family's real world, and whether a solution still works when perturbed 40 times. Reports the number of
    /// tasks in each range of that share, and how many candidates are too easy, too hard, unsolvable or unstable.
    ///
    /// If all tasks are found, they are written to NAME.certified.json next to NAME.toml, and the directory can be served: `iplw serve
    /// --tasks DIR`. Otherwise the exit code is 1.
    ///
    /// An interrupted search resumes from NAME.search.jsonl unless the family file was changed.
    Check(check::Args),
    /// Import tasks from PHYRE or from a list of scenes as families.
    #[command(subcommand)]
    Import(import::ImportSource),
}

pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Some(TasksCommand::Check(args)) => return check::run(args),
        Some(TasksCommand::Import(sub)) => return import::run(sub),
        None => {}
    }
    args.families.load()?;
    let families: Vec<&Family> = match &args.name {
        Some(name) => vec![family(name)?],
        None => families().to_vec(),
    };
    if args.certify {
        return certified(&families, args.seed);
    }
    if args.json {
        let all: Vec<Value> = families.iter().map(|f| describe(f)).collect();
        let document = if args.name.is_some() { all[0].clone() } else { json!({"families": all}) };
        return output::print(&format!("{document:#}\n"));
    }
    let mut text = String::new();
    for f in families {
        let tasks = f.tasks();
        let count = |s: Split| tasks.iter().filter(|t| t.split == s).count();
        let (train, validation, test) = (count(Split::Train), count(Split::Validation), count(Split::Test));
        text += &format!("{}: {}\n", f.name, f.about);
        text += &format!("  {} tasks: {train} train, {validation} validation, {test} test\n", tasks.len());
        if let Some(task) = tasks.first() {
            text += &format!("  {} discrete actions; components:\n", task.actions().count());
            for c in &task.actions().components {
                let set = format!("{:?}", c.set).to_lowercase();
                text += &format!("    {}.{set} from {:.3} to {:.3}\n", c.target, c.low, c.high);
            }
        }
        if args.name.is_some() {
            text += "  task            split       solving share (real, undamped)\n";
            for t in &tasks {
                let shares = t.certificate.as_ref().map_or((f64::NAN, f64::NAN), |c| {
                    (100.0 * c.solving_share, 100.0 * c.solving_share_undamped)
                });
                text += &format!(
                    "  {:<15} {:<11} {:5.1} %  {:5.1} %\n",
                    t.id,
                    t.split.name(),
                    shares.0,
                    shares.1
                );
            }
        }
    }
    output::print(&text)
}

/// Certifies a family's tasks and prints the file of certified tasks.
fn certified(families: &[&Family], seed: u64) -> Result<()> {
    let [family] = families else {
        let known = families.iter().map(|f| f.name).collect::<Vec<_>>().join(", ");
        return Err(Error::input("name", "missing", format!("one family to certify of {known}")));
    };
    let bar = output::TerminalProgress::new();
    let found = certify(family, seed, &bar)?;
    bar.clear();
    output::print(&found.to_json())
}

fn describe(family: &Family) -> Value {
    let tasks = family.tasks();
    let ids = |s: Split| tasks.iter().filter(|t| t.split == s).map(|t| t.id.clone()).collect::<Vec<_>>();
    json!({
        "name": family.name,
        "about": family.about,
        "gymnasium": family.gymnasium,
        "splits": {"train": ids(Split::Train), "validation": ids(Split::Validation), "test": ids(Split::Test)},
        "action_space": tasks.first().map(|t| json!({
            "dimension": t.actions().dimension(),
            "count": t.actions().count(),
            "components": t.actions().components,
            "discrete": t.actions().discrete,
        })),
        "tasks": tasks.iter().map(|t| json!({
            "id": t.id, "split": t.split, "scene": t.scene, "certificate": t.certificate,
        })).collect::<Vec<_>>(),
    })
}
