//! The server as one who asks it sees it: what every operation is given.
//!
//! Worlds, jobs and policies are reached by [`App::worlds`], [`App::jobs`] and [`App::policies`] alone, which know who
//! asks: somebody else's are as good as none, so that no operation can forget to look.

use std::ops::Deref;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::Duration;

use super::client::Client;
use super::fair::MOST_TAKEN;
use super::gate::{Gate, Turn};
use super::leave::Leave;
use super::problem::{Answer, Problem};
use super::shared::{Common, Shared};
use super::weight::Weight;
use crate::access::{Scope, Who};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::job::{Deleted, Job, New, Watcher};
use crate::session::{Listed, Registry, World, WorldConfig, WorldList};
use crate::store::{Answered, JobList, LogRow, PolicyRow, Store};

/// How long after its deadline a request is answered though its work has not ended.
const LATE: Duration = Duration::from_millis(50);

/// The server, for one request.
pub struct App {
    shared: Arc<Shared>,
    who: Who,
    client: Client,
    leave: Arc<Leave>,
}

impl App {
    /// For a request of somebody who is known and asks from a place, which may go on for so long.
    pub fn new(shared: &Arc<Shared>, who: Who, place: &Client, span: Duration) -> App {
        let client = Client::of(&who, place);
        App { shared: shared.clone(), who, client, leave: Leave::of(span) }
    }

    /// What all requests share.
    pub fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// How long the request may go on.
    pub fn leave(&self) -> &Arc<Leave> {
        &self.leave
    }

    /// The same, for what does the work.
    pub fn budget(&self) -> &dyn Budget {
        &*self.leave
    }

    /// Whose what is made becomes.
    pub fn owner(&self) -> Option<&str> {
        self.who.owner()
    }

    /// Errors unless whoever asks may do what `scope` allows.
    pub fn needs(&self, scope: Scope) -> Result<()> {
        if self.who.scope >= scope {
            return Ok(());
        }
        let (has, needs) = (self.who.scope.name(), scope.name());
        Err(Error::Denied { reason: format!("the token may {has}; this needs one that may {needs}") })
    }

    /// The worlds that whoever asks sees.
    pub fn worlds(&self) -> Worlds<'_> {
        Worlds(self)
    }

    /// The jobs that whoever asks sees.
    pub fn jobs(&self) -> Jobs<'_> {
        Jobs(self)
    }

    /// The policies that whoever asks sees.
    pub fn policies(&self) -> Policies<'_> {
        Policies(self)
    }

    /// Surfaces, which all share, and what was measured for a job that whoever asks sees.
    pub fn store(&self) -> &Store {
        &self.shared.base.store
    }

    /// Held while answers to proposals are taken.
    pub fn telling(&self) -> MutexGuard<'_, ()> {
        self.shared.telling.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does light work where it is, when it is its client's turn.
    pub async fn run_light<T>(&self, work: impl FnOnce(&App) -> Answer<T>) -> Answer<T> {
        let turn = self.in_time(self.shared.fair.light(&self.client)).await?;
        let done = work(self);
        drop(turn);
        done
    }

    /// Runs `work` off the async threads, when it is its client's turn.
    pub async fn run<T: Send + 'static>(
        self: &Arc<Self>,
        weight: Weight,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        let fair = &self.shared.fair;
        let gate = if weight.computes() { &fair.computing } else { &fair.other };
        self.run_behind(&[gate], |app, _turns| work(app)).await
    }

    /// The same for work that waits for its client once it has let go of its turn at computing: it does not keep others
    /// from theirs.
    pub async fn run_streamed<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&App, Turn) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        let fair = &self.shared.fair;
        self.run_behind(&[&fair.streamed, &fair.computing], move |app, mut turns| {
            let (Some(computing), Some(_streaming)) = (turns.pop(), turns.pop()) else {
                return Err(Problem::defect());
            };
            work(app, computing)
        })
        .await
    }

    /// Runs `work` with a turn of each gate.
    async fn run_behind<T: Send + 'static>(
        self: &Arc<Self>,
        gates: &[&Arc<Gate>],
        work: impl FnOnce(&App, Vec<Turn>) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        let place = self.shared.fair.taken.enter(&self.client).map_err(|_| Problem::busy(MOST_TAKEN))?;
        // A client that hangs up drops what waits for its answer, and with it this.
        let waiting = self.leave.waiting();
        let mut turns = Vec::with_capacity(gates.len());
        for gate in gates {
            turns.push(self.in_time(gate.enter(&self.client)).await?);
        }
        let app = self.clone();
        let work = move || {
            // Kept until the work is done, also if nobody waits for it any more.
            let _place = place;
            work(&app, turns)
        };
        // Work looks at its deadline by itself; what waits for a lock or for the disk does not.
        let late = tokio::time::Instant::from_std(self.leave.deadline() + LATE);
        let done = tokio::time::timeout_at(late, tokio::task::spawn_blocking(work)).await;
        let Ok(done) = done else { return Err(self.leave.over().into()) };
        waiting.answered();
        done.unwrap_or_else(|e| {
            tracing::error!("a request's work panicked: {e}");
            Err(Problem::defect())
        })
    }

    /// What is waited for, if it comes before the deadline.
    async fn in_time<T>(&self, wait: impl Future<Output = T>) -> Answer<T> {
        let deadline = tokio::time::Instant::from_std(self.leave.deadline());
        tokio::time::timeout_at(deadline, wait).await.map_err(|_| self.leave.over().into())
    }
}

impl Deref for App {
    type Target = Common;

    fn deref(&self) -> &Common {
        &self.shared.base
    }
}

/// Worlds that are somebody's, and those that all share.
pub struct Worlds<'a>(&'a App);

impl Worlds<'_> {
    fn all(&self) -> &Registry {
        &self.0.shared.base.worlds
    }

    /// See [`Registry::of`].
    pub fn get(&self, id: &str) -> Result<Arc<World>> {
        self.all().of(id, self.0.who.sees(), self.0.now())
    }

    /// See [`Registry::get_many`].
    pub fn get_many(&self, ids: &[String]) -> Result<Vec<Arc<World>>> {
        self.all().get_many(ids, self.0.who.sees(), self.0.now())
    }

    /// See [`Registry::list`].
    pub fn list(&self, list: &WorldList, limit: usize) -> Result<Vec<Listed>> {
        self.all().list(list, limit, self.0.who.sees(), self.0.now())
    }

    /// See [`Registry::look`].
    pub fn look(&self, id: &str) -> Result<Listed> {
        self.all().look(id, self.0.who.sees(), self.0.now())
    }

    /// Every world, to be counted.
    pub fn everybodys(&self) -> Result<Vec<Listed>> {
        self.all().list(&WorldList::ById { after: String::new() }, usize::MAX, None, self.0.now())
    }

    /// An id that no other world has.
    pub fn fresh_id(&self) -> String {
        self.0.shared.world_id()
    }

    /// See [`Registry::make`]; it is whose who asks.
    pub fn make(
        &self,
        id: &str,
        config: WorldConfig,
        answered: &dyn Fn(&World) -> Option<Answered>,
    ) -> Result<Arc<World>> {
        self.all().make(id, config, self.0.who.owner(), self.0.now(), answered)
    }

    /// See [`Registry::make_many`]; they are whose who asks.
    pub fn make_many(
        &self,
        ids: &[String],
        config: &WorldConfig,
        seeds: &[u64],
        answered: &dyn Fn(&[Listed]) -> Option<Answered>,
    ) -> Result<Vec<Listed>> {
        self.all().make_many(ids, config, seeds, self.0.who.owner(), self.0.now(), answered)
    }

    /// See [`Registry::remove`]; what all share goes for `admin` alone.
    pub fn remove(&self, id: &str) -> Result<()> {
        self.removable(id)?;
        self.all().remove(id, self.0.who.sees())
    }

    /// See [`Registry::remove_many`]; the same.
    pub fn remove_many(&self, ids: &[String]) -> Result<()> {
        for (i, id) in ids.iter().enumerate() {
            self.removable(id).map_err(|e| e.of_entry(&format!("worlds[{i}]")))?;
        }
        self.all().remove_many(ids, self.0.who.sees())
    }

    fn removable(&self, id: &str) -> Result<()> {
        if self.all().is_resident(id) { self.0.needs(Scope::Admin) } else { Ok(()) }
    }
}

/// Jobs that are somebody's.
pub struct Jobs<'a>(&'a App);

impl Jobs<'_> {
    /// See [`crate::job::Runner::of`].
    pub fn get(&self, id: &str) -> Result<Job> {
        self.0.shared.jobs.of(id, self.0.who.sees())
    }

    /// See [`crate::job::Runner::kinds`].
    pub fn kinds(&self) -> Vec<&'static str> {
        self.0.shared.jobs.kinds()
    }

    /// See [`crate::job::Runner::list`].
    pub fn list(&self, list: &JobList, after: Option<i64>, limit: usize) -> Result<Vec<Job>> {
        self.0.shared.jobs.list(list, after, limit, self.0.who.sees())
    }

    /// See [`crate::job::Runner::log`].
    pub fn log(&self, id: &str, after: u64, limit: usize) -> Result<Vec<LogRow>> {
        self.get(id)?;
        self.0.shared.jobs.log(id, after, limit)
    }

    /// See [`crate::job::Runner::submit`]; it is whose who asks.
    pub fn submit(&self, new: New, answered: &dyn Fn(Job) -> Option<Answered>) -> Result<Job> {
        self.0.shared.jobs.submit(new, self.0.who.owner(), self.0.client.name(), answered)
    }

    /// See [`crate::job::Runner::answered`].
    pub fn answered(&self, id: &str, answered: u64, asked: u64) -> Result<Job> {
        self.get(id)?;
        self.0.shared.jobs.answered(id, answered, asked)
    }

    /// See [`crate::job::Runner::delete`].
    pub fn delete(&self, id: &str) -> Result<Deleted> {
        self.get(id)?;
        self.0.shared.jobs.delete(id)
    }

    /// See [`crate::job::Runner::watch`].
    pub fn watch(&self, id: &str, after: u64) -> Result<Watcher> {
        self.get(id)?;
        self.0.shared.jobs.watch(id, after)
    }
}

/// Policies that are somebody's.
pub struct Policies<'a>(&'a App);

impl Policies<'_> {
    fn all(&self) -> &Store {
        &self.0.shared.base.store
    }

    /// The one called `id`, if it is seen.
    pub fn get(&self, id: &str) -> Result<Option<PolicyRow>> {
        let seen =
            |row: &PolicyRow| self.0.who.sees().is_none_or(|owner| row.owner.as_deref() == Some(owner));
        Ok(self.all().policy(id)?.filter(seen))
    }

    /// Its weights.
    pub fn weights(&self, id: &str) -> Result<Option<Vec<u8>>> {
        self.get(id)?.map_or(Ok(None), |_| self.all().weights(id))
    }

    /// See [`Store::policies`].
    pub fn list(&self, after: i64, limit: usize) -> Result<Vec<(i64, PolicyRow)>> {
        self.all().policies(after, limit, self.0.who.sees())
    }

    /// See [`Store::put_policy`]; a new one is whose who asks.
    pub fn put(&self, row: PolicyRow, weights: &[u8]) -> Result<(PolicyRow, bool)> {
        let row = PolicyRow { owner: self.0.who.owner().map(String::from), ..row };
        let new = self.all().put_policy(&row, weights, self.0.who.sees())?;
        Ok((row, new))
    }

    /// See [`Store::remove_policy`].
    pub fn remove(&self, id: &str) -> Result<bool> {
        self.get(id)?.map_or(Ok(false), |_| self.all().remove_policy(id))
    }
}

/// A key that is being worked on; free again when dropped.
pub struct Held<'a> {
    app: &'a App,
    key: String,
}

impl App {
    /// A request's key as it is kept: everybody has keys of their own.
    pub fn own_key(&self, key: &str) -> String {
        // No name has a space, and no key.
        self.who.owner().map_or_else(|| key.into(), |owner| format!("{owner} {key}"))
    }

    /// Takes a key as it is kept, unless a request with the same one is being worked on.
    pub fn hold(&self, key: &str) -> Option<Held<'_>> {
        let new = self.shared.keys.lock().unwrap_or_else(PoisonError::into_inner).insert(key.into());
        new.then(|| Held { app: self, key: key.into() })
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.app.shared.keys.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.key);
    }
}
