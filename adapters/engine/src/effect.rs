//! What goes into the engine beside plain values, and what comes out.

use std::time::Duration;

use fuseline_traces::DropReason;

use crate::item::{Item, Source};

/// What the adapter is to do now.
#[derive(Debug)]
pub enum Effect<V, R> {
    /// Send this downstream.
    Output(Item<V>),
    /// Begin the call, or for priority 0 the local computation.
    Start {
        /// The source's priority; 0 is local.
        priority: u16,
        /// The message's timestamp.
        timestamp: u64,
        /// The instant by which the call must end, in ns, time to [linger](crate::CloudConfig::linger)
        /// included; none for local.
        until: Option<u64>,
        /// What the message handler offered.
        request: R,
    },
    /// End the call: neither its result (F5, F7) nor how long it would take is of use any more.
    /// Never local's.
    Abort {
        /// Whose.
        priority: u16,
        /// For which message.
        timestamp: u64,
    },
    /// Run local anew beside this computation, which has run for longer than its message's deadline: its place
    /// goes to another. What still comes of it counts as any result; whatever ran it is not used again.
    Replace {
        /// For which message.
        timestamp: u64,
    },
    /// A late result, for use with later messages if wanted.
    Hint(Hint<V>),
}

/// A result that came too late for its message but may help with later ones. It is never an output.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Hint<V> {
    /// The timestamp of its message.
    pub timestamp: u64,
    /// Who computed it.
    pub source: Source,
    /// The result.
    pub value: V,
    /// The time since the message was taken in.
    pub age: Duration,
    /// Why it was dropped (F3): `late` or `superseded`.
    pub why: DropReason,
}

/// What a message handler wants to be sent to a cloud.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Offer<R> {
    /// The cloud's priority.
    pub priority: u16,
    /// How long the cloud may take; if it has a policy, the most that the policy may choose.
    pub deadline: Duration,
    /// What is to be sent.
    pub request: R,
}

/// Which computation is thrown out when too many wait for local (D17).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Overflow {
    /// The oldest: a fresh message is worth more.
    #[default]
    DropOldest,
    /// The newest, for a local computation that needs each message before the next one.
    DropNewest,
}

/// How many computations local takes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Local {
    /// How many run at once; at least one does.
    pub at_once: usize,
    /// How many more may wait, by default as many as the window holds; beyond that one [is thrown out](Self::overflow): local
    /// fails for its message (F4).
    pub waiting: Option<usize>,
    /// Which one is thrown out then; the oldest by default.
    pub overflow: Overflow,
    /// Up to how many computations that have not ended may be replaced, each by an [`Effect::Replace`] once it has run for
    /// longer than its message's deadline. By default none is: local may keep state.
    pub replaceable: usize,
    /// Whether one that waits is skipped once its message is answered.
    pub skip_answered: bool,
    /// D13 lost words: whether a result can be lost on the way, as over topics. If so, a computation
    /// without a result or failure within its message's deadline counts as lost, and another may run instead,
    /// whether its message is open or not. If its result comes after all, the rules decide about it as
    /// about any other. Without a deadline it is waited for.
    ///
    /// If not, a computation counts as running until it ends, unless it may be
    /// [replaced](Self::replaceable). One that has run that long is counted as lost and warned of all the same.
    pub lossy: bool,
}

/// One computation at a time, which keeps its place until it ends.
impl Default for Local {
    fn default() -> Self {
        Self {
            at_once: 1,
            waiting: None,
            overflow: Overflow::default(),
            replaceable: 0,
            skip_answered: false,
            lossy: false,
        }
    }
}
