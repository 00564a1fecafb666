//! Saves the results of a run in a data directory for a server: estimation, diagnosis, training and evaluation as jobs, and the policies,
//! in the form of a server's own jobs.

use iplw::error::{Error, Result};
use iplw::experiment::quickstart::{QuickstartArtifacts, QuickstartReport, TrainedPolicy, TrainingRecord};
use iplw::experiment::{EstimateConfig, PendingRound, Round};
use iplw::job::{id, summarize};
use iplw::reality::trials_to_csv;
use iplw::report::diagnosis::DiagnosisDocument;
use iplw::store::{JobState, LogLevel, MeasuredOutcomes, PolicyRow, Store, unix_ms};
use serde::Serialize;
use serde_json::{Value, json};

/// Adds the first seed of a run to a data directory.
pub fn save(store: &Store, report: &QuickstartReport, artifacts: &QuickstartArtifacts) -> Result<()> {
    let shelf = RunArchive { store, family: &report.config.family, seed: report.config.seeds[0] };
    let estimation = shelf.estimation(report, artifacts)?;
    shelf.diagnosis(&estimation, artifacts)?;
    for schooled in &artifacts.policies {
        let policy = match &schooled.training {
            Some(lesson) => shelf.training(schooled, lesson)?,
            None => schooled.method.title().trim().into(),
        };
        shelf.evaluation(&policy, schooled, report)?;
    }
    store.flush_log()
}

struct RunArchive<'a> {
    store: &'a Store,
    family: &'a str,
    seed: u64,
}

impl RunArchive<'_> {
    fn estimation(&self, report: &QuickstartReport, artifacts: &QuickstartArtifacts) -> Result<String> {
        let setup = EstimateConfig { seed: self.seed, ..report.config.informative.clone() };
        let config = json!({
            "task": self.family, "strategy": setup.strategy, "rounds": setup.rounds, "actions": setup.actions,
            "samples": setup.cem.samples, "seed": self.seed,
        });
        let plan = json!({"task": self.family, "setup": value(&setup)?, "real": "asked", "budget": null});
        let rounds = |job: i64| -> Result<()> {
            artifacts.rounds.iter().enumerate().try_for_each(|(n, round)| self.round(job, n as u64, round))
        };
        self.job("iplw", config, plan, value(&report.estimates[0])?, &rounds)
    }

    fn round(&self, job: i64, number: u64, round: &Round) -> Result<()> {
        let Round { proposals, choice, rollouts, .. } = round.clone();
        self.store.open_round(job, number, &text(&PendingRound { proposals, choice, rollouts })?)?;
        let mut measured: MeasuredOutcomes = round.proposals.iter().map(|p| (p.number, None)).collect();
        for answer in &round.answers {
            measured.insert(answer.number, Some(text(&answer.observed)?));
        }
        self.store.put_measured(job, &measured, None, None)?;
        self.store.close_round(job, number, &text(&Round { answers: Vec::new(), ..round.clone() })?)
    }

    fn diagnosis(&self, estimation: &str, artifacts: &QuickstartArtifacts) -> Result<()> {
        let Some((scene, finding)) = &artifacts.diagnosed else { return Ok(()) };
        let trials = artifacts.trials.len();
        let config = json!({"job": estimation, "scene": scene.name, "trials": trials, "seed": self.seed});
        let csv = trials_to_csv(&artifacts.trials);
        let plan = json!({"scene": scene.to_json(), "trials": csv, "seed": self.seed});
        let result = value(&DiagnosisDocument::new(finding))?;
        self.job("diagnose", config, plan, result, &|_| Ok(())).map(drop)
    }

    /// Saves a training; returns the id of the policy.
    fn training(&self, schooled: &TrainedPolicy, lesson: &TrainingRecord) -> Result<String> {
        let Some(weights) = schooled.policy.to_safetensors() else {
            return Err(Error::Failed("the policy has no weights".into()));
        };
        let policy = format!("{}-{}", self.family, value(&schooled.method)?.as_str().unwrap_or_default());
        let name = lesson.training.name();
        let config = json!({
            "task": self.family, "training": name, "about": schooled.method.title().trim(), "seed": self.seed,
        });
        let result = json!({
            "policy": policy,
            "loss": lesson.loss,
            "examples": lesson.examples,
            "solving": lesson.solving,
            "training": value(&lesson.training)?,
            "labels": value(&lesson.labels)?,
            "config": value(&lesson.setup)?,
        });
        let job = self.job("train", config.clone(), json!({}), result, &|_| Ok(()))?;
        let row = PolicyRow {
            id: policy.clone(),
            task: self.family.into(),
            training: name.into(),
            about: schooled.policy.describe(),
            config,
            job: Some(job),
            version: env!("CARGO_PKG_VERSION").into(),
            bytes: weights.len() as u64,
            owner: None,
        };
        self.store.put_policy(&row, &weights, None)?;
        Ok(policy)
    }

    fn evaluation(
        &self,
        policy: &str,
        schooled: &TrainedPolicy,
        report: &QuickstartReport,
    ) -> Result<String> {
        let world = format!("the hidden {} world of the run", self.family);
        let config = json!({"policy": policy, "world": world, "split": "test", "seed": self.seed});
        let found = &schooled.evaluation;
        let result = json!({
            "auccess": found.auccess,
            "solved_within": found.curve.to_vec(),
            "world_kind": "real",
            "config": value(&report.config.evaluate)?,
        });
        self.job("evaluate", config, json!({}), result, &|_| Ok(()))
    }

    /// Saves a successful job and the data that `parts` adds; returns its id.
    fn job(
        &self,
        kind: &str,
        config: Value,
        plan: Value,
        result: Value,
        parts: &dyn Fn(i64) -> Result<()>,
    ) -> Result<String> {
        let mut row = self.store.add_job(kind, &config, &plan, self.seed, None, &|_| None)?;
        parts(row.number)?;
        (row.metadata.summary, row.metadata.ended) = (summarize(kind, &result), Some(unix_ms()));
        (row.state, row.result) = (JobState::Succeeded, Some(result));
        row.events += 1;
        self.store.update_job(&row)?;
        self.store.note_line(row.number, LogLevel::Info, "imported from `iplw run`");
        Ok(id(row.number))
    }
}

fn value(of: &impl Serialize) -> Result<Value> {
    serde_json::to_value(of).map_err(|e| Error::Failed(format!("cannot serialise a result: {e}")))
}

fn text(of: &impl Serialize) -> Result<String> {
    serde_json::to_string(of).map_err(|e| Error::Failed(format!("cannot serialise a result: {e}")))
}

#[cfg(test)]
mod tests {
    use iplw::experiment::quickstart::{QuickstartConfig, quickstart};
    use iplw::inference::{DiagnosisConfig, diagnose};
    use iplw::policy::TrainConfig;
    use iplw::progress::NoProgress;
    use iplw::reality::{standard, with_trial_settings};
    use iplw::serve::{ServeConfig, Server};
    use iplw::task::family;

    use super::*;

    /// A minimal run.
    fn story() -> (QuickstartReport, QuickstartArtifacts) {
        let family = family("basketball").unwrap();
        let mut config = QuickstartConfig::standard(family, vec![3], true);
        for estimate in [&mut config.paper, &mut config.informative] {
            (estimate.rounds, estimate.actions, estimate.candidates) = (1, 2, 20);
            (estimate.cem.samples, estimate.cem.elites) = (8, 2);
        }
        config.label.per_task = 4;
        config.train = TrainConfig { batches: 1, batch_size: 4, ..config.train };
        config.evaluate.candidates = 4;
        config.plan.actions = 4;
        let tasks: Vec<_> = family.tasks();
        let (report, mut artifacts) =
            quickstart(&tasks, &standard(family), &config, &|| 0.0, &NoProgress).unwrap();
        // Two trials cannot show a bad fit, so that nothing was diagnosed.
        let (scene, trials) = with_trial_settings(&tasks[0].scene, artifacts.trials.clone()).unwrap();
        let finding = diagnose(&scene, &trials, &DiagnosisConfig::standard(3), &NoProgress).unwrap();
        artifacts.diagnosed = Some((scene, finding));
        (report, artifacts)
    }

    #[test]
    fn a_server_lists_the_jobs_of_a_run() {
        let place = tempfile::tempdir().unwrap();
        let (report, artifacts) = story();
        save(&Store::open(place.path()).unwrap(), &report, &artifacts).unwrap();
        let http = "127.0.0.1:0".parse().unwrap();
        let config = ServeConfig { http, data_dir: Some(place.path().into()), ..ServeConfig::default() };
        let (told, address) = std::sync::mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let serving = std::thread::spawn(move || {
            tokio::runtime::Runtime::new().unwrap().block_on(async {
                let server = Server::bind(config).await.unwrap();
                told.send(server.address()).unwrap();
                server.run(async move { drop(stopped.await) }).await.unwrap();
            });
        });
        let url = format!("http://{}/v1", address.recv().unwrap());
        let get = |path: &str| -> Value {
            let answer = reqwest::blocking::get(format!("{url}{path}")).unwrap();
            assert_eq!(answer.status(), 200, "{path}");
            answer.json().unwrap()
        };
        let jobs = get("/jobs?state=succeeded");
        let kinds: Vec<&str> =
            jobs["jobs"].as_array().unwrap().iter().map(|j| j["kind"].as_str().unwrap()).collect();
        // Methods with the same physics share a policy, and both are listed.
        let trained = artifacts.policies.iter().filter(|p| p.training.is_some()).count();
        let of = |kind: &str| kinds.iter().filter(|k| **k == kind).count();
        assert_eq!(
            (of("iplw"), of("diagnose"), of("train"), of("evaluate")),
            (1, 1, trained, 8),
            "{kinds:?}"
        );
        assert_eq!(get("/jobs")["jobs"].as_array().unwrap().len(), kinds.len(), "nothing is left to do");
        let trials = get("/jobs/job-1/trials");
        assert_eq!(trials["trials"].as_array().unwrap().len(), artifacts.trials.len());
        assert_eq!(get("/jobs/job-1")["result"]["seed"], 3);
        assert!(get("/jobs/job-2")["result"]["extended_scene"]["bodies"].is_array());
        assert!(get("/jobs/job-1/log")["lines"][0]["text"].as_str().unwrap().contains("iplw run"));
        let policies = get("/policies");
        let ours =
            policies["policies"].as_array().unwrap().iter().find(|p| p["id"] == "basketball-iplw").unwrap();
        assert_eq!(ours["task"], "basketball");
        drop(stop);
        serving.join().unwrap();
    }
}
