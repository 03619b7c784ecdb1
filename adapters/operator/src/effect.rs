//! What the engine is given and what it gives back.

use std::time::Duration;

use fuseline_traces::DropReason;

use crate::item::{Item, Source};

/// What is to be done now.
#[derive(Debug)]
pub enum Effect<V, R> {
    /// Send this downstream.
    Output(Item<V>),
    /// Begin the call, or for priority 0 the local computation.
    Start {
        /// Whose.
        priority: u16,
        /// For which message.
        timestamp: u64,
        /// When the call must have ended, [linger](crate::Engine::set_linger) included; local's
        /// never must.
        until: Option<u64>,
        /// What was offered.
        request: R,
    },
    /// The call's result is no longer wanted (F5, F7), nor is it of use how long it would have
    /// taken. Never local's.
    Abort {
        /// Whose.
        priority: u16,
        /// For which message.
        timestamp: u64,
    },
    /// Use this for the next messages, if you like.
    Hint(Hint<V>),
}

/// A result that came too late for its message, for what comes next. It never becomes an output.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Hint<V> {
    /// Whose result it was.
    pub timestamp: u64,
    /// Who computed it.
    pub source: Source,
    /// The result.
    pub value: V,
    /// How long ago the message was taken in.
    pub age: Duration,
    /// Why it was dropped (F3): `late` or `superseded`.
    pub why: DropReason,
}

/// What a message handler wants to be sent to a cloud.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Offer<R> {
    /// Which.
    pub priority: u16,
    /// How long it may take; if the cloud has a policy, how long at most.
    pub deadline: Duration,
    /// What is to be sent.
    pub request: R,
}

/// How many computations local can have.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Local {
    /// How many run at once; at least one does.
    pub at_once: usize,
    /// How many more may wait; beyond that local fails at once (F4).
    pub waiting: usize,
    /// Whether one that waits is skipped once its message was answered.
    pub skip_answered: bool,
    /// D13 lost words: whether word of its end can be lost on the way, as over topics. One that began and sent no
    /// word within its message's limit then counts as lost and gives its place back, whether its
    /// message is open or not; should its result come after all, the rules decide about it as about
    /// any other. Without a limit it is waited for.
    ///
    /// Off, a computation has its place until it ends: it is still running.
    pub lossy: bool,
}
