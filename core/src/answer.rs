//! The answers to inputs. Each kind of input has its own enum, and each refusal and drop has a
//! reason (F8, P11).

use crate::priority::{Priorities, Priority};
use crate::time::{Instant, Timestamp};

/// Reports whether a message was accepted (F1).
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

/// The reason why an open was refused.
///
/// If several reasons hold, the first one in this order is given (F1).
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
    /// The number of open timestamps has reached the window.
    Full,
    /// Local's due instant is not later than now.
    Deadline,
}

/// Reports whether a request may be sent (F2).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a refused request must not be sent"]
pub enum Admission {
    /// Send the request. Its result is in time if it arrives before `due`.
    Admitted {
        /// The due instant; a result that arrives at this instant is late.
        due: Instant,
    },
    /// Do not send the request. Nothing changed except, possibly, the gate.
    Refused(OfferRefusal),
}

/// The reason why an offer was refused.
///
/// If several reasons hold, the first one in this order is given (F2).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OfferRefusal {
    /// No cloud has this priority, or neither this timestamp nor a later one was ever opened.
    Unknown,
    /// The timestamp is not open.
    Closed,
    /// This cloud was already requested for this timestamp.
    Duplicate,
    /// A result that outranks this cloud is held or, under the progressive rule, was sent last.
    Outranked,
    /// The due instant is not later than now.
    Deadline,
    /// The cloud's gate is shut because too many requests are queued.
    Queue,
}

/// Reports what became of a result, a failure, or timers that fired (F3–F7).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a forwarded result must be sent and a missed timestamp reported"]
pub enum Outcome<const CLOUDS: usize> {
    /// The result or failure was dropped and changed nothing. Timers are never dropped.
    Dropped(DropReason),
    /// Keep the result: it is available, but a source that outranks it is pending. Only results are
    /// held.
    Held,
    /// The failure or the timers closed requests, and the timestamp stays open. Results never get
    /// this answer.
    Waiting,
    /// Send the result of `by` downstream. The timestamp stays open because better results may
    /// follow (F9).
    ///
    /// Only results get this answer, and only under the progressive commit rule.
    Preliminary {
        /// The source of the result; 0 is local.
        by: Priority,
        /// The pending clouds that the result outranks. Their calls may be aborted.
        cancelled: Priorities<CLOUDS>,
    },
    /// The result of `by`, sent before, is the last one; the timestamp is retired (F9).
    ///
    /// Only failures and timers get this answer, and only under the progressive commit rule.
    Final {
        /// The source of the result; 0 is local.
        by: Priority,
    },
    /// Send the result of `by` downstream. The timestamp is retired, and its other held results are
    /// discarded.
    Forwarded {
        /// The source of the result; 0 is local.
        by: Priority,
        /// The clouds still pending. Their calls may be aborted.
        cancelled: Priorities<CLOUDS>,
    },
    /// The timestamp is retired: no result arrived in time and none is pending. Results never get
    /// this answer.
    Missed,
}

/// The reason why a result or a failure was dropped.
///
/// If several reasons hold, the first one in this order is given (F3, F4).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DropReason {
    /// No source has this priority, or neither this timestamp nor a later one was ever opened.
    Unknown,
    /// The timestamp is not open: it was retired, or it was never opened although a later one was.
    /// Under the progressive rule this also means that the last output outranks the source.
    Superseded,
    /// The source was not requested for this timestamp.
    Unsolicited,
    /// The source's result was accepted before. It is held, or it is the last output (F9).
    Duplicate,
    /// The request was closed by its timer or by a failure.
    Late,
}

/// Describes the timers of one timestamp that fired at one due instant (F5).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use = "a firing may forward a result or miss a timestamp"]
pub struct Firing<const CLOUDS: usize> {
    /// The timestamp whose timers fired.
    pub timestamp: Timestamp,
    /// The instant at which the timers were due.
    pub due: Instant,
    /// The sources whose requests the timers close; 0 is local.
    pub timers: Priorities<CLOUDS>,
    /// The consequence: waiting, forwarded, final or missed.
    pub outcome: Outcome<CLOUDS>,
}
