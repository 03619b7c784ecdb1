//! The local computation: an async function, or a blocking one on threads of its own.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::task::{Context, Poll};
use std::thread;
use std::time::Duration;
use std::{io, iter};

use fuseline_engine::{Overflow, StampedValue};
use futures_util::TryFutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use crate::Error;
use crate::drive::{Completion, Sent};
use crate::panics::panicked;

/// How messages are computed locally (priority 0). An error or a panic is a failure (F4).
///
/// A computation that has begun is never aborted (F7). Each message taken on is computed, in order, unless too many
/// [wait](Self::waiting) or [`skip_answered`](Self::skip_answered) says otherwise.
pub struct Local<I, O> {
    /// How long a computation may take, counted from when its message was taken in; none by default.
    ///
    /// Without it a message whose computation never ends stays open (A9).
    pub deadline: Option<Duration>,
    /// How many messages may wait for a computation; by default as many as the window. For one more,
    /// one is thrown out: local fails for it (F4), and only the clouds can answer it.
    pub waiting: Option<usize>,
    /// Which one is thrown out then; by default the oldest, since a fresh message is worth more (D17).
    pub overflow: Overflow,
    /// Whether a computation that has not begun is skipped once its message is answered. Off by
    /// default, since local may keep state.
    pub skip_answered: bool,
    pub(crate) at_once: usize,
    pub(crate) kind: LocalKind<I, O>,
}

pub(crate) enum LocalKind<I, O> {
    Future(Spawn<I, O>),
    Threads(Vec<Compute<I, O>>),
}

type Spawn<I, O> =
    Box<dyn FnMut(Arc<I>, u64) -> BoxFuture<'static, Result<StampedValue<O>, Error>> + Send>;
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
        Self::new(
            at_once,
            LocalKind::Future(Box::new(move |message, t| {
                Box::pin(compute(message, t).map_ok(StampedValue::from))
            })),
        )
    }

    /// A blocking function on a thread of its own.
    #[must_use]
    pub fn blocking(compute: impl FnMut(&I, u64) -> Result<O, Error> + Send + 'static) -> Self {
        Self::new(1, LocalKind::Threads(vec![Box::new(compute)]))
    }

    /// A blocking function on each of `at_once` (at least 1) threads; `make` makes one for each
    /// thread, with its own state.
    ///
    /// A computation of 300 ms needs four threads to keep pace with ten messages a second.
    #[must_use]
    pub fn threads<F>(at_once: usize, make: impl FnMut() -> F) -> Self
    where
        F: FnMut(&I, u64) -> Result<O, Error> + Send + 'static,
    {
        let computes = iter::repeat_with(make).take(at_once.max(1));
        let computes = computes.map(|compute| Box::new(compute) as Compute<I, O>).collect();
        Self::new(at_once, LocalKind::Threads(computes))
    }

    fn new(at_once: usize, kind: LocalKind<I, O>) -> Self {
        Self {
            deadline: None,
            waiting: None,
            overflow: Overflow::default(),
            skip_answered: false,
            at_once: at_once.max(1),
            kind,
        }
    }
}

/// The running local computation.
pub(crate) enum Workers<I, O> {
    Future(Spawn<I, O>),
    Threads {
        /// The threads end when this is dropped and their computations are done.
        jobs: mpsc::Sender<(Arc<I>, u64)>,
        /// At most one for each computation that was begun, so bounded.
        completions: UnboundedReceiver<Completion<O>>,
    },
}

impl<I: Send + Sync + 'static, O: Send + 'static> Workers<I, O> {
    /// Starts what `kind` says.
    ///
    /// # Errors
    /// If a thread cannot be started.
    pub(crate) fn start(kind: LocalKind<I, O>) -> io::Result<Self> {
        let computes = match kind {
            LocalKind::Future(spawn) => return Ok(Self::Future(spawn)),
            LocalKind::Threads(computes) => computes,
        };
        let (jobs, receiver) = mpsc::channel::<(Arc<I>, u64)>();
        let (sender, completions) = unbounded_channel();
        let receiver = Arc::new(Mutex::new(receiver));
        for mut compute in computes {
            let (receiver, completions) = (Arc::clone(&receiver), sender.clone());
            thread::Builder::new().name("fuseline-local".into()).spawn(move || {
                loop {
                    let job = receiver.lock().unwrap_or_else(PoisonError::into_inner).recv();
                    let Ok((message, timestamp)) = job else { return };
                    let result = guard(|| compute(&message, timestamp)).map(StampedValue::from);
                    // Nobody waits for it once the operator has ended.
                    drop(completions.send(Completion { priority: 0, timestamp, result }));
                }
            })?;
        }
        Ok(Self::Threads { jobs, completions })
    }

    /// Computes a message.
    pub(crate) fn compute(&mut self, message: Arc<I>, timestamp: u64) -> Sent<O> {
        match self {
            Self::Future(spawn) => Sent::Call(spawn(message, timestamp)),
            Self::Threads { jobs, .. } => match jobs.send((message, timestamp)) {
                Ok(()) => Sent::Away,
                Err(_) => Sent::Failed("local's threads have ended".into()),
            },
        }
    }

    /// The next end of a computation on a thread.
    pub(crate) fn poll_completion(&mut self, context: &mut Context<'_>) -> Poll<Completion<O>> {
        match self {
            Self::Future(_) => Poll::Pending,
            Self::Threads { completions, .. } => match completions.poll_recv(context) {
                Poll::Ready(Some(completion)) => Poll::Ready(completion),
                Poll::Ready(None) | Poll::Pending => Poll::Pending,
            },
        }
    }
}

/// Turns a panic into an error.
fn guard<T>(compute: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(compute)).unwrap_or_else(|panic| Err(panicked(&*panic)))
}
