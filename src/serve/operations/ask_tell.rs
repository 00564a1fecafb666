//! Ask and tell: proposals for the client's own real world, and submission of what was measured there.
//!
//! Submissions are stored before they are acknowledged. They accumulate until every proposal of the round has a trial or has
//! failed, or the round is closed; then the job is queued to fit the round.

use std::collections::BTreeMap;

use super::json::to_json;
use super::measurements::{check_usable, observe_at, trajectory};
use super::rounds::{JobRounds, LastRound, ask_tell_job, conflict, placed_scene};
use crate::error::{Error, Result};
use crate::experiment::Proposal;
use crate::job::{self, Job};
use crate::json::JsonObject;
use crate::reality::trials_from_csv;
use crate::serve::operation::{
    ACT, Extractor, Operation, OperationDoc, OperationRequest, PathId, READ, RecordResponse, get, post,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{ProposalOut, Proposals, SubmissionQuery, SubmissionStatus, TrialsSubmission};
use crate::store::{JobState, MeasuredOutcomes};

/// Operations on ask-tell estimations.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_proposals", "/v1/iplw/{id}/proposals", "workflow", READ)
            .about("Lists the open proposals of an estimation with `\"real\": \"ask_tell\"`.")
            .errors(&[(404, ""), (409, "Not an ask-tell estimation")])
            .handler(proposals),
        post("submit_trials", "/v1/iplw/{id}/trials", "workflow", ACT)
            .about(
                "Submits measured trials, as JSON or as a trials file (`text/csv`, whose `trial` is the proposal's \
                 number; the\nother fields are then query parameters). Submissions accumulate until every proposal of the \
                 round has a trial or has failed,\nor the round is closed. Repeating a submission changes nothing.",
            )
            .errors(&[(404, ""), (409, "Submitted differently before, or the round is closed")])
            .create_handler(200, None, submit_trials),
    ]
}

/// A submission in either format.
enum SubmissionBody {
    Json(TrialsSubmission),
    Csv(String, SubmissionQuery),
}

impl Extractor for SubmissionBody {
    fn describe(to: &mut OperationDoc) {
        to.query::<String>("failed", "With CSV: numbers of proposals that could not be carried out, `3,4`");
        to.query::<u64>("round", "With CSV: number of the round");
        to.query::<bool>("close", "With CSV: ends the round");
        to.query::<bool>("replace", "With CSV: replaces earlier submissions");
        to.body::<TrialsSubmission>();
        to.body_of_media("text/csv");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<SubmissionBody> {
        if let Some(csv) = from.text_body("text/csv", "csv")? {
            return Ok(SubmissionBody::Csv(csv, SubmissionQuery::from_query(&from.query()?)?));
        }
        from.reject_query()?;
        from.body().map(SubmissionBody::Json)
    }
}

fn submit_trials(
    app: &RequestContext,
    (PathId(id), answers): (PathId, SubmissionBody),
    keep: RecordResponse<SubmissionStatus>,
) -> Result<SubmissionStatus> {
    let submission = match answers {
        SubmissionBody::Json(body) => submission_from_json(app, &id, body)?,
        SubmissionBody::Csv(csv, query) => submission_from_csv(app, &id, &csv, &query)?,
    };
    submit(app, &id, &submission, keep)
}

/// The open proposals.
fn proposals(app: &RequestContext, PathId(id): PathId) -> Result<Proposals> {
    let (job, tasks) = ask_tell_job(app, &id)?;
    let waiting = job.row.state == JobState::Waiting;
    let last = JobRounds::of(app, job.row.number)?.last;
    let round = last.as_ref().map_or(0, |l| l.number);
    let measured = last.as_ref().map(|l| app.store().measured(job.row.number, l.first())).transpose()?;
    let measured = measured.unwrap_or_default();
    let asked = last.filter(|l| l.open && waiting).map(|l| l.asked);
    let (open, reasons) = asked.map_or_else(Default::default, |a| (a.proposals, a.choice.reasons));
    let out = |(i, p): (usize, Proposal)| {
        let scene = placed_scene(&tasks, &p)?;
        Ok(ProposalOut {
            observe_at: observe_at(&scene),
            scene,
            answered: measured.contains_key(&p.number),
            reason: reasons.get(i).cloned(),
            number: p.number,
            task: p.task,
            action: p.action,
        })
    };
    Ok(Proposals {
        round,
        state: job.row.state.name(),
        proposals: open.into_iter().enumerate().map(out).collect::<Result<_>>()?,
    })
}

fn submission_from_json(app: &RequestContext, id: &str, body: TrialsSubmission) -> Result<Submission> {
    let (job, tasks) = ask_tell_job(app, id)?;
    let rounds = JobRounds::of(app, job.row.number)?;
    let mut submission =
        Submission { round: body.round, close: body.close, replace: body.replace, ..Submission::default() };
    for (i, JsonObject(trial)) in body.trials.into_iter().flatten().enumerate() {
        let field = format!("trials[{i}]");
        let number = trial.proposal;
        let proposal = rounds.find(app, job.row.number, number, &format!("{field}.proposal"))?;
        let observed = trajectory(trial, &placed_scene(&tasks, &proposal)?, &field)?;
        submission.add(number, Some(to_json(&observed)?), &format!("{field}.proposal"))?;
    }
    for (i, number) in body.failed.into_iter().flatten().enumerate() {
        let field = format!("failed[{i}]");
        rounds.find(app, job.row.number, number, &field)?;
        submission.add(number, None, &field)?;
    }
    Ok(submission)
}

/// Reads a trials file, in which `trial` is the number of the proposal.
fn submission_from_csv(
    app: &RequestContext,
    id: &str,
    csv: &str,
    query: &SubmissionQuery,
) -> Result<Submission> {
    let (job, tasks) = ask_tell_job(app, id)?;
    let rounds = JobRounds::of(app, job.row.number)?;
    let mut submission = Submission {
        round: query.round,
        close: query.close,
        replace: query.replace,
        ..Submission::default()
    };
    // Only the bodies are read from the scene, and they are the same for all tasks of a family.
    for trial in trials_from_csv(csv, &tasks[0].scene).map_err(|e| e.in_file("body"))? {
        let number = trial
            .name
            .parse()
            .map_err(|_| Error::input("trial", format!("{:?}", trial.name), "the number of a proposal"))?;
        rounds.find(app, job.row.number, number, "trial")?;
        check_usable(&trial.observed, &format!("trial {number}: t"))?;
        submission.add(number, Some(to_json(&trial.observed)?), "trial")?;
    }
    for number in &query.failed {
        rounds.find(app, job.row.number, *number, "failed")?;
        submission.add(*number, None, "failed")?;
    }
    Ok(submission)
}

/// Queues jobs whose round was complete when a previous server stopped.
pub fn resume_complete_rounds(app: &RequestContext) -> Result<()> {
    for row in app.store().unfinished()?.iter().filter(|r| r.state == JobState::Waiting) {
        if let Some(last) = JobRounds::of(app, row.number)?.last {
            let measured = app.store().measured(row.number, last.first())?.len() as u64;
            app.jobs().report_results(&job::id(row.number), measured, last.asked.proposals.len() as u64)?;
        }
    }
    Ok(())
}

/// A submission, validated independently of earlier ones.
#[derive(Default)]
struct Submission {
    round: Option<u64>,
    outcomes: MeasuredOutcomes,
    close: bool,
    replace: bool,
}

/// Accepts a submission as a whole or not at all.
fn submit(
    app: &RequestContext,
    id: &str,
    submission: &Submission,
    keep: RecordResponse<SubmissionStatus>,
) -> Result<SubmissionStatus> {
    let _alone = app.lock_submissions();
    let job = app.jobs().get(id)?;
    let number = job.row.number;
    let last = JobRounds::of(app, number)?
        .last
        .ok_or_else(|| conflict("there are no proposals yet; list the proposals first"))?;
    let before = app.store().measured(number, 0)?;
    let open = last.open && job.row.state == JobState::Waiting;
    let mut new_results = submission.new_results(&last, &before, &job, open)?;
    if submission.close && submission.targets(&last) {
        if !open && submission.outcomes.is_empty() {
            return Err(conflict(closed_reason(&job)));
        }
        if open {
            for p in &last.asked.proposals {
                if !before.contains_key(&p.number) && !submission.outcomes.contains_key(&p.number) {
                    new_results.insert(p.number, None);
                }
            }
        }
    }
    let of_round = before.iter().chain(&new_results).filter(|(n, _)| **n >= last.first());
    let told: BTreeMap<u64, bool> = of_round.map(|(n, outcome)| (*n, outcome.is_some())).collect();
    let (asked, known) = (last.asked.proposals.len() as u64, told.len() as u64);
    let answered = told.values().filter(|measured| **measured).count() as u64;
    let complete = open && known == asked;
    let out = SubmissionStatus {
        round: last.number,
        answered,
        failed: known - answered,
        open: asked - known,
        state: if complete { JobState::Queued.name() } else { job.row.state.name() },
    };
    app.store().put_measured(number, &new_results, None, keep(&out).as_ref())?;
    if open {
        app.jobs().report_results(id, known, asked)?;
    }
    Ok(out)
}

impl Submission {
    fn add(&mut self, number: u64, outcome: Option<String>, field: &str) -> Result<()> {
        match self.outcomes.insert(number, outcome) {
            None => Ok(()),
            Some(_) => Err(Error::input(field, number, "each proposal once in a request")),
        }
    }

    /// The results that were not submitted before; fails if any of them cannot be accepted now.
    fn new_results(
        &self,
        last: &LastRound,
        before: &MeasuredOutcomes,
        job: &Job,
        open: bool,
    ) -> Result<MeasuredOutcomes> {
        if let Some(round) = self.round.filter(|round| *round > last.number) {
            let allowed = format!("the open round, {}, or an earlier one", last.number);
            return Err(Error::input("round", round, allowed));
        }
        let mut new_results = MeasuredOutcomes::new();
        for (n, outcome) in &self.outcomes {
            match before.get(n) {
                Some(kept) if kept == outcome => {}
                _ if *n < last.first() => {
                    return Err(conflict(format!(
                        "proposal {n} belongs to a fitted round; its result cannot be changed"
                    )));
                }
                _ if !open => return Err(conflict(closed_reason(job))),
                Some(_) if !self.replace => {
                    let how = "send \"replace\": true to replace it while the round is open";
                    return Err(conflict(format!("proposal {n} was submitted differently before; {how}")));
                }
                _ => drop(new_results.insert(*n, outcome.clone())),
            }
        }
        let of_last = self.outcomes.keys().any(|n| *n >= last.first());
        match self.round {
            Some(round) if round < last.number && of_last => {
                let allowed = format!("{}, the round of these proposals", last.number);
                Err(Error::input("round", round, allowed))
            }
            _ => Ok(new_results),
        }
    }

    /// Whether the submission targets the last round. A repeated request for an earlier round must not close the next one.
    fn targets(&self, last: &LastRound) -> bool {
        match self.round {
            Some(round) => round == last.number,
            None => self.outcomes.is_empty() || self.outcomes.keys().any(|n| *n >= last.first()),
        }
    }
}

/// Why the job accepts no submissions now.
fn closed_reason(job: &Job) -> String {
    match job.row.state {
        JobState::Queued | JobState::Running => {
            "the round is being fitted; list the proposals again until there are new ones".into()
        }
        state => format!("the job has {}; it accepts no more trials", state.name()),
    }
}
