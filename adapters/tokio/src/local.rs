//! The local computation: an async function, or a blocking one on threads of its own.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::Duration;
use std::{io, iter};

use futures_util::FutureExt;
use futures_util::future::BoxFuture;

use crate::Error;
use crate::panics::panicked;
use crate::run::{Arrival, Arrived};

/// How messages are computed locally (priority 0). An error or a panic is a failure (F4).
///
/// A computation that began is never aborted (F7), and each message taken on is computed, in order,
/// unless [`skip_answered`](Self::skip_answered) says otherwise.
pub struct Local<I, O> {
    /// How long a computation may take from when its message was taken in; none by default.
    ///
    /// Without it a message whose computation never ends stays open (A9).
    pub deadline: Option<Duration>,
    /// How many messages may wait for a computation to end, as many as the window by default. For a
    /// message beyond, local fails (F4), so that the clouds alone can answer it.
    pub waiting: Option<usize>,
    /// Whether a computation that has not begun is skipped once its message was answered. Off by
    /// default, since it may keep state.
    pub skip_answered: bool,
    pub(crate) at_once: usize,
    pub(crate) kind: Kind<I, O>,
}

pub(crate) enum Kind<I, O> {
    Future(Spawn<I, O>),
    Threads(Vec<Compute<I, O>>),
}

type Spawn<I, O> = Box<dyn FnMut(Arc<I>, u64) -> BoxFuture<'static, Result<O, Error>> + Send>;
type Compute<I, O> = Box<dyn FnMut(&I, u64) -> Result<O, Error> + Send>;

impl<I: Send + Sync + 'static, O: Send + 'static> Local<I, O> {
    /// An async function, one message at a time.
    #[must_use]
    pub fn future<Fut>(compute: impl FnMut(Arc<I>, u64) -> Fut + Send + 'static) -> Self
    where
        Fut: Future<Output = Result<O, Error>> + Send + 'static,
    {
        Self::futures(1, compute)
    }

    /// An async function, up to `at_once` (at least 1) messages at a time.
    #[must_use]
    pub fn futures<Fut>(
        at_once: usize,
        mut compute: impl FnMut(Arc<I>, u64) -> Fut + Send + 'static,
    ) -> Self
    where
        Fut: Future<Output = Result<O, Error>> + Send + 'static,
    {
        Self::new(at_once, Kind::Future(Box::new(move |message, t| compute(message, t).boxed())))
    }

    /// A blocking function on a thread of its own.
    #[must_use]
    pub fn blocking(compute: impl FnMut(&I, u64) -> Result<O, Error> + Send + 'static) -> Self {
        Self::new(1, Kind::Threads(vec![Box::new(compute)]))
    }

    /// A blocking function on each of `at_once` (at least 1) threads; `make` gives each its own,
    /// with its own state.
    ///
    /// A computation of 300 ms needs four of them to keep pace with ten messages a second.
    #[must_use]
    pub fn threads<F>(at_once: usize, make: impl FnMut() -> F) -> Self
    where
        F: FnMut(&I, u64) -> Result<O, Error> + Send + 'static,
    {
        let computes = iter::repeat_with(make).take(at_once.max(1));
        let computes = computes.map(|compute| Box::new(compute) as Compute<I, O>).collect();
        Self::new(at_once, Kind::Threads(computes))
    }

    fn new(at_once: usize, kind: Kind<I, O>) -> Self {
        Self { deadline: None, waiting: None, skip_answered: false, at_once: at_once.max(1), kind }
    }
}

/// Local at work.
pub(crate) struct Workers<I, O> {
    way: Way<I, O>,
    arrived: Arrived<O>,
}

enum Way<I, O> {
    Future(Spawn<I, O>),
    /// The threads end when this is dropped and their computations are done.
    Threads(mpsc::Sender<(Arc<I>, u64)>),
}

impl<I: Send + Sync + 'static, O: Send + 'static> Workers<I, O> {
    /// Starts what `kind` says; results go to `arrived`.
    ///
    /// # Errors
    /// If the system has no thread left.
    pub(crate) fn start(kind: Kind<I, O>, arrived: Arrived<O>) -> io::Result<Self> {
        let computes = match kind {
            Kind::Future(spawn) => return Ok(Self { way: Way::Future(spawn), arrived }),
            Kind::Threads(computes) => computes,
        };
        let (jobs, taken) = mpsc::channel::<(Arc<I>, u64)>();
        let taken = Arc::new(Mutex::new(taken));
        for mut compute in computes {
            let (taken, arrived) = (Arc::clone(&taken), arrived.clone());
            thread::Builder::new().name("fuseline-local".into()).spawn(move || {
                loop {
                    let job = taken.lock().unwrap_or_else(PoisonError::into_inner).recv();
                    let Ok((message, t)) = job else { return };
                    local_arrived(&arrived, t, guard(|| compute(&message, t)));
                }
            })?;
        }
        Ok(Self { way: Way::Threads(jobs), arrived })
    }

    /// Computes a message.
    pub(crate) fn compute(&mut self, message: Arc<I>, t: u64) {
        match &mut self.way {
            Way::Future(spawn) => match guard(|| Ok(spawn(message, t))) {
                Ok(computation) => {
                    let arrived = self.arrived.clone();
                    tokio::spawn(async move {
                        local_arrived(&arrived, t, guarded(computation).await);
                    });
                }
                Err(error) => local_arrived(&self.arrived, t, Err(error)),
            },
            Way::Threads(jobs) => {
                if jobs.send((message, t)).is_err() {
                    let error = "local's threads have ended".into();
                    local_arrived(&self.arrived, t, Err(error));
                }
            }
        }
    }
}

/// Nobody waits for it once the operator has ended.
fn local_arrived<O>(arrived: &Arrived<O>, timestamp: u64, result: Result<O, Error>) {
    drop(arrived.send(Arrival { priority: 0, timestamp, result }));
}

/// Turns a panic into an error.
fn guard<T>(compute: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(compute)).unwrap_or_else(|panic| Err(panicked(&*panic)))
}

/// Turns a panic into an error.
pub(crate) async fn guarded<T>(
    computation: impl Future<Output = Result<T, Error>>,
) -> Result<T, Error> {
    let ended = AssertUnwindSafe(computation).catch_unwind().await;
    ended.unwrap_or_else(|panic| Err(panicked(&*panic)))
}
