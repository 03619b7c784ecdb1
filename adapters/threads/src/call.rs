//! [`Message`] fires one message's timers. A [`Call`] gives one result or one failure of one
//! source.
//!
//! Both come from [`ValueOwner`](crate::ValueOwner), and any thread may hold them.

use std::fmt;
use std::sync::Arc;

use fuseline_core::{Firing, Instant, Outcome, Source, Timestamp};

use crate::cells::SourceCells;
use crate::handle::SharedHandle;
use crate::message_id::MessageId;

/// Fires the timers of one open message. Any number of threads may share it.
pub struct Message<'a, T, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) handle: &'a SharedHandle<CLOUDS, WINDOW>,
    pub(crate) id: MessageId,
    pub(crate) cells: Arc<SourceCells<T, CLOUDS>>,
}

/// Gives one result or one failure of one source for one message.
///
/// A call that is dropped gives neither. Its request is then closed by its timer; local's is closed
/// by its deadline, if it has one.
#[must_use = "the message waits for it"]
pub struct Call<'a, T, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) message: Message<'a, T, CLOUDS, WINDOW>,
    pub(crate) source: Source,
}

/// Reports the consequences of a result or a failure.
#[derive(Clone, PartialEq, Eq, Debug)]
#[must_use = "a forwarded value must be sent"]
pub struct CallOutcome<T, const CLOUDS: usize> {
    /// The message's timers that fired first.
    pub fired: Option<Firing<CLOUDS>>,
    /// The outcome of the result or the failure itself.
    pub outcome: Outcome<CLOUDS>,
    /// The value to send downstream, if the firing or the outcome forwards one.
    pub forwarded: Option<T>,
    /// The call's own value, if its result was dropped.
    pub unused: Option<T>,
}

impl<T, const CLOUDS: usize, const WINDOW: usize> Message<'_, T, CLOUDS, WINDOW> {
    /// Returns the message's timestamp.
    #[must_use]
    pub const fn timestamp(&self) -> Timestamp {
        self.id.timestamp()
    }

    /// Returns the earliest due instant of the message's timers, as [`SharedHandle::next_due`]
    /// does.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.handle.next_due(self.id)
    }

    /// Fires the timers that are due by `now` (F5). Returns the firing, if there is one, and the
    /// value to send downstream if the firing forwards one.
    #[must_use = "a forwarded value must be sent"]
    pub fn expire(&self, now: Instant) -> Option<(Firing<CLOUDS>, Option<T>)> {
        let firing = self.handle.expire(now, self.id)?;
        Some((firing, self.forwarded(&firing.outcome)))
    }

    /// Returns the winner's value if this outcome forwards it.
    pub(crate) fn forwarded(&self, outcome: &Outcome<CLOUDS>) -> Option<T> {
        match outcome {
            Outcome::Forwarded { by, .. } | Outcome::Preliminary { by, .. } => {
                self.cells.take(self.handle.source(*by)?)
            }
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Final { .. }
            | Outcome::Missed => None,
        }
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> Call<'_, T, CLOUDS, WINDOW> {
    /// Returns the message's timestamp.
    #[must_use]
    pub const fn timestamp(&self) -> Timestamp {
        self.message.timestamp()
    }

    /// Gives the result of this call (F3).
    pub fn result(self, now: Instant, value: T) -> CallOutcome<T, CLOUDS> {
        let Self { message, source } = self;
        let Message { handle, id, cells } = &message;
        // The value is stored before the machine learns of it, because any thread may forward a
        // held result at once.
        cells.put(source, value);
        let (fired, outcome) = handle.result(now, *id, handle.priority(source));
        let unused = matches!(outcome, Outcome::Dropped(_)).then(|| cells.take(source)).flatten();
        message.answered(fired, outcome, unused)
    }

    /// Reports that no result will come from this call (F4).
    pub fn fail(self, now: Instant) -> CallOutcome<T, CLOUDS> {
        let Self { message, source } = self;
        let (fired, outcome) =
            message.handle.fail(now, message.id, message.handle.priority(source));
        message.answered(fired, outcome, None)
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> Message<'_, T, CLOUDS, WINDOW> {
    fn answered(
        &self,
        fired: Option<Firing<CLOUDS>>,
        outcome: Outcome<CLOUDS>,
        unused: Option<T>,
    ) -> CallOutcome<T, CLOUDS> {
        // A message is forwarded once, so the firing and the outcome never both forward it.
        let by_timers = fired.and_then(|firing| self.forwarded(&firing.outcome));
        let forwarded = by_timers.or_else(|| self.forwarded(&outcome));
        CallOutcome { fired, outcome, forwarded, unused }
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> Clone for Message<'_, T, CLOUDS, WINDOW> {
    fn clone(&self) -> Self {
        Self { handle: self.handle, id: self.id, cells: Arc::clone(&self.cells) }
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> fmt::Debug for Message<'_, T, CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Message").field(&self.id).finish()
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> fmt::Debug for Call<'_, T, CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Call").field(&self.message.id).field(&self.source).finish()
    }
}
