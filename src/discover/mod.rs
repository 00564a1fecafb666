//! What the simulation gets wrong: measured trials in, the named cause, the extended model and its gain out.
//!
//! 1. Data, made ready by `prepare`. `window`: trials are cut into windows whose starts are nuisances; `smooth`: motion as any
//!    law could have it; `noise`: what that leaves; `phase`: which moment velocities seen are of; `trust`: what can be foreseen
//!    and is no outlier.
//! 2. Models. `path` and the engines simulate windows; `model`: residuals and their derivatives; latents are fitted with every
//!    candidate. `base`: the scene as it is, fitted; `steps`: what another engine's steps make of contacts.
//! 3. Scores. `launch`: what a model leaves of each launch, as a Gaussian of known components; `score`: its predictive
//!    density, told from the other launches; `fit`: a model fitted and scored, linear about how each launch is unlike the others (`modes`).
//! 4. Search. `library`: the effect registry as candidates; `search`: sets of up to three of them; `survey`: where starts are
//!    known the whole range of values is searched, since collisions leave no way downhill. `field`: something nobody named.
//! 5. `decide`: which of two models is better, the one place where it is decided; `reason`: what launches may differ by;
//!    `verdict`: what that amounts to.
//! 6. `advise` and `parting`: what would separate those that tie; `described`: what no set explains, as terms that can be
//!    simulated, a formula (`law`) or the field that launches share (`bumps`); `conclude`: the report, of `sizes`, of `gain` by
//!    `expected` and `leave_out`, and in `words`; `by_launch`: what each launch says; `unlike`: what launches differ by beside
//!    the model; `check`: whether it is as predicted; `band` and `paths`: how far off its path it may
//!    be seen; `picture`: the field of what is left; `extend`: the scene with what was found; `evidence`: what pictures show, `drawn`: as
//!    tables.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), model discrepancy as a Gaussian
//! process (Kennedy and O'Hagan 2001), mixed-effects models (Pinheiro and Bates 2000), pseudo-BMA+ (Yao et al. 2018).
//!
//! Differences from the sources: positions are never differentiated; the launch is what is left out, never the sample; the
//! discrepancy is drawn anew for every launch, and what launches share is a rival of its own (`field`).

mod advise;
mod band;
mod base;
mod bumps;
mod by_launch;
mod check;
mod columns;
mod components;
mod conclude;
mod config;
mod decide;
mod described;
pub mod drawn;
mod evidence;
mod expected;
mod extend;
mod field;
mod fit;
#[cfg(test)]
mod fixture;
mod gain;
mod gaussian;
mod launch;
mod law;
mod leave_out;
mod library;
mod model;
mod modes;
mod noise;
mod parting;
mod path;
mod paths;
mod phase;
mod picture;
pub mod posterior;
mod prepare;
mod reason;
pub mod report;
mod robust;
mod score;
mod search;
mod sizes;
mod smooth;
mod stats;
mod steps;
mod survey;
#[cfg(test)]
mod thrown;
mod trust;
mod unlike;
mod verdict;
mod window;
mod words;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::Engine;
use crate::world::latent::factor_index;
use conclude::{Given, conclude, insufficient};
pub use config::{Config, Finding};
pub use evidence::{Bounce, Evidence, EvidencePoint, Met, Push};
use expected::expected;
use fit::Fitter;
use model::{Data, Layout, State};
use prepare::{RUN, Ready, prepare};
pub use report::Diagnosis;
use window::Window;

/// Added to the reason of a verdict on such data.
const OTHER_STEPS: &str = " (what was measured moves in other time steps than the simulation: velocities were shifted to the \
                           simulation's moments, and contacts are allowed what such steps make of them)";

/// Diagnoses a scene from measured trials.
pub fn diagnose(
    scene: &Scene,
    trials: &[Trial],
    config: &Config,
    progress: &dyn Progress,
) -> Result<Finding> {
    scene.validate()?;
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    let ready = match prepare(scene, trials, config.engine, RUN)? {
        Ok(ready) => ready,
        Err(lack) => {
            let mut finding = insufficient(scene, trials, &lack.reason, config);
            let next = finding.diagnosis.next_experiment.iter_mut();
            next.for_each(|n| n.action = lack.action.into());
            return Ok(finding);
        }
    };
    let expected = expected(&ready.windows, &ready.sd, ready.kept.len(), &ready.noise);
    progress.report("fitting the base model", 0, 1)?;
    let Opened { mut data, layout, state, observed } =
        open(scene, trials, &ready, &ready.windows, &latents, (config.engine, config.seed))?;
    let Ready { kept, names, noise, sd, stepping, .. } = &ready;
    let seek = |data: &Data, layout: &Layout, state: State| -> Result<_> {
        let fitter = Fitter::new(data, noise);
        let base = fitter.refined(layout.clone(), state)?;
        let base = base.ok_or_else(|| Error::Failed("the base model could not be scored".into()))?;
        let hunt = search::Hunt::new(scene, &fitter, &latents, config.seed);
        let found = hunt.search(base, config.most_effects, progress)?;
        let judged = verdict::judge(&fitter, &found)?;
        Ok((found, judged))
    };
    let (mut found, mut judged) = seek(&data, &layout, state)?;
    if let Some(stepping) = *stepping {
        // What the other engine's steps make of contacts is known once it is known where things go.
        let best = judged.champion.map_or(&found.base, |c| &found.fits[c]);
        data.sd.clone_from(sd);
        steps::allow(&mut data, &observed, &best.layout, &best.state, stepping)?;
        let state = found.base.state;
        (found, judged) = seek(&data, &layout, state)?;
    }
    let given = Given { scene, trials, data: &data, kept, names, noise, expected: &expected };
    let mut finding = conclude(&given, found, &judged, config)?;
    if stepping.is_some() {
        finding.diagnosis.reason += OTHER_STEPS;
    }
    Ok(finding)
}

/// Trials' windows with the base model fitted to them.
struct Opened<'a> {
    data: Data<'a>,
    layout: Layout,
    state: State,
    /// What was seen, by trial kept.
    observed: Vec<&'a Trajectory>,
}

/// Fits the base model, the scene as it is with its `latents`, to windows of what was made ready.
fn open<'a>(
    scene: &Scene,
    trials: &'a [Trial],
    ready: &'a Ready,
    windows: &'a [Window],
    latents: &[usize],
    (engine, seed): (Engine, u64),
) -> Result<Opened<'a>> {
    let layout = Layout::new(latents, Vec::new(), ready.names.len());
    let start = base::start(scene, &layout, windows);
    let observed: Vec<&Trajectory> = ready.kept.iter().map(|i| &trials[*i].observed).collect();
    let sd = windows.iter().map(|w| ready.scale(w)).collect();
    let mut data = Data::new(windows, &ready.settings, sd, engine);
    if let Some(stepping) = ready.stepping {
        steps::allow(&mut data, &observed, &layout, &start, stepping)?;
    }
    let (state, _) = base::fit(scene, &mut data, &observed, &layout, start, seed)?;
    Ok(Opened { data, layout, state, observed })
}
