//! The types that go into the engine and come out of it, beside plain values.

use std::time::Duration;

use fuseline_traces::DropReason;

use crate::item::{Item, Source};

/// A task for the adapter.
#[derive(Debug)]
pub enum Effect<V, R> {
    /// Send this item downstream.
    Output(Item<V>),
    /// Begin the call or, for priority 0, the local computation.
    Start {
        /// The source's priority; 0 is local.
        priority: u16,
        /// The message's timestamp.
        timestamp: u64,
        /// The instant in ns by which the call must end, including its time to
        /// [linger](crate::CloudConfig::linger); `None` for local.
        until: Option<u64>,
        /// The request that the message handler offered.
        request: R,
    },
    /// End the call, because neither its result (F5, F7) nor its duration is needed any more.
    /// Local's computation is never aborted.
    Abort {
        /// The cloud's priority.
        priority: u16,
        /// The message's timestamp.
        timestamp: u64,
    },
    /// Start another worker for local, because this computation has run longer than its message's
    /// deadline. If its result still comes, the rules decide about it as about any other. Do not
    /// use its worker again.
    Replace {
        /// The message's timestamp.
        timestamp: u64,
    },
    /// Use a late result with later messages, if it helps.
    Hint(Hint<V>),
}

/// A result that came too late for its message but may help with later ones. It is never an output.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Hint<V> {
    /// The timestamp of its message.
    pub timestamp: u64,
    /// The source that computed it.
    pub source: Source,
    /// The result.
    pub value: V,
    /// The time since the message was accepted.
    pub age: Duration,
    /// The reason why it was dropped (F3): `late` or `superseded`.
    pub why: DropReason,
}

/// A request that a message handler offers to a cloud.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Offer<R> {
    /// The cloud's priority.
    pub priority: u16,
    /// The time that the cloud may take. If the cloud has a policy, this is the greatest deadline
    /// that the policy may choose.
    pub deadline: Duration,
    /// The request.
    pub request: R,
}

/// Selects the computation that is discarded when too many wait for local (D17).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Overflow {
    /// The oldest, because a fresh message is worth more.
    #[default]
    DropOldest,
    /// The newest, for a local computation that needs each message before the next one.
    DropNewest,
}

/// Configures how many computations local runs at once, and how many may wait.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Local {
    /// The number of computations that run at once; at least one does.
    pub at_once: usize,
    /// The number of computations that may wait; by default as many as the window holds. If more
    /// wait, one of them is [discarded](Self::overflow), and local fails for its message (F4).
    pub waiting: Option<usize>,
    /// The computation that is discarded; by default the oldest.
    pub overflow: Overflow,
    /// The number of computations that have not ended and may be replaced. Each is replaced by an
    /// [`Effect::Replace`] once it has run for longer than its message's deadline. By default none
    /// is, because local may keep state.
    pub replaceable: usize,
    /// `true` to skip a waiting computation once its message has its output.
    pub skip_answered: bool,
    /// `true` if a result can be lost on the way, as over topics (D13).
    ///
    /// A computation without a result or failure within its message's deadline then counts as lost.
    /// Another computation may take its place, whether its message is open or not. If its result
    /// comes after all, the rules decide about it as about any other. A computation without a
    /// deadline never counts as lost.
    ///
    /// If `false`, a computation occupies its place until it ends, unless it may be
    /// [replaced](Self::replaceable). One that runs longer than its message's deadline is still
    /// counted as lost and logged.
    pub may_lose_results: bool,
}

/// Runs one computation at a time, which keeps its place until it ends.
impl Default for Local {
    fn default() -> Self {
        Self {
            at_once: 1,
            waiting: None,
            overflow: Overflow::default(),
            replaceable: 0,
            skip_answered: false,
            may_lose_results: false,
        }
    }
}
