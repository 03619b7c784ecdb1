//! Takes the events of topics and parameters one by one.

use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_tokio::StampedValue;
use fuseline_tokio::drive::{Completion, Incoming};
use futures_util::StreamExt;
use futures_util::stream::{BoxStream, SelectAll, poll_fn, select_all};
use tokio::sync::mpsc;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::{debug, info, warn};

use super::{LOCAL, LoopState, NodeFusion};
use crate::key::KeyError;
use crate::middleware::{Endpoint, ReceivedPayload};
use crate::parameters::Value;
use crate::raw::Payload;
use crate::settings::{Change, Kind};
use crate::stamps::KeyOrder;

/// The channels on which the node receives.
pub(crate) struct InputChannels<'a> {
    pub(crate) inputs: mpsc::Receiver<ReceivedPayload>,
    /// Results, each with the index of its source.
    pub(crate) results: mpsc::Receiver<(usize, ReceivedPayload)>,
    pub(crate) deadlines: mpsc::Receiver<ReceivedPayload>,
    pub(crate) speeds: mpsc::Receiver<ReceivedPayload>,
    pub(crate) changes: &'a mut mpsc::UnboundedReceiver<Change>,
    pub(crate) reports: ReportTicks,
}

/// The ticks at which reports are due. The main loop asks before each event, so the timer is polled
/// only if it was woken.
pub(crate) type ReportTicks = SelectAll<BoxStream<'static, ()>>;

/// Returns ticks with this period, of which the first comes at once.
pub(crate) fn report_ticks(period: Duration) -> ReportTicks {
    let mut interval = interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    select_all([poll_fn(move |context| interval.poll_tick(context).map(|_| Some(()))).boxed()])
}

impl NodeFusion<'_> {
    /// Returns `true` if the node accepts messages.
    pub(super) fn is_active(&self) -> bool {
        self.orders.as_ref().is_none_or(|orders| orders.is_active)
    }

    /// Polls for a request to a managed node's lifecycle.
    pub(super) fn poll_orders(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<Option<Incoming<Payload, Payload>>> {
        let Some(orders) = &mut self.orders else { return Poll::Pending };
        known(orders.reported.poll_recv(context))
            .map(|order| orders.obey(order).then_some(Incoming::Last))
    }

    /// Takes a sample of the input topic. It is a message if it has a key that no remembered
    /// message has.
    pub(super) fn take(&mut self, sample: ReceivedPayload) -> Option<Incoming<Payload, Payload>> {
        let LoopState { stamps, next, intake, .. } = &mut self.memory;
        let Ok(message) = sample
            .inspect_err(|error| debug!(%error, "an input is not accepted: it cannot be read"))
        else {
            intake.encoding += 1;
            return None;
        };
        let key = match self.input_key.read(&message.body, message.big_endian) {
            Ok(key) => key,
            Err(error) => {
                debug!(%error, "an input is not accepted: it has no readable key");
                match error {
                    KeyError::Short => intake.short += 1,
                    KeyError::Nanosec => intake.nanosec += 1,
                }
                return None;
            }
        };
        match stamps.order(key) {
            KeyOrder::Taken => {
                debug!(%key, "an input is not accepted: an earlier message has the same stamp");
                intake.duplicate_stamp += 1;
                intake.stamp_zero += u64::from(self.input_key.is_unset(key));
                return None;
            }
            KeyOrder::Backwards => intake.stamp_backwards += 1,
            KeyOrder::Forwards => {}
        }
        let timestamp = *next;
        *next += 1;
        stamps.open(key, timestamp);
        Some(Incoming::Message { timestamp, message })
    }

    /// Takes a sample of a source's topic. It is a result if it has the key of a message.
    pub(super) fn result(
        &mut self,
        index: usize,
        sample: ReceivedPayload,
    ) -> Option<Incoming<Payload, Payload>> {
        let source = &mut self.sources[index];
        let key = sample.ok().and_then(|payload| {
            let key = self.output_key.read(&payload.body, payload.big_endian).ok()?;
            Some((key, payload))
        });
        let Some((key, payload)) = key else {
            debug!(source = source.name, "a result is dropped: it has no readable key");
            source.unmatched.malformed += 1;
            return None;
        };
        let Some(timestamp) = self.memory.stamps.find(key) else {
            debug!(source = source.name, %key, "a result is dropped: no message has its stamp");
            source.unmatched.unknown_stamp += 1;
            source.unmatched.stamp_zero += u64::from(self.output_key.is_unset(key));
            return None;
        };
        Some(Incoming::Completion(Completion {
            priority: source.priority,
            timestamp,
            // The stamp is the result's own (D2).
            result: Ok(StampedValue { value: payload, of: Some(timestamp), meant_for: None }),
        }))
    }

    /// Sets the deadline that the environment decides, in seconds as `std_msgs/msg/Float64`.
    pub(super) fn environment(&mut self, sample: ReceivedPayload) {
        let decided = sample.ok().and_then(|payload| {
            let bytes = *payload.body.first_chunk()?;
            let is_big = payload.big_endian;
            Some(if is_big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
        });
        let (kind, greatest) = (Kind::Deadline, self.greatest_deadline);
        let deadline = decided.and_then(|seconds| kind.time(&Value::Double(seconds), greatest));
        if let Some(deadline) = deadline {
            self.deadline = deadline;
        } else {
            warn!(?decided, "a deadline is ignored; give {}", kind.expected(greatest));
        }
    }

    /// Takes the vehicle's speed.
    pub(super) fn take_speed(&mut self, sample: ReceivedPayload) {
        let Some(speed) = &mut self.speed else { return };
        if !sample.is_ok_and(|payload| speed.take(Instant::now(), &payload)) {
            debug!("a speed cannot be read, so the speed counts as unknown");
        }
    }

    /// Applies a parameter that the user set.
    pub(super) fn change(&mut self, change: Change) {
        info!(?change, "a parameter was set");
        match change {
            Change::Deadline(deadline) => self.deadline = deadline,
            Change::LocalDeadline(deadline) => self.sources[LOCAL].deadline = Some(deadline),
            Change::CloudDeadline(cloud, deadline) => {
                self.sources[LOCAL + 1 + cloud].deadline = deadline;
            }
            Change::CloudEnabled(cloud, enabled) => {
                self.sources[LOCAL + 1 + cloud].enabled = enabled;
            }
            // ROS itself applies this, because it stamps what the node publishes.
            Change::SimTime(_) => {}
        }
    }

    pub(crate) fn report(&mut self) {
        let LoopState { intake, reporter, .. } = &mut self.memory;
        // This warns once a period, because a camera that sets no stamp would fill the log.
        if let Some(why) = reporter.unread(*intake) {
            warn!("{why}");
        }
        let ends: Vec<&Endpoint> = self.ends.iter().map(|end| &**end).collect();
        let blind = self.speed.as_ref().and_then(|speed| speed.missing(Instant::now()));
        let statuses = reporter.period(self.counting.tally(), *intake, &self.sources, &ends, blind);
        self.status_publisher.diagnostics(statuses);
    }
}

/// Returns the value that a channel has. A channel that has ended is pending forever.
pub(super) fn known<T>(received: Poll<Option<T>>) -> Poll<T> {
    match received {
        Poll::Ready(Some(received)) => Poll::Ready(received),
        Poll::Ready(None) | Poll::Pending => Poll::Pending,
    }
}
