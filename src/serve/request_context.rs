//! The server as seen by one request: the argument of every handler.
//!
//! Handlers reach worlds, jobs and policies only through [`RequestContext::worlds`], [`RequestContext::jobs`] and
//! [`RequestContext::policies`], which apply the caller's permissions: resources of other owners do not exist for it.

use std::ops::Deref;
use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use super::client::Client;
use super::client_limiter::LimiterPermit;
use super::concealment::{conceal_job, may_see_physics};
use super::deadline::RequestDeadline;
use super::execution_class::ExecutionClass;
use super::fair_semaphore::{FairPermit, FairSemaphore};
use super::problem::{HandlerResult, Problem};
use super::scheduler::MAX_ADMITTED_REQUESTS;
use super::state::{AppState, CommonState};
use crate::access::{Principal, Scope};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::job::{DeleteOutcome, Job, JobSpec, Watcher};
use crate::session::{ListedWorld, Registry, World, WorldConfig, WorldDescription, WorldKind, WorldList};
use crate::store::{JobList, LogRow, PolicyRow, Store, StoredResponse};
use crate::sync::lock;
use crate::thread_priority::lower;

/// Time after its deadline at which a request is answered although its work has not ended.
const DEADLINE_GRACE: Duration = Duration::from_millis(50);

/// The server, for one request.
pub struct RequestContext {
    shared: Arc<AppState>,
    principal: Principal,
    client: Client,
    deadline: Arc<RequestDeadline>,
}

impl RequestContext {
    /// For a request of an authenticated caller from a peer address, with a timeout.
    pub fn new(
        shared: &Arc<AppState>,
        principal: Principal,
        peer: &Client,
        timeout: Duration,
    ) -> RequestContext {
        let client = Client::identify(&principal, peer);
        RequestContext {
            shared: shared.clone(),
            principal,
            client,
            deadline: RequestDeadline::after(timeout),
        }
    }

    /// State shared by all requests.
    pub fn shared(&self) -> &Arc<AppState> {
        &self.shared
    }

    /// The authenticated caller.
    pub fn principal(&self) -> &Principal {
        &self.principal
    }

    /// The request's deadline.
    pub fn deadline(&self) -> &Arc<RequestDeadline> {
        &self.deadline
    }

    /// A permit for the bytes of the request's body.
    pub fn byte_permit(&self) -> LimiterPermit {
        self.shared.body_bytes.empty_permit(&self.client)
    }

    /// The deadline as the budget of a computation.
    pub fn budget(&self) -> &dyn Budget {
        &*self.deadline
    }

    /// Owner of the resources that the request creates.
    pub fn owner(&self) -> Option<&str> {
        self.principal.owner()
    }

    /// The owner whose resources the caller may see; all if `None`.
    pub fn visible_owner(&self) -> Option<&str> {
        self.principal.visible_owner()
    }

    /// A world as the caller may see it: latents and effects of a real world are its owner's.
    pub fn describe(&self, listed: &ListedWorld) -> WorldDescription {
        let description = listed.world.describe();
        let physics_visible =
            description.kind == WorldKind::Sim || may_see_physics(&self.principal, listed.owner.as_deref());
        if physics_visible { description } else { description.without_physics() }
    }

    /// Errors unless the request may create something: it was not given up, and this many further bytes may be stored for the
    /// caller.
    fn check_creation(&self, further: usize) -> Result<()> {
        self.budget().check()?;
        let limit = self.shared.limits().owner_bytes;
        let stored = self.shared.core.store.owner_usage(self.owner())?.bytes;
        if stored + further as u64 <= limit {
            return Ok(());
        }
        let advice = "delete policies, jobs or worlds you no longer need, or ask for a larger `owner_bytes`";
        Err(Error::Capacity { what: "bytes stored for one token", limit: limit as usize, advice })
    }

    /// Errors unless the caller has the scope.
    pub fn require_scope(&self, scope: Scope) -> Result<()> {
        if self.principal.scope >= scope {
            return Ok(());
        }
        let (has, needs) = (self.principal.scope.name(), scope.name());
        Err(Error::Denied {
            reason: format!("the token has scope {has}; this operation needs scope {needs}"),
        })
    }

    /// Worlds visible to the caller.
    pub fn worlds(&self) -> WorldAccess<'_> {
        WorldAccess(self)
    }

    /// Jobs visible to the caller.
    pub fn jobs(&self) -> JobAccess<'_> {
        JobAccess(self)
    }

    /// Policies visible to the caller.
    pub fn policies(&self) -> PolicyAccess<'_> {
        PolicyAccess(self)
    }

    /// The store, for shared surfaces and for measurements of a job that the caller may see.
    pub fn store(&self) -> &Store {
        &self.shared.core.store
    }

    /// Locked while results of proposed trials are submitted.
    pub fn lock_submissions(&self) -> MutexGuard<'_, ()> {
        lock(&self.shared.submission_lock)
    }

    /// Runs inline work on the async thread, once the client has a permit.
    pub async fn run_inline<T>(
        &self,
        work: impl FnOnce(&RequestContext) -> HandlerResult<T>,
    ) -> HandlerResult<T> {
        let permit = self.before_deadline(self.shared.scheduler.acquire_inline(&self.client)).await?;
        let done = work(self);
        drop(permit);
        done
    }

    /// Runs `work` on a blocking thread, once the client has a permit.
    pub async fn run<T: Send + 'static>(
        self: &Arc<Self>,
        weight: ExecutionClass,
        work: impl FnOnce(&RequestContext) -> HandlerResult<T> + Send + 'static,
    ) -> HandlerResult<T> {
        let scheduler = &self.shared.scheduler;
        let semaphore = if weight.computes() { &scheduler.compute } else { &scheduler.blocking };
        self.run_with_permits(&[semaphore], |app, _turns| work(app)).await
    }

    /// Runs work that streams its response. It drops its compute permit before it waits for the client, so that other
    /// computations can start.
    pub async fn run_streaming<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&RequestContext, FairPermit) -> HandlerResult<T> + Send + 'static,
    ) -> HandlerResult<T> {
        let scheduler = &self.shared.scheduler;
        self.run_with_permits(&[&scheduler.streaming, &scheduler.compute], move |app, mut permits| {
            let (Some(computing), Some(_streaming)) = (permits.pop(), permits.pop()) else {
                return Err(Problem::internal());
            };
            work(app, computing)
        })
        .await
    }

    /// Runs `work` with a permit of each semaphore.
    async fn run_with_permits<T: Send + 'static>(
        self: &Arc<Self>,
        semaphores: &[&Arc<FairSemaphore>],
        work: impl FnOnce(&RequestContext, Vec<FairPermit>) -> HandlerResult<T> + Send + 'static,
    ) -> HandlerResult<T> {
        let peer = self
            .shared
            .scheduler
            .admitted
            .acquire(&self.client)
            .map_err(|_| Problem::busy(MAX_ADMITTED_REQUESTS))?;
        // If the client disconnects, this future is dropped and the work is cancelled.
        let guard = self.deadline.cancel_on_drop();
        let mut permits = Vec::with_capacity(semaphores.len());
        for semaphore in semaphores {
            permits.push(self.before_deadline(semaphore.acquire(&self.client)).await?);
        }
        let app = self.clone();
        let work = move || {
            lower();
            // Held until the work ends, even after the client disconnected.
            let _admission = peer;
            work(&app, permits)
        };
        // Computations check the deadline themselves; waits for locks and the disk do not.
        let late = tokio::time::Instant::from_std(self.deadline.instant() + DEADLINE_GRACE);
        let done = tokio::time::timeout_at(late, tokio::task::spawn_blocking(work)).await;
        let Ok(done) = done else { return Err(self.deadline.exceeded().into()) };
        guard.disarm();
        done.unwrap_or_else(|e| {
            tracing::error!("a request's work panicked: {e}");
            Err(Problem::internal())
        })
    }

    /// Awaits a future until the deadline.
    async fn before_deadline<T>(&self, wait: impl Future<Output = T>) -> HandlerResult<T> {
        let deadline = tokio::time::Instant::from_std(self.deadline.instant());
        tokio::time::timeout_at(deadline, wait).await.map_err(|_| self.deadline.exceeded().into())
    }
}

impl Deref for RequestContext {
    type Target = CommonState;

    fn deref(&self) -> &CommonState {
        &self.shared.core
    }
}

/// Worlds visible to the caller: its own and the shared ones.
pub struct WorldAccess<'a>(&'a RequestContext);

impl WorldAccess<'_> {
    fn all(&self) -> &Registry {
        &self.0.shared.core.worlds
    }

    /// See [`Registry::of`].
    pub fn get(&self, id: &str) -> Result<ListedWorld> {
        self.all().of(id, self.0.principal.visible_owner(), self.0.now())
    }

    /// See [`Registry::get_many`].
    pub fn get_many(&self, ids: &[String]) -> Result<Vec<Arc<World>>> {
        self.all().get_many(ids, self.0.principal.visible_owner(), self.0.now())
    }

    /// See [`Registry::list`].
    pub fn list(&self, list: &WorldList, limit: usize) -> Result<Vec<ListedWorld>> {
        self.all().list(list, limit, self.0.principal.visible_owner(), self.0.now())
    }

    /// See [`Registry::listed_world`].
    pub fn listed_world(&self, id: &str) -> Result<ListedWorld> {
        self.all().listed_world(id, self.0.principal.visible_owner(), self.0.now())
    }

    /// Every world, for metrics.
    pub fn list_all(&self) -> Result<Vec<ListedWorld>> {
        self.all().list(&WorldList::ById { after: String::new() }, usize::MAX, None, self.0.now())
    }

    /// A new unique id.
    pub fn new_id(&self) -> String {
        self.0.shared.world_id()
    }

    /// See [`Registry::make`]; the caller becomes the owner.
    pub fn make(
        &self,
        id: &str,
        config: WorldConfig,
        answered: &dyn Fn(&World) -> Option<StoredResponse>,
    ) -> Result<Arc<World>> {
        self.0.check_creation(0)?;
        self.all().make(id, config, self.0.principal.owner(), self.0.now(), answered)
    }

    /// See [`Registry::make_many`]; the caller becomes the owner.
    pub fn make_many(
        &self,
        ids_and_seeds: &[(String, u64)],
        config: &WorldConfig,
        answered: &dyn Fn(&[ListedWorld]) -> Option<StoredResponse>,
    ) -> Result<Vec<ListedWorld>> {
        self.0.check_creation(0)?;
        let owner = self.0.principal.owner();
        self.all().make_many(ids_and_seeds, config, owner, self.0.now(), answered, self.0.budget())
    }

    /// See [`Registry::remove`]; shared worlds need scope `admin`.
    pub fn remove(&self, id: &str) -> Result<()> {
        self.removable(id)?;
        self.all().remove(id, self.0.principal.visible_owner())
    }

    /// See [`Registry::remove_many`]; shared worlds need scope `admin`.
    pub fn remove_many(&self, ids: &[String]) -> Result<()> {
        for (i, id) in ids.iter().enumerate() {
            self.removable(id).map_err(|e| e.for_entry(&format!("worlds[{i}]")))?;
        }
        self.all().remove_many(ids, self.0.principal.visible_owner())
    }

    fn removable(&self, id: &str) -> Result<()> {
        if self.all().is_resident(id) { self.0.require_scope(Scope::Admin) } else { Ok(()) }
    }
}

/// Jobs visible to the caller.
pub struct JobAccess<'a>(&'a RequestContext);

impl JobAccess<'_> {
    /// See [`crate::job::Runner::of`].
    pub fn get(&self, id: &str) -> Result<Job> {
        Ok(self.conceal(self.0.shared.jobs.of(id, self.0.principal.visible_owner())?))
    }

    fn conceal(&self, job: Job) -> Job {
        conceal_job(job, &self.0.principal)
    }

    /// See [`crate::job::Runner::kinds`].
    pub fn kinds(&self) -> Vec<&'static str> {
        self.0.shared.jobs.kinds()
    }

    /// See [`crate::job::Runner::list`].
    pub fn list(&self, list: &JobList, after: Option<i64>, limit: usize) -> Result<Vec<Job>> {
        let jobs = self.0.shared.jobs.list(list, after, limit, self.0.principal.visible_owner())?;
        Ok(jobs.into_iter().map(|job| self.conceal(job)).collect())
    }

    /// See [`crate::job::Runner::log`].
    pub fn log(&self, id: &str, after: u64, limit: usize) -> Result<Vec<LogRow>> {
        self.get(id)?;
        self.0.shared.jobs.log(id, after, limit)
    }

    /// See [`crate::job::Runner::submit`]; the caller becomes the owner.
    pub fn submit(&self, new: JobSpec, answered: &dyn Fn(Job) -> Option<StoredResponse>) -> Result<Job> {
        self.0.check_creation(0)?;
        self.0.shared.jobs.submit(new, self.0.principal.owner(), self.0.client.name(), answered)
    }

    /// See [`crate::job::Runner::report_results`].
    pub fn report_results(&self, id: &str, answered: u64, requested: u64) -> Result<Job> {
        self.get(id)?;
        self.0.shared.jobs.report_results(id, answered, requested)
    }

    /// See [`crate::job::Runner::annotate`].
    pub fn annotate(&self, id: &str, name: Option<&str>, note: Option<&str>) -> Result<Job> {
        let old = self.get(id)?.row.metadata;
        let added = |new: Option<&str>, old: &str| new.map_or(0, |new| new.len().saturating_sub(old.len()));
        let further = added(name, &old.name) + added(note, &old.note);
        if further > 0 {
            self.0.check_creation(further)?;
        }
        Ok(self.conceal(self.0.shared.jobs.annotate(id, name, note)?))
    }

    /// See [`crate::job::Runner::delete`].
    pub fn delete(&self, id: &str) -> Result<DeleteOutcome> {
        self.get(id)?;
        self.0.shared.jobs.delete(id)
    }

    /// See [`crate::job::Runner::watch`]; also the caller, by whom [`conceal_job`] judges the events.
    pub fn watch(&self, id: &str, after: u64) -> Result<(Watcher, Principal)> {
        self.get(id)?;
        Ok((self.0.shared.jobs.watch(id, after)?, self.0.principal.clone()))
    }
}

/// Policies visible to the caller.
pub struct PolicyAccess<'a>(&'a RequestContext);

impl PolicyAccess<'_> {
    fn all(&self) -> &Store {
        &self.0.shared.core.store
    }

    /// The policy with this id, if visible.
    pub fn get(&self, id: &str) -> Result<Option<PolicyRow>> {
        let is_visible = |row: &PolicyRow| {
            self.0.principal.visible_owner().is_none_or(|owner| row.owner.as_deref() == Some(owner))
        };
        Ok(self.all().policy(id)?.filter(is_visible))
    }

    /// Its weights.
    pub fn weights(&self, id: &str) -> Result<Option<Vec<u8>>> {
        self.get(id)?.map_or(Ok(None), |_| self.all().weights(id))
    }

    /// See [`Store::policies`].
    pub fn list(&self, after: i64, limit: usize) -> Result<Vec<(i64, PolicyRow)>> {
        self.all().policies(after, limit, self.0.principal.visible_owner())
    }

    /// See [`Store::put_policy`]; the caller becomes the owner of a new one.
    pub fn put(&self, row: PolicyRow, weights: &[u8]) -> Result<(PolicyRow, bool)> {
        self.0.check_creation(weights.len())?;
        let row = PolicyRow { owner: self.0.principal.owner().map(String::from), ..row };
        let new = self.all().put_policy(&row, weights, self.0.principal.visible_owner())?;
        Ok((row, new))
    }

    /// See [`Store::remove_policy`].
    pub fn remove(&self, id: &str) -> Result<bool> {
        self.get(id)?.map_or(Ok(false), |_| self.all().remove_policy(id))
    }
}

/// An idempotency key in use; released when dropped.
pub struct KeyGuard<'a> {
    app: &'a RequestContext,
    key: String,
}

impl RequestContext {
    /// The key as stored: keys are separate for each token.
    pub fn scoped_key(&self, key: &str) -> String {
        // Neither token names nor keys contain spaces.
        self.principal.owner().map_or_else(|| key.into(), |owner| format!("{owner} {key}"))
    }

    /// Claims a stored key; `None` while another request with the same key is in progress.
    pub fn claim_key(&self, key: &str) -> Option<KeyGuard<'_>> {
        let new = lock(&self.shared.keys_in_progress).insert(key.into());
        new.then(|| KeyGuard { app: self, key: key.into() })
    }
}

impl Drop for KeyGuard<'_> {
    fn drop(&mut self) {
        lock(&self.app.shared.keys_in_progress).remove(&self.key);
    }
}
