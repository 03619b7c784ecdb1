//! [`Message`] serves one message's timers; a [`Call`] is used up by one result or failure of one source.
//! Both come from [`ValueOwner`](crate::ValueOwner), and any thread may hold them.

use std::fmt;
use std::sync::Arc;

use fuseline_core::{Firing, Instant, Outcome, Source, Timestamp};

use crate::cells::SourceCells;
use crate::handle::SharedHandle;
use crate::message_id::MessageId;

/// An open message, to serve its timers; any number of threads may share it.
pub struct Message<'a, T, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) handle: &'a SharedHandle<CLOUDS, WINDOW>,
    pub(crate) id: MessageId,
    pub(crate) cells: Arc<SourceCells<T, CLOUDS>>,
}

/// One request to one source for one message: it gives one result or one failure.
///
/// If it is dropped it gives neither: the request's timer closes it then, or local's deadline, if there is one.
#[must_use = "the message waits for it"]
pub struct Call<'a, T, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) message: Message<'a, T, CLOUDS, WINDOW>,
    pub(crate) source: Source,
}

/// What a result or a failure led to.
#[derive(Clone, PartialEq, Eq, Debug)]
#[must_use = "a forwarded value must be sent"]
pub struct CallOutcome<T, const CLOUDS: usize> {
    /// The message's timers that were due first.
    pub fired: Option<Firing<CLOUDS>>,
    /// What became of the result or the failure.
    pub outcome: Outcome<CLOUDS>,
    /// The value to send downstream, if the timers or the outcome say forwarded.
    pub forwarded: Option<T>,
    /// The call's own value, if its result was dropped.
    pub unused: Option<T>,
}

impl<T, const CLOUDS: usize, const WINDOW: usize> Message<'_, T, CLOUDS, WINDOW> {
    /// The message's timestamp.
    #[must_use]
    pub const fn timestamp(&self) -> Timestamp {
        self.id.timestamp()
    }

    /// The earliest due instant of its timers, as from [`SharedHandle::next_due`].
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.handle.next_due(self.id)
    }

    /// F5: time went by. Returns the timers that were due, if any, and the value to send downstream if they say
    /// forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn expire(&self, now: Instant) -> Option<(Firing<CLOUDS>, Option<T>)> {
        let firing = self.handle.expire(now, self.id)?;
        Some((firing, self.forwarded(&firing.outcome)))
    }

    /// The winner's value, if this outcome is to forward it.
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
    /// The message's timestamp.
    #[must_use]
    pub const fn timestamp(&self) -> Timestamp {
        self.message.timestamp()
    }

    /// F3: the result came.
    pub fn result(self, now: Instant, value: T) -> CallOutcome<T, CLOUDS> {
        let Self { message, source } = self;
        let Message { handle, id, cells } = &message;
        // Before the machine knows of it: as soon as it is held, any thread may forward it.
        cells.put(source, value);
        let (fired, outcome) = handle.result(now, *id, handle.priority(source));
        let unused = matches!(outcome, Outcome::Dropped(_)).then(|| cells.take(source)).flatten();
        message.answered(fired, outcome, unused)
    }

    /// F4: no result will come.
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
        // A message is forwarded once, so at most one of the two says so.
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
