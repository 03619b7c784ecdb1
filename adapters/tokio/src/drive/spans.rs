//! Makes a span for each message, and below it a span for each call and for local's computation.
//! The spans have the attributes that `fuseline convert` reads from OpenTelemetry.

use std::time::Duration;

use fuseline_engine::{Ending, Forwarded, Item, Lineage, StampedValue};
use rustc_hash::FxHashMap;
use tracing::field::Empty;
use tracing::span::Entered;
use tracing::{Span, debug_span};

use crate::Error;

/// The spans of the open messages. Empty if no subscriber wants them.
#[derive(Default)]
pub(super) struct MessageSpans {
    open: FxHashMap<u64, Span>,
    /// The spans of requests whose results come from the transport, by priority and timestamp.
    away: FxHashMap<(u16, u64), TracedCall>,
}

/// A call's span, if a subscriber wants it. Dropping it before its end marks it as aborted.
pub(super) struct TracedCall(Option<Box<OpenCall>>);

struct OpenCall {
    span: Span,
    has_ended: bool,
}

impl MessageSpans {
    /// Begins the span of an accepted message; `deadline` is local's.
    pub(super) fn open(
        &mut self,
        operator: &str,
        timestamp: u64,
        deadline: Option<Duration>,
        lineage: Option<&Lineage>,
    ) {
        let origin = lineage.and_then(|lineage| lineage.origin.as_ref());
        // Each message gets a trace of its own, because the operator's span ends with the operator.
        let span = debug_span!(
            parent: None,
            "message",
            operator,
            fuseline.t = int(timestamp),
            fuseline.deadline = deadline.map(nanos),
            fuseline.within = lineage.and_then(|lineage| lineage.within).map(nanos),
            fuseline.origin = origin.map(|origin| &*origin.stream),
            fuseline.seq = origin.and_then(|origin| origin.seq).map(int),
            fuseline.latency = Empty,
            fuseline.by = Empty,
            fuseline.of = Empty,
            fuseline.for = Empty,
            fuseline.ended = Empty,
            otel.status_code = Empty,
        );
        if !span.is_disabled() {
            self.open.insert(timestamp, span);
        }
    }

    /// Begins the span of a request or of local's computation.
    pub(super) fn begin(
        &self,
        (priority, timestamp): (u16, u64),
        deadline: Duration,
    ) -> TracedCall {
        let parent = self.open.get(&timestamp).and_then(Span::id);
        let is_remote = priority > 0;
        let span = debug_span!(
            parent: parent,
            "call",
            priority,
            timestamp,
            fuseline.p = i64::from(priority),
            fuseline.deadline = is_remote.then(|| nanos(deadline)),
            fuseline.of = Empty,
            fuseline.for = Empty,
            fuseline.ended = Empty,
            otel.kind = if is_remote { "client" } else { "internal" },
            otel.status_code = Empty,
        );
        let is_open = !span.is_disabled();
        TracedCall(is_open.then(|| Box::new(OpenCall { span, has_ended: false })))
    }

    /// Keeps the span of a request whose result will come from the transport.
    pub(super) fn wait(&mut self, key: (u16, u64), span: TracedCall) {
        if span.0.is_some() {
            self.away.insert(key, span);
        }
    }

    /// Ends the span of a request whose result came.
    pub(super) fn complete<V>(&mut self, key: (u16, u64), result: &Result<StampedValue<V>, Error>) {
        // Without a subscriber the map is empty, and looking at its length is cheaper than a
        // search.
        if !self.away.is_empty()
            && let Some(mut span) = self.away.remove(&key)
        {
            span.end(result);
        }
    }

    /// Drops the span of a request that is not awaited any more.
    pub(super) fn abort(&mut self, key: (u16, u64)) {
        self.away.remove(&key);
    }

    /// Ends the span of a message whose last item is sent.
    pub(super) fn item<V>(&mut self, item: &Item<V>) {
        if self.open.is_empty() || !item.is_last() {
            return;
        }
        let Some(span) = self.open.remove(&item.timestamp) else { return };
        self.abort((0, item.timestamp));
        // The latency is recorded apart, because local may compute on, and a span ends with the
        // last span below it.
        span.record("fuseline.latency", nanos(item.latency()));
        match &item.ending {
            Ending::Forwarded(Forwarded { source, of, meant_for, .. }) => {
                span.record("fuseline.by", i64::from(source.priority));
                span.record("fuseline.of", of.map(int));
                span.record("fuseline.for", meant_for.map(int));
            }
            Ending::Final(source) => {
                span.record("fuseline.by", i64::from(source.priority));
            }
            Ending::Missed => {
                span.record("otel.status_code", "ERROR");
            }
            Ending::Preliminary(_) | Ending::Refused(_) => {}
        }
    }
}

/// Marks the messages that are still open as stopped.
impl Drop for MessageSpans {
    fn drop(&mut self) {
        for span in self.open.values() {
            span.record("fuseline.ended", "stopped");
        }
    }
}

impl TracedCall {
    pub(super) fn span(&self) -> Span {
        self.0.as_ref().map_or_else(Span::none, |call| call.span.clone())
    }

    /// Enters the span until what this returns is dropped.
    pub(super) fn enter(&self) -> Option<Entered<'_>> {
        self.0.as_ref().map(|call| call.span.enter())
    }

    pub(super) fn end<V>(&mut self, result: &Result<StampedValue<V>, Error>) {
        match (result, &mut self.0) {
            (Ok(value), Some(call)) => {
                call.has_ended = true;
                call.span.record("fuseline.of", value.of.map(int));
                call.span.record("fuseline.for", value.meant_for.map(int));
            }
            (Ok(_), None) => {}
            (Err(_), _) => self.fail(),
        }
    }

    pub(super) fn fail(&mut self) {
        if let Some(call) = &mut self.0 {
            call.has_ended = true;
            call.span.record("otel.status_code", "ERROR");
        }
    }
}

impl Drop for OpenCall {
    fn drop(&mut self) {
        if !self.has_ended {
            self.span.record("fuseline.ended", "aborted");
        }
    }
}

// OpenTelemetry has no unsigned numbers.
fn int(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

fn nanos(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}
