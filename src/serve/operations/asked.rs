//! Ask and tell: proposals to carry out on a real world of the client's, and what was measured there.
//!
//! Everything told is in the store before it is acknowledged. Answers of the open round add up; when every
//! proposal has one (or could not be carried out, or the round is closed), the job is queued and fits it.

use std::collections::BTreeMap;

use super::measured::{observe_at, trajectory, usable};
use super::rounds::{Last, Rounds, asking, placed, refuse};
use super::text::text;
use crate::error::{Error, Result};
use crate::experiment::Proposal;
use crate::job::{self, Job};
use crate::reality::trials_from_csv;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Asked, Described, Id, Input, Keep, Operation, READ, get, post};
use crate::serve::problem::Answer;
use crate::serve::wire::{Object, ProposalOut, Proposals, TellIn, TellQuery, Told};
use crate::store::{JobState, Measured};

/// What an estimation that asks can be asked and told.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_proposals", "/v1/iplw/{id}/proposals", "workflow", READ)
            .about("What an estimation with `\"real\": \"ask_tell\"` wants carried out on the real world.")
            .refuses(&[(404, ""), (409, "It does not ask")])
            .does(proposals),
        post("tell_trials", "/v1/iplw/{id}/trials", "workflow", ACT)
            .about(
                "Takes what was measured, as JSON or as a trials file (`text/csv`, whose `trial` is the proposal's \
                 number; the\nother fields are then query parameters). Answers add up until every proposal of the \
                 round has one, has failed,\nor the round is closed. The same answer again changes nothing.",
            )
            .refuses(&[(404, ""), (409, "Answered differently before, or the round is over")])
            .makes(200, None, tell),
    ]
}

/// Answers, in either form.
enum Answers {
    Json(TellIn),
    Csv(String, TellQuery),
}

impl Input for Answers {
    fn describe(to: &mut Described) {
        to.query::<String>("failed", "With CSV: numbers of proposals that could not be carried out, `3,4`");
        to.query::<u64>("round", "With CSV: number of the round that is meant");
        to.query::<bool>("close", "With CSV: ends the round");
        to.query::<bool>("replace", "With CSV: answers take the place of different ones");
        to.body::<TellIn>();
        to.body_of_media("text/csv");
    }

    fn read(from: &mut Asked) -> Answer<Answers> {
        if let Some(csv) = from.text("text/csv", "csv")? {
            return Ok(Answers::Csv(csv, TellQuery::from_query(&from.query()?)?));
        }
        from.without_query()?;
        from.body().map(Answers::Json)
    }
}

fn tell(app: &App, (Id(id), answers): (Id, Answers), keep: Keep<Told>) -> Result<Told> {
    let news = match answers {
        Answers::Json(body) => news_of_json(app, &id, body)?,
        Answers::Csv(csv, query) => news_of_csv(app, &id, &csv, &query)?,
    };
    take(app, &id, &news, keep)
}

/// What is to be carried out now.
fn proposals(app: &App, Id(id): Id) -> Result<Proposals> {
    let (job, tasks) = asking(app, &id)?;
    let waiting = job.row.state == JobState::Waiting;
    let last = Rounds::of(app, job.row.number)?.last;
    let round = last.as_ref().map_or(0, |l| l.number);
    let measured = last.as_ref().map(|l| app.store().measured(job.row.number, l.first())).transpose()?;
    let measured = measured.unwrap_or_default();
    let asked = last.filter(|l| l.open && waiting).map(|l| l.asked);
    let (open, reasons) = asked.map_or_else(Default::default, |a| (a.proposals, a.choice.reasons));
    let out = |(i, p): (usize, Proposal)| {
        let scene = placed(&tasks, &p)?;
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

fn news_of_json(app: &App, id: &str, body: TellIn) -> Result<News> {
    let (job, tasks) = asking(app, id)?;
    let rounds = Rounds::of(app, job.row.number)?;
    let mut news = News { round: body.round, close: body.close, replace: body.replace, ..News::default() };
    for (i, Object(trial)) in body.trials.into_iter().flatten().enumerate() {
        let field = format!("trials[{i}]");
        let number = trial.proposal;
        let proposal = rounds.find(app, job.row.number, number, &format!("{field}.proposal"))?;
        let observed = trajectory(trial, &placed(&tasks, &proposal)?, &field)?;
        news.add(number, Some(text(&observed)?), &format!("{field}.proposal"))?;
    }
    for (i, number) in body.failed.into_iter().flatten().enumerate() {
        let field = format!("failed[{i}]");
        rounds.find(app, job.row.number, number, &field)?;
        news.add(number, None, &field)?;
    }
    Ok(news)
}

/// Of a trials file; `trial` is the number of the proposal.
fn news_of_csv(app: &App, id: &str, csv: &str, query: &TellQuery) -> Result<News> {
    let (job, tasks) = asking(app, id)?;
    let rounds = Rounds::of(app, job.row.number)?;
    let mut news = News { round: query.round, close: query.close, replace: query.replace, ..News::default() };
    // The tasks of a family have the same bodies, and more is not read from the scene.
    for trial in trials_from_csv(csv, &tasks[0].scene).map_err(|e| e.at("body"))? {
        let number = trial
            .name
            .parse()
            .map_err(|_| Error::input("trial", format!("{:?}", trial.name), "the number of a proposal"))?;
        rounds.find(app, job.row.number, number, "trial")?;
        usable(&trial.observed, &format!("trial {number}: t"))?;
        news.add(number, Some(text(&trial.observed)?), "trial")?;
    }
    for number in &query.failed {
        rounds.find(app, job.row.number, *number, "failed")?;
        news.add(*number, None, "failed")?;
    }
    Ok(news)
}

/// Queues those jobs whose answers were all there when an earlier server ended.
pub fn catch_up(app: &App) -> Result<()> {
    for row in app.store().unfinished()?.iter().filter(|r| r.state == JobState::Waiting) {
        if let Some(last) = Rounds::of(app, row.number)?.last {
            let measured = app.store().measured(row.number, last.first())?.len() as u64;
            app.jobs().answered(&job::id(row.number), measured, last.asked.proposals.len() as u64)?;
        }
    }
    Ok(())
}

/// What a client tells, checked as far as it can be without knowing what was told before.
#[derive(Default)]
struct News {
    round: Option<u64>,
    outcomes: Measured,
    close: bool,
    replace: bool,
}

/// Takes news in, all of it or none.
fn take(app: &App, id: &str, news: &News, keep: Keep<Told>) -> Result<Told> {
    let _alone = app.telling();
    let job = app.jobs().get(id)?;
    let number = job.row.number;
    let last =
        Rounds::of(app, number)?.last.ok_or_else(|| refuse("nothing is proposed yet; ask for proposals"))?;
    let before = app.store().measured(number, 0)?;
    let open = last.open && job.row.state == JobState::Waiting;
    let mut fresh = news.fresh(&last, &before, &job, open)?;
    if news.close && news.means(&last) {
        if !open && news.outcomes.is_empty() {
            return Err(refuse(closed(&job)));
        }
        if open {
            for p in &last.asked.proposals {
                if !before.contains_key(&p.number) && !news.outcomes.contains_key(&p.number) {
                    fresh.insert(p.number, None);
                }
            }
        }
    }
    let of_round = before.iter().chain(&fresh).filter(|(n, _)| **n >= last.first());
    let told: BTreeMap<u64, bool> = of_round.map(|(n, outcome)| (*n, outcome.is_some())).collect();
    let (asked, known) = (last.asked.proposals.len() as u64, told.len() as u64);
    let answered = told.values().filter(|measured| **measured).count() as u64;
    let complete = open && known == asked;
    let out = Told {
        round: last.number,
        answered,
        failed: known - answered,
        open: asked - known,
        state: if complete { JobState::Queued.name() } else { job.row.state.name() },
    };
    app.store().put_measured(number, &fresh, None, keep(&out).as_ref())?;
    if open {
        app.jobs().answered(id, known, asked)?;
    }
    Ok(out)
}

impl News {
    fn add(&mut self, number: u64, outcome: Option<String>, field: &str) -> Result<()> {
        match self.outcomes.insert(number, outcome) {
            None => Ok(()),
            Some(_) => Err(Error::input(field, number, "each proposal once in a request")),
        }
    }

    /// What was not told before; errors if anything may not be told now.
    fn fresh(&self, last: &Last, before: &Measured, job: &Job, open: bool) -> Result<Measured> {
        if let Some(round) = self.round.filter(|round| *round > last.number) {
            let allowed = format!("the open round, {}, or one before", last.number);
            return Err(Error::input("round", round, allowed));
        }
        let mut fresh = Measured::new();
        for (n, outcome) in &self.outcomes {
            match before.get(n) {
                Some(kept) if kept == outcome => {}
                _ if *n < last.first() => {
                    return Err(refuse(format!(
                        "proposal {n} is of a round that is fitted; what was told of it stands"
                    )));
                }
                _ if !open => return Err(refuse(closed(job))),
                Some(_) if !self.replace => {
                    let how = "send \"replace\": true to tell it anew while the round is open";
                    return Err(refuse(format!("proposal {n} was told of differently before; {how}")));
                }
                _ => drop(fresh.insert(*n, outcome.clone())),
            }
        }
        let of_last = self.outcomes.keys().any(|n| *n >= last.first());
        match self.round {
            Some(round) if round < last.number && of_last => {
                let allowed = format!("{}, the round of these proposals", last.number);
                Err(Error::input("round", round, allowed))
            }
            _ => Ok(fresh),
        }
    }

    /// Whether the last round is meant. A repeated request of a round that is over closes nothing, least of all the
    /// round after it.
    fn means(&self, last: &Last) -> bool {
        match self.round {
            Some(round) => round == last.number,
            None => self.outcomes.is_empty() || self.outcomes.keys().any(|n| *n >= last.first()),
        }
    }
}

/// Why a round takes nothing now.
fn closed(job: &Job) -> String {
    match job.row.state {
        JobState::Queued | JobState::Running => {
            "the round is being fitted; ask for proposals until new ones stand".into()
        }
        state => format!("the job has {}; nothing more is asked", state.name()),
    }
}
