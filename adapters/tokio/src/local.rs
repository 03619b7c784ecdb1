//! The local computation: an async function, or a blocking one on threads of its own.

use std::iter;
use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Overflow, StampedValue};
use futures_util::TryFutureExt;
use futures_util::future::BoxFuture;

use crate::Error;

/// Describes how messages are computed on board (priority 0). An error or a panic is a failure
/// (F4).
///
/// A computation that has begun is never aborted (F7). Each accepted message is computed, in order,
/// unless too many [wait](Self::waiting), or [`skip_answered`](Self::skip_answered) is set and the
/// message was answered.
pub struct Local<I, O> {
    /// The time that a computation may take, counted from the acceptance of its message; 1 s by
    /// default.
    ///
    /// With `None`, a message whose computation never ends stays open (A9). A computation that runs
    /// longer is logged and counted as lost, and it occupies its place until it ends, unless it may
    /// be [replaced](Self::replaceable).
    pub deadline: Option<Duration>,
    /// The greatest number of computations past their `deadline` that other threads may replace.
    /// The default is `at_once` for [`threads`](Self::threads), which can make another function. It
    /// is 0, and has no effect, for the other kinds: a computation with state must not run beside
    /// itself.
    pub replaceable: usize,
    /// The number of messages that may wait for a computation; by default as many as the window.
    /// Beyond that, one is discarded: local fails for it (F4), and only the clouds can answer it.
    pub waiting: Option<usize>,
    /// The message that is discarded then; by default the oldest, because a fresh message is worth
    /// more (D17).
    pub overflow: Overflow,
    /// `true` to skip a computation that has not begun when its message is answered. `false` by
    /// default, because local may keep state.
    pub skip_answered: bool,
    pub(crate) at_once: usize,
    pub(crate) kind: LocalKind<I, O>,
}

/// The deadline if none is set.
const DEADLINE: Duration = Duration::from_secs(1);

pub(crate) enum LocalKind<I, O> {
    Future(Spawn<I, O>),
    Threads(Vec<Compute<I, O>>, Option<MakeCompute<I, O>>),
}

pub(crate) type Spawn<I, O> =
    Box<dyn FnMut(Arc<I>, u64) -> BoxFuture<'static, Result<StampedValue<O>, Error>> + Send>;
/// Makes another function, with its own state.
pub(crate) type MakeCompute<I, O> = Box<dyn FnMut() -> Compute<I, O> + Send>;
pub(crate) type Compute<I, O> = Box<dyn FnMut(&I, u64) -> Result<O, Error> + Send>;

impl<I: Send + Sync + 'static, O: Send + 'static> Local<I, O> {
    /// Computes with an async function, one message at a time.
    #[must_use]
    pub fn future<Fut>(compute: impl FnMut(Arc<I>, u64) -> Fut + Send + 'static) -> Self
    where
        Fut: Future<Output = Result<O, Error>> + Send + 'static,
    {
        Self::futures(1, compute)
    }

    /// Computes with an async function, up to `at_once` (at least 1) messages at a time.
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

    /// Computes with a blocking function, on a thread of its own. The function may keep state.
    ///
    /// ```
    /// # use fuseline_tokio::Local;
    /// let mut messages = 0_u64;
    /// let local: Local<String, u64> = Local::blocking(move |_message, _timestamp| {
    ///     messages += 1;
    ///     Ok(messages)
    /// });
    /// ```
    #[must_use]
    pub fn blocking(compute: impl FnMut(&I, u64) -> Result<O, Error> + Send + 'static) -> Self {
        Self::new(1, LocalKind::Threads(vec![Box::new(compute)], None))
    }

    /// Computes with a blocking function on each of `at_once` (at least 1) threads.
    ///
    /// `make` returns the function for one thread, with its own state. It is called again for a
    /// thread that is [replaced](Self::replaceable). A computation of 300 ms needs four threads to
    /// keep pace with ten messages a second.
    ///
    /// ```
    /// # use std::time::Duration;
    /// # use fuseline_tokio::Local;
    /// let mut local = Local::threads(4, || |message: &Vec<f32>, _timestamp| Ok(message.iter().sum::<f32>()));
    /// local.deadline = Some(Duration::from_millis(400));
    /// ```
    #[must_use]
    pub fn threads<F>(at_once: usize, mut make: impl FnMut() -> F + Send + 'static) -> Self
    where
        F: FnMut(&I, u64) -> Result<O, Error> + Send + 'static,
    {
        let mut make: MakeCompute<I, O> = Box::new(move || Box::new(make()));
        let computes = iter::repeat_with(&mut make).take(at_once.max(1)).collect();
        let local = Self::new(at_once, LocalKind::Threads(computes, Some(make)));
        Self { replaceable: local.at_once, ..local }
    }

    fn new(at_once: usize, kind: LocalKind<I, O>) -> Self {
        Self {
            deadline: Some(DEADLINE),
            replaceable: 0,
            waiting: None,
            overflow: Overflow::default(),
            skip_answered: false,
            at_once: at_once.max(1),
            kind,
        }
    }
}

impl<I, O> LocalKind<I, O> {
    /// Returns `true` if another thread can take the place of one that hangs.
    pub(crate) const fn is_made_anew(&self) -> bool {
        matches!(self, Self::Threads(_, Some(_)))
    }
}
