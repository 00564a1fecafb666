//! Ask and tell: proposals to carry out on a real world of the client's, and what was measured there.
//!
//! Everything told is in the store before it is acknowledged. Answers of the open round add up; when every
//! proposal has one (or could not be carried out, or the round is closed), the job is queued and fits it.

use std::collections::BTreeMap;
use std::sync::PoisonError;

use super::estimation::{self, Plan, Real};
use super::{Keep, text};
use crate::error::{Error, Result};
use crate::experiment::{Asked, Proposal};
use crate::job::{self, Job};
use crate::json::from_value;
use crate::reality::trials_from_csv;
use crate::serve::app::App;
use crate::serve::wire::{Object, ProposalOut, Proposals, TellIn, TellQuery, Told, TrialIn};
use crate::store::{JobState, Measured};
use crate::task::{Placement, Scene, Task};
use crate::trajectory::{Track, Trajectory};

/// What is to be carried out now.
pub fn proposals(app: &App, id: &str) -> Result<Proposals> {
    let (job, tasks) = asking(app, id)?;
    let waiting = job.row.state == JobState::Waiting;
    let last = Rounds::of(app, job.row.number)?.last;
    let round = last.as_ref().map_or(0, |l| l.number);
    let measured = last.as_ref().map(|l| app.store.measured(job.row.number, l.first())).transpose()?;
    let measured = measured.unwrap_or_default();
    let open = last.filter(|l| l.open && waiting).map_or(Vec::new(), |l| l.asked.proposals);
    let out = |p: Proposal| {
        let scene = placed(&tasks, &p)?;
        Ok(ProposalOut {
            observe_at: observe_at(&scene),
            scene,
            answered: measured.contains_key(&p.number),
            number: p.number,
            task: p.task,
            action: p.action,
        })
    };
    Ok(Proposals {
        round,
        state: job.row.state.name(),
        proposals: open.into_iter().map(out).collect::<Result<_>>()?,
    })
}

/// Takes answers as JSON.
pub fn tell(app: &App, id: &str, body: TellIn, keep: Keep<Told>) -> Result<Told> {
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
    take(app, id, news, keep)
}

/// Takes answers as a trials file; `trial` is the number of the proposal.
pub fn tell_csv(app: &App, id: &str, csv: &str, query: &TellQuery, keep: Keep<Told>) -> Result<Told> {
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
    take(app, id, news, keep)
}

/// Queues those jobs whose answers were all there when an earlier server ended.
pub fn catch_up(app: &App) -> Result<()> {
    for row in app.store.unfinished()?.iter().filter(|r| r.state == JobState::Waiting) {
        if let Some(last) = Rounds::of(app, row.number)?.last {
            let measured = app.store.measured(row.number, last.first())?.len() as u64;
            app.jobs.answered(&job::id(row.number), measured, last.asked.proposals.len() as u64)?;
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

/// The rounds of a job, as far as telling needs them.
struct Rounds {
    last: Option<Last>,
}

struct Last {
    number: u64,
    asked: Asked,
    open: bool,
}

/// Takes news in, all of it or none.
fn take(app: &App, id: &str, news: News, keep: Keep<Told>) -> Result<Told> {
    let _alone = app.telling.lock().unwrap_or_else(PoisonError::into_inner);
    let job = app.jobs.get(id)?;
    let number = job.row.number;
    let last =
        Rounds::of(app, number)?.last.ok_or_else(|| refuse("nothing is proposed yet; ask for proposals"))?;
    let before = app.store.measured(number, 0)?;
    let open = last.open && job.row.state == JobState::Waiting;
    if let Some(round) = news.round
        && round > last.number
    {
        return Err(Error::input("round", round, format!("the open round, {}, or one before", last.number)));
    }
    let of_open = |n: &u64| *n >= last.first();
    let mut fresh = Measured::new();
    for (n, outcome) in &news.outcomes {
        match before.get(n) {
            Some(kept) if kept == outcome => {}
            _ if !of_open(n) => {
                return Err(refuse(format!(
                    "proposal {n} is of a round that is fitted; what was told of it stands"
                )));
            }
            _ if !open => return Err(refuse(closed(&job))),
            Some(_) if !news.replace => {
                let how = "send \"replace\": true to tell it anew while the round is open";
                return Err(refuse(format!("proposal {n} was told of differently before; {how}")));
            }
            _ => drop(fresh.insert(*n, outcome.clone())),
        }
    }
    // A repeated request of a round that is over closes nothing, least of all the round after it.
    let meant = match news.round {
        Some(round) => round == last.number,
        None => news.outcomes.is_empty() || news.outcomes.keys().any(of_open),
    };
    if news.round.is_some_and(|r| r < last.number) && news.outcomes.keys().any(of_open) {
        let allowed = format!("{}, the round of these proposals", last.number);
        return Err(Error::input("round", news.round.unwrap_or_default(), allowed));
    }
    if news.close && meant {
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
    let told: BTreeMap<u64, bool> = before
        .iter()
        .chain(&fresh)
        .filter(|(n, _)| of_open(n))
        .map(|(n, outcome)| (*n, outcome.is_some()))
        .collect();
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
    app.store.put_measured(number, &fresh, None, keep(&out).as_ref())?;
    if open {
        app.jobs.answered(id, known, asked)?;
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
}

impl Rounds {
    fn of(app: &App, job: i64) -> Result<Rounds> {
        let last = app.store.last_round(job)?;
        let last = last.map(|row| {
            Ok::<_, Error>(Last {
                number: row.number,
                asked: estimation::asked(&row.asked)?,
                open: row.done.is_none(),
            })
        });
        Ok(Rounds { last: last.transpose()? })
    }

    /// The proposal with this number, of this round or one before.
    fn find(&self, app: &App, job: i64, number: u64, field: &str) -> Result<Proposal> {
        let Some(last) = &self.last else {
            return Err(refuse("nothing is proposed yet; ask for proposals"));
        };
        if number < last.first() {
            for row in app.store.rounds(job)? {
                let asked = estimation::asked(&row.asked)?;
                if let Some(p) = asked.proposals.into_iter().find(|p| p.number == number) {
                    return Ok(p);
                }
            }
        }
        last.asked.proposals.iter().find(|p| p.number == number).cloned().ok_or_else(|| {
            let (first, end) = (last.first(), last.first() + last.asked.proposals.len() as u64);
            let allowed = format!("the number of a proposal: {first} to {} are open", end.saturating_sub(1));
            Error::input(field, number, allowed)
        })
    }
}

impl Last {
    /// Number of its first proposal.
    fn first(&self) -> u64 {
        self.asked.proposals.first().map_or(0, |p| p.number)
    }
}

/// The job, which must be one that asks, and its tasks.
fn asking(app: &App, id: &str) -> Result<(Job, Vec<Task>)> {
    let job = app.jobs.get(id)?;
    let plan =
        (job.row.kind == estimation::KIND).then(|| from_value::<Plan>(job.row.plan.clone())).transpose()?;
    match plan {
        Some(plan) if plan.real == Real::Asked => {
            let tasks = app.catalogue.named(&plan.task)?;
            Ok((job, tasks.tasks.to_vec()))
        }
        _ => {
            Err(refuse(format!("{id} does not ask for measurements; start one with \"real\": \"ask_tell\"")))
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

fn refuse(reason: impl Into<String>) -> Error {
    Error::Refused { reason: reason.into() }
}

/// The scene in which a proposal is carried out.
fn placed(tasks: &[Task], proposal: &Proposal) -> Result<Scene> {
    let task = tasks.iter().find(|t| t.id == proposal.task);
    let task = task.ok_or_else(|| Error::Failed(format!("there is no task {} any more", proposal.task)))?;
    match task.place(&proposal.action_on(task)?) {
        Placement::Valid(scene) => Ok(*scene),
        Placement::Invalid(reason) => Err(Error::Failed(format!("a proposal cannot be placed: {reason}"))),
    }
}

/// When a simulation of the scene is observed, s: the start, every `observe_every` steps, the end.
fn observe_at(scene: &Scene) -> Vec<f64> {
    let every = scene.observe_every.max(1);
    let mut steps: Vec<u32> = (0..=scene.steps / every).map(|k| k * every).collect();
    if !scene.steps.is_multiple_of(every) {
        steps.push(scene.steps);
    }
    steps.into_iter().map(|k| f64::from(k) * scene.time_step).collect()
}

/// A trial as measured, with a track for every body of the scene.
fn trajectory(trial: TrialIn, scene: &Scene, field: &str) -> Result<Trajectory> {
    let n = trial.t.len();
    for (i, t) in trial.t.iter().enumerate() {
        let least = if i == 0 { 0.0 } else { trial.t[i - 1] };
        if !(t.is_finite() && *t <= MOST && (if i == 0 { *t >= 0.0 } else { *t > least })) {
            let allowed = if i == 0 {
                "a time from 0 s".into()
            } else {
                format!("a time after {least} s, up to {MOST}")
            };
            return Err(Error::input(format!("{field}.t[{i}]"), t, allowed));
        }
    }
    for name in trial.bodies.keys() {
        if !scene.bodies.iter().any(|b| b.name == *name) {
            let known: Vec<String> = scene.bodies.iter().map(|b| format!("{:?}", b.name)).collect();
            let allowed = format!("a body of the scene: {}", known.join(", "));
            return Err(Error::input(format!("{field}.bodies.{name}"), "unknown", allowed));
        }
    }
    let mut bodies = trial.bodies;
    let mut tracks = Vec::new();
    for body in &scene.bodies {
        let mut track = Track { name: body.name.clone(), ..Track::default() };
        let given = bodies.remove(&body.name).map(|Object(t)| t).unwrap_or_default();
        let columns = [
            ("x", given.x, &mut track.x),
            ("y", given.y, &mut track.y),
            ("angle", given.angle, &mut track.angle),
            ("vx", given.vx, &mut track.vx),
            ("vy", given.vy, &mut track.vy),
            ("omega", given.omega, &mut track.omega),
        ];
        for (name, values, column) in columns {
            let at = format!("{field}.bodies.{}.{name}", body.name);
            let Some(values) = values else {
                *column = vec![f64::NAN; n];
                continue;
            };
            if values.len() != n {
                return Err(Error::input(
                    at,
                    format!("{} values", values.len()),
                    format!("{n}, one for each time in t"),
                ));
            }
            for (i, value) in values.iter().enumerate() {
                if value.is_some_and(|v| !v.is_finite() || v.abs() > MOST) {
                    let allowed = format!("a number from -{MOST} to {MOST}, or null");
                    return Err(Error::input(format!("{at}[{i}]"), value.unwrap_or_default(), allowed));
                }
            }
            *column = values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
        }
        tracks.push(track);
    }
    let observed = Trajectory { times: trial.t, bodies: tracks, ..Trajectory::default() };
    usable(&observed, &format!("{field}.t"))?;
    Ok(observed)
}

/// Largest time, place, angle or speed that is taken for one.
const MOST: f64 = 1e6;
/// How late the first observation may be, s.
const LATE: f64 = 0.1;

/// Errors unless something was observed from the start on.
fn usable(observed: &Trajectory, field: &str) -> Result<()> {
    let allowed = format!("times from the moment the bodies were let go, the first from 0 to {LATE} s");
    match observed.times.first() {
        None => return Err(Error::input(field, "empty", allowed)),
        Some(first) if !(0.0..=LATE).contains(first) => return Err(Error::input(field, first, allowed)),
        Some(_) => {}
    }
    if crate::residual::observations(observed) == 0 {
        let field = field.trim_end_matches('t').trim_end_matches([' ', ':', '.']);
        return Err(Error::input(field, "without any position", "x and y of a body at one time at least"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn observation_times_are_those_of_a_rollout() {
        let tasks = crate::session::Catalogue::new().family("bowling").unwrap();
        let task = &tasks.tasks[0];
        let times = observe_at(&task.scene);
        assert_eq!((times.len(), times[0], times[1]), (68, 0.0, 60.0 * task.scene.time_step));
        assert_eq!(times[67], f64::from(task.scene.steps) * task.scene.time_step);
        let even = Scene { steps: 120, observe_every: 60, ..task.scene.clone() };
        assert_eq!(observe_at(&even).len(), 3);
    }
}
