//! Ends of topics over DDS: serialized messages in and out.

mod census;
mod node;
mod rejoin;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use fuseline_engine::lock;
use futures_util::stream::{once, select_all};
use futures_util::{StreamExt, pin_mut};
use rustdds::dds::statusevents::{DataReaderStatus, DataWriterStatus, StatusEvented};
use rustdds::dds::{CreateResult, WriteError};
use rustdds::discovery::SubscriptionBuiltinTopicData;
use rustdds::no_key::{DataWriter, DeserializedCacheChange, SimpleDataReader};
use rustdds::policy::{Deadline, Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DomainParticipant, Duration, GUID, QosPolicies, QosPolicyBuilder, Timestamp, Topic, TopicKind,
};
use tokio::time::{Instant, timeout};
use tracing::warn;

pub(crate) use self::node::RosNode;
pub(crate) use self::rejoin::Domain;
use self::rejoin::{
    DomainHandle, InUse, JoinedParticipant, NewEntity, OpenSubscription, PATIENCE, RecentIds,
    until_met,
};
use super::end::{Endpoint, dds_type};
use super::{DecodeError, Publish, ReceivedPayload};
use crate::error::NodeError;
use crate::raw::{Cdr, Payload};
use crate::settings::Qos;

/// A reliable publisher keeps at most this many samples for subscribers that have not acknowledged
/// them. Once it keeps that many, it writes no more.
///
/// A subscriber that was killed acknowledges nothing until its lease ends, 10 s or 20 s in other
/// implementations, and the others must not wait for it: this is half a minute at 30 Hz.
const UNACKNOWLEDGED: i32 = 1024;

/// The deadline that publishers offer: five times as long as `rustdds` waits between two repairs of
/// 8 KiB each. With the default of `rustdds`, an image with lost datagrams holds up its topic for
/// ten seconds and more. Nothing watches it, and it suits any deadline that a subscriber requests.
const REPAIRS: Deadline = Deadline(Duration::from_millis(5));

/// The time from one check of the participant's event loop to the next.
const LOOK: std::time::Duration = std::time::Duration::from_secs(1);

/// At most this many samples of a topic are remembered, so that a sample that came to two
/// participants is taken once. That covers about a second, and the history that a transient-local
/// publisher sends again.
const REMEMBERED: usize = 1024;

/// A publisher of serialized messages.
pub(crate) struct SerializedPublisher {
    writer: Arc<InUse<SharedWriter>>,
    stamper: Stamper,
    end: Arc<Endpoint>,
}

type SharedWriter = Arc<DataWriter<Payload, Cdr>>;

/// A subscription, whichever participant its samples come to.
struct SampleHandler<T> {
    take: T,
    recent: Mutex<RecentIds<(GUID, i64)>>,
}

/// A message about a subscription that is not a sample.
enum Notice {
    Closed,
    Status(DataReaderStatus),
}

/// One writer's source timestamps: the time of day, but never going back.
///
/// DDS refuses a time before the last sample's, and Fast DDS drops such a sample from a full
/// history; but clocks are set back.
#[derive(Debug, Default)]
struct Stamper(AtomicU64);

impl DomainHandle {
    /// Publishes on a topic.
    pub(crate) fn publisher(
        &self,
        topic: &str,
        ty: &str,
        qos: Qos,
    ) -> Result<SerializedPublisher, NodeError> {
        let limits = ResourceLimits {
            max_samples: UNACKNOWLEDGED,
            max_instances: 1,
            max_samples_per_instance: UNACKNOWLEDGED,
        };
        let policies = policies(qos).resource_limits(limits).deadline(REPAIRS).build();
        let (end, writer) = (Arc::new(Endpoint::new(topic, ty)), Arc::new(InUse::default()));
        let publisher = SerializedPublisher {
            writer: Arc::clone(&writer),
            stamper: Stamper::default(),
            end: Arc::clone(&end),
        };
        let (topic, ty) = (topic.to_owned(), ty.to_owned());
        self.create(move |joined| {
            let dds = joined.topic(&topic, &ty, &policies)?;
            let next = joined.publisher.create_datawriter_no_key(&dds, Some(policies.clone()))?;
            let (next, next_end) = (SharedWriter::new(next), Arc::new(end.in_new_participant()));
            joined.census.add(Arc::clone(&next_end));
            let (watched, its_end) = (Arc::clone(&next), Arc::clone(&next_end));
            let (participant, loss) = (joined.participant.clone(), Arc::clone(&joined.loss));
            joined.tasks.spawn(async move {
                let statuses = watched.as_async_status_stream();
                pin_mut!(statuses);
                loop {
                    match timeout(LOOK, statuses.next()).await {
                        Ok(Some(status)) => its_end.of_writer(&status, &participant),
                        // The participant's event loop held the other end.
                        Ok(None) => return loss.report(),
                        // An end does not wake us, so the stream is polled again.
                        Err(_) => {}
                    }
                }
            });
            let (writer, topic, met) = (Arc::clone(&writer), topic.clone(), Arc::clone(&next));
            let entity = Arc::clone(&end).replaced_by(next_end, move || {
                let replaced = writer.replace(next);
                async move {
                    let Some(writer) = replaced else { return };
                    let acknowledged = writer.async_wait_for_acknowledgments();
                    if timeout(PATIENCE, acknowledged).await.is_err() {
                        warn!(
                            topic,
                            "subscribers have not acknowledged everything that the former \
                             participant sent"
                        );
                    }
                }
            });
            Ok(entity.met_by(move || {
                let writer = Arc::clone(&met);
                async move { until_met(&writer, qos).await }
            }))
        })?;
        Ok(publisher)
    }

    /// Subscribes to a topic; `take` gets each message, in its publisher's order.
    pub(crate) fn subscribe<F>(
        &self,
        topic: &str,
        ty: &str,
        qos: Qos,
        take: impl Fn(ReceivedPayload) -> F + Send + Sync + 'static,
    ) -> Result<Arc<Endpoint>, NodeError>
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let recent = Mutex::new(RecentIds::new(REMEMBERED.max(qos.depth.into())));
        let (policies, in_use) = (policies(qos).build(), Arc::new(InUse::default()));
        let (end, handler) =
            (Arc::new(Endpoint::new(topic, ty)), Arc::new(SampleHandler { take, recent }));
        let (current_end, topic, ty) = (Arc::clone(&end), topic.to_owned(), ty.to_owned());
        self.create(move |joined| {
            let dds = joined.topic(&topic, &ty, &policies)?;
            let subscriber = &joined.subscriber;
            let reader =
                subscriber.create_simple_datareader_no_key(&dds, Some(policies.clone()))?;
            let next_end = Arc::new(current_end.in_new_participant());
            let (next, closed) = OpenSubscription::new(Arc::clone(&next_end));
            let serving = Arc::clone(&handler).serve(
                reader,
                Arc::clone(&next_end),
                joined.participant.clone(),
                joined.closed_or(closed),
            );
            joined.readers.spawn(serving);
            let (in_use, following) = (Arc::clone(&in_use), Arc::clone(&next_end));
            Ok(Arc::clone(&current_end).replaced_by(next_end, move || {
                let replaced: Option<OpenSubscription> = in_use.replace(next);
                async move {
                    // Over best effort the first one receives nothing that the second one does not.
                    if let Some(former) = replaced.filter(|_| qos.reliable) {
                        drop(timeout(PATIENCE, former.until_followed_by(&following)).await);
                    }
                }
            }))
        })?;
        Ok(end)
    }
}

impl JoinedParticipant {
    fn topic(&self, topic: &str, ty: &str, qos: &QosPolicies) -> CreateResult<Topic> {
        self.participant.create_topic(format!("rt{topic}"), dds_type(ty), qos, TopicKind::NoKey)
    }
}

impl<T, F> SampleHandler<T>
where
    T: Fn(ReceivedPayload) -> F + Send + Sync + 'static,
    F: Future<Output = ()> + Send + 'static,
{
    /// Takes what comes to one participant until that is closed.
    async fn serve(
        self: Arc<Self>,
        reader: SimpleDataReader<Payload, Cdr>,
        end: Arc<Endpoint>,
        participant: DomainParticipant,
        closed: impl Future<Output = ()> + Send,
    ) {
        let closed = once(closed).map(|()| Notice::Closed);
        let statuses = reader.as_async_status_stream().map(Notice::Status);
        // Before each sample this polls only what was woken.
        let mut notices = select_all([closed.boxed(), statuses.boxed()]);
        let samples = reader.as_async_stream();
        pin_mut!(samples);
        loop {
            tokio::select! {
                biased;
                Some(notice) = notices.next() => match notice {
                    Notice::Closed => break,
                    Notice::Status(status) => end.of_reader(&status, &participant),
                },
                sample = samples.next() => match sample {
                    Some(Ok(sample)) if end.is_strange(sample.writer_guid().to_bytes()) => {}
                    Some(sample) => {
                        let id = sample.as_ref().ok().map(identity);
                        if id.is_none_or(|id| lock(&self.recent).insert(id)) {
                            end.received(Instant::now());
                            let sample = sample.map(DeserializedCacheChange::into_value);
                            let payload = sample.map_err(|error| DecodeError(error.to_string()));
                            (self.take)(payload).await;
                        }
                        if let Some((publisher, number)) = id {
                            end.note(publisher.to_bytes(), number);
                        }
                    }
                    None => break,
                },
            }
        }
    }
}

/// A sample's publisher and number.
fn identity(sample: &DeserializedCacheChange<Payload>) -> (GUID, i64) {
    (sample.writer_guid(), i64::from(sample.sequence_number))
}

impl Publish for SerializedPublisher {
    fn publish(&self, payload: Payload) -> bool {
        let stamp = self.stamper.stamp(Timestamp::now());
        match self.writer.with(|writer| writer.write(payload, Some(stamp))) {
            Some(Ok(())) => true,
            Some(Err(WriteError::WouldBlock { .. })) | None => false,
            Some(Err(error)) => {
                warn!(topic = self.end.topic, %error, "a message is not published");
                false
            }
        }
    }

    fn end(&self) -> &Arc<Endpoint> {
        &self.end
    }
}

impl Stamper {
    fn stamp(&self, now: Timestamp) -> Timestamp {
        let now = now.to_ticks();
        Timestamp::from_ticks(now.max(self.0.fetch_max(now, Ordering::Relaxed)))
    }
}

impl Endpoint {
    /// An endpoint in another participant, which replaces this end's once it has met the same
    /// peers.
    fn replaced_by<F>(
        self: Arc<Self>,
        next: Arc<Self>,
        take_over: impl FnOnce() -> F + Send + 'static,
    ) -> NewEntity
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let (current, its_next) = (Arc::clone(&self), Arc::clone(&next));
        let entity = NewEntity::draining(move || {
            current.use_peers_of(&its_next);
            take_over()
        });
        entity.once(move || next.has_all_peers_of(&self))
    }

    fn of_writer(&self, status: &DataWriterStatus, participant: &DomainParticipant) {
        match status {
            DataWriterStatus::PublicationMatched { current, reader, .. } => {
                let readers = participant.discovered_readers();
                let mut topics = readers.iter().map(|reader| &reader.subscription_topic_data);
                let ty = topics.find(|topic| topic.key() == *reader);
                self.change(
                    reader.to_bytes(),
                    current.count_change(),
                    ty.map(SubscriptionBuiltinTopicData::type_name),
                );
            }
            DataWriterStatus::OfferedIncompatibleQos { count, last_policy_id, .. } => {
                self.refuse(count.count(), format!("{last_policy_id:?}"));
            }
            DataWriterStatus::LivelinessLost { .. }
            | DataWriterStatus::OfferedDeadlineMissed { .. } => {}
        }
    }

    fn of_reader(&self, status: &DataReaderStatus, participant: &DomainParticipant) {
        match status {
            DataReaderStatus::SubscriptionMatched { current, writer, .. } => {
                let writers = participant.discovered_writers();
                let mut topics = writers.iter().map(|writer| &writer.publication_topic_data);
                let ty = topics.find(|topic| topic.key == *writer);
                self.change(
                    writer.to_bytes(),
                    current.count_change(),
                    ty.map(|topic| &topic.type_name),
                );
            }
            DataReaderStatus::RequestedIncompatibleQos { count, last_policy_id, .. } => {
                self.refuse(count.count(), format!("{last_policy_id:?}"));
            }
            DataReaderStatus::SampleRejected { .. }
            | DataReaderStatus::LivelinessChanged { .. }
            | DataReaderStatus::RequestedDeadlineMissed { .. }
            | DataReaderStatus::SampleLost { .. } => {}
        }
    }
}

fn policies(qos: Qos) -> QosPolicyBuilder {
    let reliability = if qos.reliable {
        Reliability::Reliable { max_blocking_time: Duration::ZERO }
    } else {
        Reliability::BestEffort
    };
    let durability =
        if qos.transient_local { Durability::TransientLocal } else { Durability::Volatile };
    QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(durability)
        .history(History::KeepLast { depth: qos.depth.into() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D13.
    #[test]
    fn source_timestamps_follow_the_time_of_day_but_never_go_back() {
        let stamper = Stamper::default();
        let stamps = [5, 9, 3, 8, 9, 10].map(|ticks| stamper.stamp(Timestamp::from_ticks(ticks)));
        assert_eq!(stamps.map(Timestamp::to_ticks), [5, 9, 9, 9, 9, 10]);
    }
}
