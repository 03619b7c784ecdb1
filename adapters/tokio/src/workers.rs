//! Local while it runs: its async function, or its threads.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, mpsc};
use std::task::{Context, Poll};
use std::thread;

use fuseline_engine::{StampedValue, lock};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tracing::error;

use crate::Error;
use crate::drive::{Completion, Sent};
use crate::local::{Compute, LocalKind, MakeCompute, Spawn};
use crate::panics::panicked;

/// The running local computation.
pub(crate) enum Workers<I, O> {
    Future(Spawn<I, O>),
    Threads(LocalThreads<I, O>),
}

/// Local's threads.
pub(crate) struct LocalThreads<I, O> {
    /// The threads end when this is dropped and their computations are done.
    jobs: mpsc::Sender<(Arc<I>, u64)>,
    /// Holds at most one completion for each computation that was begun, so it is bounded.
    completions: UnboundedReceiver<Completion<O>>,
    worker: LocalWorker<I, O>,
    make: Option<MakeCompute<I, O>>,
}

/// The messages to compute, with their timestamps.
type LocalJobs<I> = mpsc::Receiver<(Arc<I>, u64)>;

/// The data that each thread has.
struct LocalWorker<I, O> {
    jobs: Arc<Mutex<LocalJobs<I>>>,
    completions: UnboundedSender<Completion<O>>,
    /// The timestamps that are being computed, with `true` for those whose thread was replaced.
    running: Arc<Mutex<Vec<(u64, bool)>>>,
}

impl<I: Send + Sync + 'static, O: Send + 'static> Workers<I, O> {
    /// Starts the computation that `kind` describes.
    ///
    /// # Errors
    /// Returns an error if a thread cannot be started.
    pub(crate) fn start(kind: LocalKind<I, O>) -> io::Result<Self> {
        let (computes, make) = match kind {
            LocalKind::Future(spawn) => return Ok(Self::Future(spawn)),
            LocalKind::Threads(computes, make) => (computes, make),
        };
        let (jobs, receiver) = mpsc::channel();
        let (sender, completions) = unbounded_channel();
        let worker = LocalWorker {
            jobs: Arc::new(Mutex::new(receiver)),
            completions: sender,
            running: Arc::default(),
        };
        for compute in computes {
            worker.start(compute)?;
        }
        Ok(Self::Threads(LocalThreads { jobs, completions, worker, make }))
    }

    /// Computes a message.
    pub(crate) fn compute(&mut self, message: Arc<I>, timestamp: u64) -> Sent<O> {
        match self {
            Self::Future(spawn) => Sent::Call(spawn(message, timestamp)),
            Self::Threads(threads) => match threads.jobs.send((message, timestamp)) {
                Ok(()) => Sent::Away,
                Err(_) => Sent::Failed("local's threads have ended".into()),
            },
        }
    }

    /// Starts another thread in place of the one that computes this message. That thread ends after
    /// this computation.
    pub(crate) fn replace(&mut self, timestamp: u64) {
        let Self::Threads(LocalThreads { worker, make: Some(make), .. }) = self else { return };
        // `make` is called with the lock released, because it may take long.
        if !worker.running().iter().any(|(t, _)| *t == timestamp) {
            return;
        }
        let compute = catch_unwind(AssertUnwindSafe(make)).map_err(|panic| panicked(&*panic));
        let started = compute.and_then(|compute| worker.start(compute).map_err(Error::from));
        if let Err(error) = started {
            error!(timestamp, %error, "local's worker cannot be replaced");
            return;
        }
        // If the computation has ended in the meantime, its thread continues beside the new one.
        if let Some((_, is_replaced)) = worker.running().iter_mut().find(|(t, _)| *t == timestamp) {
            *is_replaced = true;
        }
    }

    /// Returns the next end of a computation on a thread.
    pub(crate) fn poll_completion(&mut self, context: &mut Context<'_>) -> Poll<Completion<O>> {
        match self {
            Self::Future(_) => Poll::Pending,
            Self::Threads(threads) => match threads.completions.poll_recv(context) {
                Poll::Ready(Some(completion)) => Poll::Ready(completion),
                Poll::Ready(None) | Poll::Pending => Poll::Pending,
            },
        }
    }
}

impl<I: Send + Sync + 'static, O: Send + 'static> LocalWorker<I, O> {
    /// Starts a thread.
    fn start(&self, mut compute: Compute<I, O>) -> io::Result<()> {
        let worker = Self {
            jobs: Arc::clone(&self.jobs),
            completions: self.completions.clone(),
            running: Arc::clone(&self.running),
        };
        let thread = thread::Builder::new().name("fuseline-local".into());
        thread.spawn(move || while worker.compute_next(&mut compute) {}).map(drop)
    }

    /// Computes a message. Returns `false` if the thread is to end.
    fn compute_next(&self, compute: &mut Compute<I, O>) -> bool {
        let job = lock(&self.jobs).recv();
        let Ok((message, timestamp)) = job else { return false };
        self.running().push((timestamp, false));
        let result = guard(|| compute(&message, timestamp)).map(StampedValue::from);
        let mut running = self.running();
        let index = running.iter().position(|(t, _)| *t == timestamp);
        let is_replaced = index.is_some_and(|index| running.swap_remove(index).1);
        drop(running);
        // Sending fails once the operator has ended, and nobody needs the result then.
        drop(self.completions.send(Completion { priority: 0, timestamp, result }));
        !is_replaced
    }

    /// Locks the computations. Nothing panics while the lock is held.
    fn running(&self) -> MutexGuard<'_, Vec<(u64, bool)>> {
        lock(&self.running)
    }
}

/// Turns a panic into an error.
fn guard<T>(compute: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(compute)).unwrap_or_else(|panic| Err(panicked(&*panic)))
}
