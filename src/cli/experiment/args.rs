//! Options of `iplw run` and `iplw experiment`.

use std::path::PathBuf;

use iplw::task::DEFAULT_FAMILY;

/// Run the whole workflow on hidden worlds: explore, estimate, diagnose, train, plan, evaluate, report.
///
/// Measures worlds whose physics is hidden, estimates their latents, names what the simulation lacks, trains policies and plans in the
/// calibrated simulation, and compares them with baselines on unseen tasks. Three families by default: bowling, whose real world has a
/// drag that the simulation lacks, and two levels in which most of what works in an uncalibrated simulation fails. Writes a table,
/// report.html, and for each family CSV and JSON files, plots and the diagnosis.
#[derive(clap::Args)]
pub struct RunArgs {
    /// Family (see `iplw tasks`) or level; may be repeated.
    #[arg(long, default_values = [DEFAULT_FAMILY, "hurdle", "chute"])]
    pub task: Vec<String>,
    /// First random seed.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Number of seeds [default: 3; 1 with --quick]
    #[arg(long)]
    pub seeds: Option<usize>,
    /// Output directory.
    #[arg(long, default_value = "out/quickstart")]
    pub out: PathBuf,
    /// Small run: one seed, fewer labels and candidates.
    #[arg(long)]
    pub quick: bool,
}

/// Run an experiment with its baselines over several seeds.
///
/// Runs an experiment; an interrupted one resumes.
///
/// quickstart: the workflow of `iplw run` over several seeds.
/// strategies: error of the latents against real interactions, for every exploration strategy.
/// latents: policies from latents estimated on 10,000 random real trajectories, with all baselines, and further learning in the real world.
/// FAMILY (such as bowling): jump start of every strategy over 10 rounds of 50 interactions.
/// harder: real worlds with wind, quadratic drag, a sticky patch, or another engine.
/// policies: policies for a point estimate, for posterior samples, and tuned on measurements (20 interactions, 5 mm of noise).
/// grounding: 5 and 20 interactions by several acquisition methods and estimators, and the value of the resulting plans.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct ExperimentArgs {
    /// Experiment: quickstart, strategies, latents, harder, policies, grounding or the name of a family.
    pub name: String,
    /// Family (see `iplw tasks`).
    #[arg(long, default_value = DEFAULT_FAMILY)]
    pub task: String,
    /// Number of seeds [default: the experiment's]
    #[arg(long)]
    pub seeds: Option<u64>,
    /// Training runs per estimate, for latents, harder, policies and FAMILY; 0: estimates without policies [default: 3]
    #[arg(long, value_parser = clap::value_parser!(u64).range(0..=1000))]
    pub trials: Option<u64>,
    /// Rounds after which policies are trained, such as 1,3, for FAMILY [default: all]
    #[arg(long, value_delimiter = ',')]
    pub rounds: Option<Vec<usize>>,
    /// Updates in simulation, for latents, harder, policies and FAMILY [default: the family's]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub batches: Option<u64>,
    /// Exploration strategies, such as collisions,rolling, for FAMILY [default: all, and those beyond the paper]
    #[arg(long, value_delimiter = ',')]
    pub strategies: Option<Vec<String>>,
    /// Estimate linear drag along with the latents in every strategy, for FAMILY.
    #[arg(long)]
    pub with_drag: bool,
    /// Real worlds, for harder: wind,quadratic_drag,sticky_patch,other_engine [default: all]
    #[arg(long, value_delimiter = ',')]
    pub worlds: Option<Vec<String>>,
    /// Hidden worlds, for strategies: damped, no-drag or both.
    #[arg(long, default_value = "both")]
    pub hidden: String,
    /// Acquisition methods, for grounding [default: random,informative,probing,success,acting]
    ///
    /// probing: largest information gain about the latents; success: about the success of plans; acting: the best planned attempt; or an
    /// exploration strategy.
    #[arg(long, value_delimiter = ',')]
    pub acquisition: Option<Vec<String>>,
    /// Estimators, for grounding: posterior, galileo, iplw, tunenet [default: posterior]
    ///
    /// posterior: sequential Monte Carlo; galileo: Markov chain Monte Carlo; iplw: cross-entropy method with refinement (point estimate);
    /// tunenet: learned updates (point estimate). Point estimates need a method without uncertainty: random or acting.
    #[arg(long, value_delimiter = ',')]
    pub estimators: Option<Vec<String>>,
    /// Hidden world, for grounding and FAMILY: damping=0.8,density=..,friction=..,.. [default: the family's]
    #[arg(long)]
    pub real: Option<String>,
    /// Effect of the hidden world, for grounding: name:parameter=value,..; may be repeated [default: the family's]
    #[arg(long = "effect", value_name = "EFFECT")]
    pub effects: Vec<String>,
    /// Effects to estimate, for grounding, joined by +, or none [default: linear_drag]
    #[arg(long)]
    pub set: Option<String>,
    /// Output directory.
    #[arg(long)]
    pub out: PathBuf,
    /// Small run.
    #[arg(long)]
    pub quick: bool,
}

impl ExperimentArgs {
    /// The requested number of seeds, the experiment's own first.
    pub fn chosen_seeds(&self, own: &[u64]) -> Vec<u64> {
        let wanted = self.seeds.map_or(own.len(), |n| n as usize);
        (0..wanted).map(|i| own.get(i).copied().unwrap_or(2000 + i as u64)).collect()
    }
}
