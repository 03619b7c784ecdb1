//! What the machine answers: one enum per kind of input, each refusal and drop with its reason (F8, P11).

use crate::priority::{Priorities, Priority};
use crate::time::{Instant, Timestamp};

/// What became of an open (F1).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a refused message has no timestamp that an answer could come for"]
pub enum Opening {
    /// The timestamp is open and waits for local.
    Accepted,
    /// Nothing changed.
    Refused(OpenRefusal),
}

/// Why an open was refused; the first that holds, in this order (F1).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OpenRefusal {
    /// This timestamp or a later one was opened before.
    Order,
    /// As many timestamps are open as the window allows.
    Full,
    /// Local's due instant is not after now.
    Deadline,
}

/// What became of an offer (F2).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a refused request must not be sent"]
pub enum Admission {
    /// Send the request; its result is in time before `due`.
    Admitted {
        /// The due instant; a result at this instant is late.
        due: Instant,
    },
    /// Do not send; nothing changed but the gate.
    Refused(OfferRefusal),
}

/// Why an offer was refused; the first that holds, in this order (F2).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OfferRefusal {
    /// No such cloud is registered, or neither this timestamp nor a later one was ever opened.
    Unknown,
    /// The timestamp is not open.
    Closed,
    /// The cloud was requested for this timestamp before.
    Duplicate,
    /// An available result outranks whatever this cloud would return.
    Outranked,
    /// The due instant is not after now.
    Deadline,
    /// The cloud's gate is shut: too many requests are queued.
    Queue,
}

/// What became of a result, of a failure, or of timers that fired (F3–F7).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a forwarded result must be sent and a missed timestamp reported"]
pub enum Outcome<const CLOUDS: usize> {
    /// The input was dropped and changed nothing. Timers are never dropped.
    Dropped(DropReason),
    /// Keep the result: it is available, but something pending outranks it. Only a result is held.
    Held,
    /// Accepted; the timestamp stays open. Never the answer to a result.
    Waiting,
    /// Send the result of `by` downstream; the timestamp stays open for better ones (F9). Only under progressive, and only
    /// the answer to a result.
    Preliminary {
        /// The source of the result; 0 is local.
        by: Priority,
        /// The clouds still pending that it outranks: their calls may be aborted.
        cancelled: Priorities<CLOUDS>,
    },
    /// The result of `by`, sent before, was the last: the timestamp is retired (F9). Only under progressive, and never the
    /// answer to a result.
    Final {
        /// The source of the result; 0 is local.
        by: Priority,
    },
    /// Send the result of `by` downstream; the timestamp is retired and whatever else was held for it is discarded.
    Forwarded {
        /// The source of the result; 0 is local.
        by: Priority,
        /// The clouds still pending: their calls may be aborted.
        cancelled: Priorities<CLOUDS>,
    },
    /// Nothing came and nothing will: the timestamp is retired without a result. Never the answer to a result.
    Missed,
}

/// Why a result or a failure was dropped; the first that holds, in this order (F3, F4).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DropReason {
    /// No such source, or neither this timestamp nor a later one was ever opened.
    Unknown,
    /// The timestamp is not open: forwarded, missed, or skipped. Under progressive also: the last output outranks it.
    Superseded,
    /// The source was not requested for this timestamp.
    Unsolicited,
    /// The source's result was accepted before, and is held or was the last output.
    Duplicate,
    /// The request was closed by its timer or by a failure.
    Late,
}

/// One timestamp's timers fired at one due instant (F5).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a firing may forward a result or miss a timestamp"]
pub struct Firing<const CLOUDS: usize> {
    /// The timestamp whose timers fired.
    pub timestamp: Timestamp,
    /// The instant at which they were due.
    pub due: Instant,
    /// The requests that they close; 0 is local.
    pub timers: Priorities<CLOUDS>,
    /// Waiting, forwarded, final or missed.
    pub outcome: Outcome<CLOUDS>,
}
