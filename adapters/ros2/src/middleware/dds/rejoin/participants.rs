//! The participants that the node has in its domain of DDS, one after the other, and what it has
//! created in them.
//!
//! Every endpoint is created through a factory, which is kept: when the node rejoins,
//! [`rejoin`](super) calls all of them again for a second participant. So nothing may be created in
//! a participant by another way.

use std::future::ready;
use std::net::{IpAddr, Ipv4Addr};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::Duration;

use fuseline_engine::lock;
use futures_util::future::join_all;
use rustdds::dds::CreateResult;
use rustdds::{DomainParticipant, DomainParticipantBuilder, Publisher, QosPolicies, Subscriber};
use tokio::sync::{Notify, watch};
use tokio::task::{JoinSet, spawn_blocking};
use tokio::time::sleep;
use tracing::error;

use crate::error::NodeError;
use crate::middleware::dds::census::Census;

/// Creates what is to exist in each participant that the node has, one after the other.
#[derive(Clone)]
pub(crate) struct DomainHandle(Arc<Mutex<ParticipantState>>);

/// A participant, and what runs in it.
pub(crate) struct JoinedParticipant {
    /// The census of other publishers. It uses the participant, so it ends first.
    pub(crate) census: Census,
    pub(crate) participant: DomainParticipant,
    pub(crate) publisher: Publisher,
    pub(crate) subscriber: Subscriber,
    pub(crate) loss: Arc<Loss>,
    /// The tasks that are aborted when the participant is left.
    pub(crate) tasks: JoinSet<()>,
    /// The tasks that take what comes: each ends by itself, with nothing half taken, once `open` is
    /// dropped.
    pub(crate) readers: JoinSet<()>,
    open: watch::Sender<()>,
}

/// An endpoint that a factory created in a participant. It is used only after it has taken over.
pub(crate) struct NewEntity {
    is_matched: Box<dyn Fn() -> bool + Send>,
    met: Box<dyn Fn() -> Wait + Send>,
    take_over: Box<dyn FnOnce() -> Wait + Send>,
}

/// The endpoint in use in the current participant. It exists from the first takeover on, which
/// happens at once.
pub(crate) struct InUse<T>(RwLock<Option<T>>);

/// Waits for peers.
pub(crate) type Wait = Pin<Box<dyn Future<Output = ()> + Send>>;

/// The first participant after the second one has taken over, and what waits until each of its
/// endpoints is needed no more and then closes it.
pub(crate) struct FormerParticipant {
    joined: JoinedParticipant,
    drains: Vec<Wait>,
}

/// Asks once for another participant if a thread of this one's has ended.
pub(crate) struct Loss {
    is_reported: AtomicBool,
    rejoin: Arc<Notify>,
}

type Factory = Box<dyn FnMut(&mut JoinedParticipant) -> Result<NewEntity, NodeError> + Send>;

struct ParticipantState {
    domain: u16,
    localhost_only: bool,
    rejoin: Arc<Notify>,
    /// In the order of creation: later ones rely on earlier ones.
    factories: Vec<Factory>,
    current: JoinedParticipant,
}

impl DomainHandle {
    /// Joins with a first participant.
    pub(crate) fn join(
        domain: u16,
        localhost_only: bool,
        rejoin: Arc<Notify>,
    ) -> CreateResult<Self> {
        let current = JoinedParticipant::new(domain, localhost_only, Arc::clone(&rejoin))?;
        let factories = Vec::new();
        let state = ParticipantState { domain, localhost_only, rejoin, factories, current };
        Ok(Self(Arc::new(Mutex::new(state))))
    }

    /// Ends what the current participant has, readers and writers first.
    pub(crate) async fn leave(&self) {
        let (factories, mut tasks, mut readers) = {
            let ParticipantState { factories, current, .. } = &mut *self.locked();
            let [tasks, readers] = [&mut current.tasks, &mut current.readers].map(std::mem::take);
            (std::mem::take(factories), tasks, readers)
        };
        // They share the endpoints that they created.
        drop(factories);
        tasks.shutdown().await;
        readers.shutdown().await;
    }

    /// Creates something, now and again in each later participant.
    ///
    /// # Errors
    /// The factory's.
    pub(crate) fn create(
        &self,
        mut factory: impl FnMut(&mut JoinedParticipant) -> Result<NewEntity, NodeError> + Send + 'static,
    ) -> Result<(), NodeError> {
        let mut state = self.locked();
        let entity = factory(&mut state.current)?;
        // There was nothing before it.
        drop((entity.take_over)());
        state.factories.push(Box::new(factory));
        Ok(())
    }

    /// Joins with a second participant, and creates in it what there is in the current one.
    ///
    /// Blocks for some 20 ms.
    pub(crate) fn create_again(&self) -> Result<(JoinedParticipant, Vec<NewEntity>), NodeError> {
        let mut state = self.locked();
        let mut next =
            JoinedParticipant::new(state.domain, state.localhost_only, Arc::clone(&state.rejoin))?;
        let entities = state.factories.iter_mut().map(|factory| factory(&mut next));
        let entities = entities.collect::<Result<_, _>>()?;
        Ok((next, entities))
    }

    /// Returns `true` if a thread of the current participant has ended, so that it sends and
    /// receives nothing.
    pub(crate) fn is_lost(&self) -> bool {
        self.locked().current.is_lost()
    }

    /// Makes the second participant the current one. Returns the first one.
    pub(crate) fn take_over(
        &self,
        mut next: JoinedParticipant,
        mut entities: Vec<NewEntity>,
    ) -> Result<FormerParticipant, NodeError> {
        let mut state = self.locked();
        // The endpoints that were created meanwhile.
        for factory in &mut state.factories[entities.len()..] {
            entities.push(factory(&mut next)?);
        }
        let drains = entities.into_iter().map(|entity| (entity.take_over)()).collect();
        Ok(FormerParticipant { joined: std::mem::replace(&mut state.current, next), drains })
    }

    /// Changes are made whole, so even a poisoned lock holds a sound state.
    fn locked(&self) -> MutexGuard<'_, ParticipantState> {
        lock(&self.0)
    }
}

impl JoinedParticipant {
    fn new(domain: u16, localhost_only: bool, rejoin: Arc<Notify>) -> CreateResult<Self> {
        let mut builder = DomainParticipantBuilder::new(domain);
        if localhost_only {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder.build()?;
        let none = QosPolicies::qos_none();
        let loss = Arc::new(Loss { is_reported: AtomicBool::new(false), rejoin });
        Ok(Self {
            census: Census::begin(participant.clone(), Arc::clone(&loss)),
            loss,
            publisher: participant.create_publisher(&none)?,
            subscriber: participant.create_subscriber(&none)?,
            participant,
            tasks: JoinSet::new(),
            readers: JoinSet::new(),
            open: watch::Sender::new(()),
        })
    }

    /// For a task of `readers`: resolves when it is to end.
    pub(crate) fn closed(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut open = self.open.subscribe();
        async move { while open.changed().await.is_ok() {} }
    }

    /// The same, or when its endpoint alone is to end.
    pub(crate) fn closed_or(
        &self,
        closed: impl Future<Output = ()> + Send + 'static,
    ) -> impl Future<Output = ()> + Send + 'static {
        let all_closed = self.closed();
        async move {
            tokio::select! {
                () = all_closed => {}
                () = closed => {}
            }
        }
    }

    fn is_lost(&self) -> bool {
        self.loss.is_reported.load(Ordering::Relaxed)
    }

    /// Leaves the domain with this participant.
    pub(crate) async fn leave(self) {
        let Self {
            census, participant, publisher, subscriber, mut tasks, mut readers, open, ..
        } = self;
        drop(open);
        while readers.join_next().await.is_some() {}
        tasks.shutdown().await;
        // It waits for its threads.
        drop(spawn_blocking(move || drop((census, publisher, subscriber, participant))).await);
    }
}

impl FormerParticipant {
    /// Leaves the domain with it when peers have met the second one, but no sooner than after a
    /// while.
    pub(crate) async fn leave(self, overlap: Duration) {
        let Self { joined, drains } = self;
        if !joined.is_lost() {
            sleep(overlap).await;
            join_all(drains).await;
        }
        joined.leave().await;
    }
}

impl Loss {
    pub(crate) fn report(&self) {
        if !self.is_reported.swap(true, Ordering::Relaxed) {
            error!(
                "the process was stopped and continued (SIGSTOP, a debugger, a frozen container), which rustdds does not \
                 survive: joining the domain again; messages in between are lost"
            );
            self.rejoin.notify_one();
        }
    }
}

impl NewEntity {
    /// Makes an endpoint that takes over by `take_over`, which returns what it replaced, to be
    /// closed later.
    pub(crate) fn new<R>(take_over: impl FnOnce() -> R + Send + 'static) -> Self
    where
        R: Send + 'static,
    {
        Self::draining(|| {
            let replaced = take_over();
            async { drop(replaced) }
        })
    }

    /// Makes an endpoint that takes over by `take_over`, which returns a future. It ends when what
    /// was replaced may be closed.
    pub(crate) fn draining<F>(take_over: impl FnOnce() -> F + Send + 'static) -> Self
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let take_over = Box::new(|| -> Wait { Box::pin(take_over()) });
        Self { is_matched: Box::new(|| true), met: Box::new(|| Box::pin(ready(()))), take_over }
    }

    /// Makes the endpoint take over only once `is_matched`.
    pub(crate) fn once(self, is_matched: impl Fn() -> bool + Send + 'static) -> Self {
        Self { is_matched: Box::new(is_matched), ..self }
    }

    /// Sets `met`, whose future ends once the peers have met the endpoint.
    pub(crate) fn met_by<F>(self, met: impl Fn() -> F + Send + 'static) -> Self
    where
        F: Future<Output = ()> + Send + 'static,
    {
        Self { met: Box::new(move || -> Wait { Box::pin(met()) }), ..self }
    }

    /// Waits until its peers have met it.
    pub(crate) fn met(&self) -> Wait {
        (self.met)()
    }

    /// Returns `true` if it has met the peers of what it is to replace.
    pub(crate) fn is_matched(&self) -> bool {
        (self.is_matched)()
    }
}

impl<T> InUse<T> {
    /// Takes the next one in use, and returns the former one.
    pub(crate) fn replace(&self, next: T) -> Option<T> {
        self.0.write().unwrap_or_else(PoisonError::into_inner).replace(next)
    }

    /// `None` before there is one.
    pub(crate) fn with<A>(&self, access: impl FnOnce(&T) -> A) -> Option<A> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).as_ref().map(access)
    }
}

impl<T> Default for InUse<T> {
    fn default() -> Self {
        Self(RwLock::new(None))
    }
}
