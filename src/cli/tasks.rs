//! `iplw tasks`: what there is to do.

mod check;
mod import;
mod journal;
mod taken;

use iplw::error::{Error, Result};
use iplw::reality::certify::certify;
use iplw::task::{Family, Split, families, family};
use serde_json::{Value, json};

use super::output;
use super::own::OwnFamilies;

/// Without a name, every family; with one, its tasks.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Sub>,
    /// A family.
    name: Option<String>,
    /// Print JSON: tasks with scenes and certificates, splits, action space.
    #[arg(long)]
    json: bool,
    /// Search the family's tasks anew and print their certificates (takes minutes).
    #[arg(long)]
    certify: bool,
    /// Seed of that search.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    families: OwnFamilies,
}

#[derive(clap::Subcommand)]
enum Sub {
    /// Try a family of your own: draw its candidates, certify its tasks, say what is too easy, unsolvable or unstable.
    ///
    /// Reads a family's file (`iplw.family/1`, docs/formats.md), draws its candidates and looks at one after the other: how many of
    /// its valid actions solve it in the family's real world, and whether a solution goes on to if it is perturbed 40 times. Says
    /// of each range of that share how many tasks were found, and of the rest whether they are too easy, too hard, unsolvable or
    /// unstable.
    ///
    /// Where all tasks are found, they are written beside the file, NAME.certified.json beside NAME.toml, and the folder can be
    /// served: `iplw serve --tasks DIR`. Exit code 1 if they are not.
    ///
    /// A search that was stopped goes on where it was when it is run again: NAME.search.jsonl beside the file has what was found,
    /// until all is. It begins anew when the file was changed.
    Check(check::Args),
    /// Make families of tasks that others wrote: PHYRE's, or any list of scenes.
    #[command(subcommand)]
    Import(import::Sub),
}

pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Some(Sub::Check(args)) => return check::run(args),
        Some(Sub::Import(sub)) => return import::run(sub),
        None => {}
    }
    args.families.take()?;
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

/// Prints the file of a family's certified tasks, searched anew.
fn certified(families: &[&Family], seed: u64) -> Result<()> {
    let [family] = families else {
        let known = families.iter().map(|f| f.name).collect::<Vec<_>>().join(", ");
        return Err(Error::input("name", "missing", format!("one family to certify of {known}")));
    };
    let bar = output::Bar::new();
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
