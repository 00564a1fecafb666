//! Posteriors from trials of hidden worlds: draws cover the truth, and report model discrepancy.

use crate::{all_cases, cases};
use iplw::budget::Unlimited;
use iplw::estimate::ParameterSamples;
use iplw::estimate::sampler::mcmc::McmcConfig;
use iplw::estimate::sampler::smc::SmcConfig;
use iplw::experiment::random_trials;
use iplw::inference::posterior::{PosteriorConfig, PosteriorDocument, Sampler, TrialLikelihood, posterior};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, Trial, standard, with_trial_settings};
use iplw::task::scene::EffectTerm;
use iplw::task::{Scene, Split, family, split};

/// Bowling observed with 5 mm noise and without velocities; `damped`: with the paper's drag.
fn measured(count: usize, seed: u64, damped: bool) -> (Scene, Vec<Trial>) {
    let own = standard(family("bowling").unwrap());
    let drag =
        EffectTerm { name: "linear_drag".into(), parameters: [("c".to_string(), 0.223_143_551)].into() };
    let effects = if damped { vec![drag] } else { Vec::new() };
    let mut world = HiddenWorld::new(HiddenConfig { effects, noise: 0.005, seed, ..own }).unwrap();
    let tasks = split(&family("bowling").unwrap().fold(0), Split::Train);
    let trials = random_trials(&tasks, &mut world, count, seed, &NoProgress).unwrap();
    let (mut scene, trials) = with_trial_settings(&tasks[0].scene, trials).unwrap();
    scene.calibrate = vec!["friction".into(), "restitution".into()];
    (scene, trials)
}

fn config(sets: &[&[&str]], seed: u64) -> PosteriorConfig {
    let sets = sets.iter().map(|set| set.iter().map(|n| n.to_string()).collect()).collect();
    let sampler = Sampler::Smc(SmcConfig { particles: 64, ..SmcConfig::standard(seed) });
    PosteriorConfig { sets, sampler, ..PosteriorConfig::standard(seed) }
}

/// Posterior mean and standard deviation of a parameter.
fn known(document: &PosteriorDocument, name: &str) -> [f64; 2] {
    let found = document.parameters.iter().find(|p| p.name == name);
    let found = found.unwrap_or_else(|| panic!("no {name}"));
    [found.mean, found.sd]
}

/// The mean is within `share` of the truth and within five standard deviations, and the standard deviation is
/// small.
fn near([mean, sd]: [f64; 2], truth: f64, share: f64) {
    assert!((mean - truth).abs() < share * truth, "{mean} for {truth}");
    assert!((mean - truth).abs() < 5.0 * sd, "{mean} +- {sd} for {truth}");
    assert!(sd > 0.0 && sd < share * truth, "{sd}");
}

/// Recovers latents and drag, deterministically, and agrees with MCMC.
#[test]
fn draws_cover_hidden_parameters() {
    let (scene, trials) = measured(cases(8, 14), 71, true);
    let wanted = config(&[&["linear_drag"]], 3);
    let found = posterior(&scene, &trials, &wanted, &NoProgress).unwrap();
    let document = PosteriorDocument::new(&found, &wanted);
    near(known(&document, "linear_drag.c"), 0.223_143_551, 0.01);
    near(known(&document, "restitution"), 0.447_213_595, 0.01);
    assert_eq!(document.columns["restitution"].len(), 256);
    assert!(document.columns.values().flatten().all(|v| v.is_some_and(f64::is_finite)));
    let read: PosteriorDocument = serde_json::from_str(&serde_json::to_string(&document).unwrap()).unwrap();
    assert_eq!(read.columns, document.columns);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = pool.install(|| posterior(&scene, &trials, &wanted, &NoProgress)).unwrap();
    assert_eq!(again.sets[0].draws, found.sets[0].draws, "the same bits on one thread");
    let runs = &document.parameters[0].runs;
    let mean = runs.iter().flatten().sum::<f64>() / runs.len() as f64;
    assert!(runs.len() == 4 && (mean - document.parameters[0].mean).abs() < 1e-9 * mean, "{runs:?}");
    // An external sampler gets the density of these draws.
    let likelihood = TrialLikelihood::new(&scene, &trials, &wanted, &NoProgress).unwrap();
    assert_eq!(likelihood.names(), ["friction", "restitution", "linear_drag.c"]);
    let drawn = &found.sets[0].draws;
    assert_eq!(likelihood.log_likelihoods(&drawn.points, &Unlimited).unwrap(), drawn.log_likelihoods);
    assert_eq!(
        likelihood.log_likelihoods(&drawn.points[7..8], &Unlimited).unwrap(),
        drawn.log_likelihoods[7..8]
    );
    let starts = likelihood.initial_points(9, 5, &Unlimited).unwrap();
    assert!(starts.iter().all(|p| likelihood.log_prior(p).is_finite()));
    assert!(likelihood.log_likelihoods(&starts, &Unlimited).unwrap().iter().all(|l| l.is_finite()));
    let outside = vec![vec![-0.1, 0.4, 0.2], vec![0.7, 0.4]];
    assert_eq!(likelihood.log_likelihoods(&outside, &Unlimited).unwrap(), [f64::NEG_INFINITY; 2]);
    assert!(outside.iter().all(|p| likelihood.log_prior(p) == f64::NEG_INFINITY));
    if !all_cases() {
        return;
    }
    let chains = Sampler::Mcmc(McmcConfig { chains: 8, warm_up: 50, steps: 50, seed: 3 });
    let chained = PosteriorConfig { sampler: chains, ..wanted };
    let chained =
        PosteriorDocument::new(&posterior(&scene, &trials, &chained, &NoProgress).unwrap(), &chained);
    let ([a, sd], [b, _]) = (known(&document, "restitution"), known(&chained, "restitution"));
    assert!((a - b).abs() < 3.0 * sd, "{a} by SMC, {b} by MCMC, +- {sd}");
}

/// A model without drag reports a discrepancy, and its weight is negligible compared with one with drag.
#[test]
fn reports_model_discrepancy() {
    let (scene, trials) = measured(14, 72, true);
    let wanted = config(&[&[], &["linear_drag"]], 4);
    let found = posterior(&scene, &trials, &wanted, &NoProgress).unwrap();
    let [plain, dragged] = &found.sets[..] else { panic!("two sets") };
    assert!(dragged.weight > 0.99, "{}", dragged.weight);
    assert!(plain.fields[0].1 < 0.01, "probability of no discrepancy is {}", plain.fields[0].1);
    assert!(dragged.fields[0].1 > 0.5, "{:?}", dragged.fields);
    let document = PosteriorDocument::new(&found, &wanted);
    assert!(document.columns["linear_drag.c"].iter().flatten().count() > 250);
}

/// If the discrepancy field is sampled, latents are unbiased; without it restitution compensates for drag with
/// false confidence.
#[test]
fn sampled_discrepancy_removes_bias() {
    let (scene, trials) = measured(cases(8, 10), 72, true);
    let found = |follow: bool| {
        let wanted = PosteriorConfig { sample_discrepancy: follow, ..config(&[&[]], 4) };
        let found = posterior(&scene, &trials, &wanted, &NoProgress).unwrap();
        assert!(found.sets[0].set.is_empty(), "the field is not a named effect: {:?}", found.sets[0].set);
        let document = PosteriorDocument::new(&found, &wanted);
        let belief = ParameterSamples::from_value(serde_json::to_value(&document).unwrap()).unwrap();
        let carried: Vec<usize> = belief.draws().iter().map(|d| d.unnamed).collect();
        assert!(carried.iter().all(|n| *n > 0), "every draw has it: {carried:?}");
        (found, document)
    };
    let ((_, without), (followed, with)) = (found(false), found(true));
    let off = |document: &PosteriorDocument, name: &str, truth: f64| {
        let [mean, sd] = known(document, name);
        [(mean - truth).abs(), (mean - truth).abs() / sd]
    };
    let restitution = |document: &PosteriorDocument| off(document, "restitution", 0.447_213_595);
    let ([far, surely], [near, hardly]) = (restitution(&without), restitution(&with));
    assert!(near < 0.2 * far, "restitution is off by {near}, and by {far} without a sampled field");
    assert!(hardly < 3.0 && surely > 10.0, "{hardly} and {surely} standard deviations");
    let [_, friction] = off(&with, "friction", std::f64::consts::FRAC_1_SQRT_2);
    assert!(friction < 3.0, "{friction} standard deviations");
    let field = &with.sets[0].discrepancy;
    assert!(field.len() == 2 && field[0].probability == 0.0 && field[1].field.strength > 0.1, "{field:?}");
    let points = &followed.sets[0].draws.points;
    assert!(
        points.iter().all(|p| p.len() == 2 + 24),
        "a point has the field's coefficients after the parameters"
    );
}

#[test]
fn reports_unidentifiable_and_rejects_invalid() {
    let (scene, trials) = measured(6, 73, false);
    let scene = Scene { calibrate: vec!["density".into(), "restitution".into()], ..scene };
    let wanted = config(&[&[]], 5);
    let document =
        PosteriorDocument::new(&posterior(&scene, &trials, &wanted, &NoProgress).unwrap(), &wanted);
    let density = document.parameters.iter().find(|p| p.name == "density").unwrap();
    assert!(!density.identifiable && density.left > 0.8, "{density:?}");
    let refused = |scene: &Scene, trials: &[Trial], wanted: &PosteriorConfig, name: &str| {
        let error = posterior(scene, trials, wanted, &NoProgress).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
    };
    let nothing = Scene { calibrate: Vec::new(), ..scene.clone() };
    refused(&nothing, &trials, &wanted, "calibrate");
    refused(&scene, &trials[..2], &wanted, "trials");
    refused(&scene, &trials, &config(&[&["phlogiston"]], 0), "phlogiston");
    let two = TrialLikelihood::new(&scene, &trials, &config(&[&[], &["wind"]], 0), &NoProgress);
    assert!(two.err().unwrap().to_string().contains("sets"));
}
