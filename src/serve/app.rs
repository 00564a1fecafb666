//! The server as one who asks it sees it: what every operation is given.
//!
//! Worlds, jobs and policies are reached by [`App::worlds`], [`App::jobs`] and [`App::policies`] alone, which know who
//! asks: somebody else's are as good as none, so that no operation can forget to look.

use std::ops::Deref;
use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Semaphore;

use super::leave::Leave;
use super::problem::{Answer, Problem};
use super::shared::{Common, MOST_BUSY, Shared};
use crate::access::{Scope, Who};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::job::{Deleted, Job, New, Watcher};
use crate::session::{Listed, Registry, World, WorldConfig};
use crate::store::{Answered, JobList, PolicyRow, Store};

/// How long after its deadline a request is answered though its work has not ended.
const LATE: Duration = Duration::from_millis(50);

/// The server, for one request.
pub struct App {
    shared: Arc<Shared>,
    who: Who,
    leave: Arc<Leave>,
}

impl App {
    /// For a request of somebody who is known, which may go on for so long.
    pub fn new(shared: &Arc<Shared>, who: Who, span: Duration) -> App {
        App { shared: shared.clone(), who, leave: Leave::of(span) }
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

    /// Runs `work` off the async threads.
    pub async fn run<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        self.run_among(&self.shared.at_work, work).await
    }

    /// The same for work that waits for its client: it does not keep others from theirs.
    pub async fn run_streamed<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        self.run_among(&self.shared.streamed, work).await
    }

    async fn run_among<T: Send + 'static>(
        self: &Arc<Self>,
        places: &Arc<Semaphore>,
        work: impl FnOnce(&App) -> Answer<T> + Send + 'static,
    ) -> Answer<T> {
        if self.shared.busy.fetch_add(1, Ordering::SeqCst) >= MOST_BUSY {
            self.shared.busy.fetch_sub(1, Ordering::SeqCst);
            return Err(Problem::busy(MOST_BUSY));
        }
        let (app, place) = (self.clone(), Place(self.shared.clone()));
        // A client that hangs up drops what waits for its answer, and with it this.
        let waiting = self.leave.waiting();
        let deadline = tokio::time::Instant::from_std(self.leave.deadline());
        // Kept until the work is done, also if nobody waits for it any more. Never closed.
        let turn = tokio::time::timeout_at(deadline, places.clone().acquire_owned()).await;
        let Ok(turn) = turn else { return Err(self.leave.over().into()) };
        let work = move || {
            let _held = (turn, place);
            work(&app)
        };
        // Work looks at its deadline by itself; what waits for a lock or for the disk does not.
        let done = tokio::time::timeout_at(deadline + LATE, tokio::task::spawn_blocking(work)).await;
        let Ok(done) = done else { return Err(self.leave.over().into()) };
        waiting.answered();
        done.unwrap_or_else(|e| {
            tracing::error!("a request's work panicked: {e}");
            Err(Problem::defect())
        })
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
    pub fn list(&self, after: &str, limit: usize) -> Result<Vec<Listed>> {
        self.all().list(after, limit, self.0.who.sees(), self.0.now())
    }

    /// Every world, to be counted.
    pub fn everybodys(&self) -> Result<Vec<Listed>> {
        self.all().list("", usize::MAX, None, self.0.now())
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

    /// See [`crate::job::Runner::list`].
    pub fn list(&self, list: JobList, after: Option<i64>, limit: usize) -> Result<Vec<Job>> {
        self.0.shared.jobs.list(list, after, limit, self.0.who.sees())
    }

    /// See [`crate::job::Runner::submit`]; it is whose who asks.
    pub fn submit(&self, new: New, answered: &dyn Fn(Job) -> Option<Answered>) -> Result<Job> {
        self.0.shared.jobs.submit(new, self.0.who.owner(), answered)
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

/// One of [`MOST_BUSY`]; given back when dropped, after a panic too.
struct Place(Arc<Shared>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.busy.fetch_sub(1, Ordering::SeqCst);
    }
}
