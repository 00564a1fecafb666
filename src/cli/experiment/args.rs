//! Options of `iplw run` and `iplw experiment`.

use std::path::PathBuf;

use iplw::task::DEFAULT_FAMILY;

/// The story: a hidden world, its latents estimated, a policy trained in the grounded simulation and tried on
/// unseen tasks of the hidden world, beside its baselines. Writes report.html, data as CSV and JSON, plots.
#[derive(clap::Args)]
pub struct RunArgs {
    /// A family (`iplw tasks` lists them).
    #[arg(long, default_value = DEFAULT_FAMILY)]
    pub task: String,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Directory for the report and its data.
    #[arg(long, default_value = "out/quickstart")]
    pub out: PathBuf,
    /// A small run for a look: fewer labels, fewer candidates.
    #[arg(long)]
    pub quick: bool,
}

/// Experiments; one that was stopped goes on where it was when it is run again.
///
/// `quickstart`: the story over several seeds. `strategies`: every way of choosing actions, error of the latents
/// against real interactions. `latents`: policies from latents estimated on 10,000 random real trajectories beside
/// every baseline, learning on in the real world. The name of a family (`bowling`, say): jump start of every strategy
/// over 10 rounds of 50 interactions. `harder`: real worlds with wind, quadratic drag, a sticky patch, another engine.
/// `policies`: trained at the point, over a posterior's draws, and tuned on what was measured, of 20 interactions with 5 mm of noise.
/// `grounding`: 5 and 20 interactions spent one way or another, what each estimator
/// makes of them, and what plans under it are worth.
#[derive(clap::Args)]
pub struct ExperimentArgs {
    /// quickstart, strategies, latents, harder, policies, grounding or the name of a family.
    pub name: String,
    /// A family (`iplw tasks` lists them).
    #[arg(long, default_value = DEFAULT_FAMILY)]
    pub task: String,
    /// Number of seeds, the first of the experiment's own; the experiment's number if not given.
    #[arg(long)]
    pub seeds: Option<u64>,
    /// Learning trials for each estimate (`latents`, `harder`, `policies`, a family's); 3 if not given.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub trials: Option<u64>,
    /// Rounds after which policies are trained, `1,3` (a family's), and the last; all if not given.
    #[arg(long, value_delimiter = ',')]
    pub rounds: Option<Vec<usize>>,
    /// Batches that policies are trained for in simulation (`latents`, `harder`, `policies`, a family's); the family's number if
    /// not given.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub batches: Option<u64>,
    /// Of `harder`: some of its real worlds, `wind,quadratic_drag,sticky_patch,other_engine`; all if not given.
    #[arg(long, value_delimiter = ',')]
    pub worlds: Option<Vec<String>>,
    /// Of `strategies`: the hidden worlds, damped, no-drag or both.
    #[arg(long, default_value = "both")]
    pub hidden: String,
    /// Of `grounding`: ways to spend interactions, probing (what tells most of the latents), success (what tells most of whether plans
    /// work), acting (the best planned attempt) or a strategy; `random,informative,probing,success,acting` if not given.
    #[arg(long, value_delimiter = ',')]
    pub ways: Option<Vec<String>>,
    /// Of `grounding`: which estimators read the trials, posterior (draws by sequential Monte Carlo), galileo (by Markov chains), iplw (the
    /// point of the cross-entropy method, refined) or tunenet (a point by learned steps); posterior if not given. A point goes with ways that
    /// do not ask how sure it is, random or acting.
    #[arg(long, value_delimiter = ',')]
    pub estimators: Option<Vec<String>>,
    /// Of `grounding`: the hidden world, over the family's own: `damping=0.8,density=..,friction=..,restitution=..,engine=..`.
    #[arg(long)]
    pub real: Option<String>,
    /// Of `grounding`: effect of the hidden world, `name:parameter=value,...` (see `iplw effects`); may be repeated. None: the family's
    /// own.
    #[arg(long = "effect", value_name = "EFFECT")]
    pub effects: Vec<String>,
    /// Of `grounding`: effects whose parameters are to be known beside the latents, joined by +, or none; linear_drag if not given.
    #[arg(long)]
    pub set: Option<String>,
    /// Directory for the report and its data.
    #[arg(long)]
    pub out: PathBuf,
    /// A small run for a look.
    #[arg(long)]
    pub quick: bool,
}

impl ExperimentArgs {
    /// As many seeds as were asked for, an experiment's own first; its own if no number was.
    pub fn chosen_seeds(&self, own: &[u64]) -> Vec<u64> {
        let wanted = self.seeds.map_or(own.len(), |n| n as usize);
        (0..wanted).map(|i| own.get(i).copied().unwrap_or(2000 + i as u64)).collect()
    }
}
