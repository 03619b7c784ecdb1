//! Ends of topics over DDS: serialized messages in and out.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use futures_util::{StreamExt, pin_mut};
use rustdds::dds::statusevents::{DataReaderStatus, DataWriterStatus, StatusEvented};
use rustdds::dds::{CreateResult, WriteError};
use rustdds::discovery::SubscriptionBuiltinTopicData;
use rustdds::no_key::{DataWriter, DeserializedCacheChange, SimpleDataReader};
use rustdds::policy::{Deadline, Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, Duration, Publisher, QosPolicies,
    QosPolicyBuilder, Subscriber, Timestamp, Topic, TopicKind,
};
use tokio::task::JoinSet;
use tokio::time::Instant;
use tracing::warn;

use super::end::{End, dds_type};
use super::{Publish, Sample, Unread};
use crate::raw::{Cdr, Payload};
use crate::settings::Qos;

/// How many samples a reliable publisher keeps for subscribers that have not acknowledged them; when
/// it keeps that many, it writes no more.
///
/// A subscriber that was killed acknowledges nothing until its lease ends, 10 s or 20 s in other
/// implementations, and the others must not wait for it: this is half a minute at 30 Hz.
const UNACKNOWLEDGED: i32 = 1024;

/// The deadline that publishers offer: five times as long as `rustdds` waits between two repairs of
/// 8 KiB each. With the default of `rustdds`, an image with lost datagrams holds up its topic for
/// ten seconds and more. Nothing watches it, and it suits any deadline that a subscriber requests.
const REPAIRS: Deadline = Deadline(Duration::from_millis(5));

/// The node in its domain.
pub(crate) struct Domain {
    pub(crate) participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    /// The tasks that serve the endpoints; they end with this.
    tasks: JoinSet<()>,
}

/// A publisher of serialized messages.
pub(crate) struct Outlet {
    writer: Arc<DataWriter<Payload, Cdr>>,
    stamper: Stamper,
    end: Arc<End>,
}

/// One writer's source timestamps: the time of day, but never going back.
///
/// DDS refuses a time before the last sample's, and Fast DDS drops such a sample from a full
/// history; but clocks are set back.
#[derive(Debug, Default)]
struct Stamper(AtomicU64);

impl Domain {
    /// Joins the domain.
    pub(crate) fn join(domain: u16, localhost_only: bool) -> CreateResult<Self> {
        let mut builder = DomainParticipantBuilder::new(domain);
        if localhost_only {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder.build()?;
        let none = QosPolicies::qos_none();
        let publisher = participant.create_publisher(&none)?;
        let subscriber = participant.create_subscriber(&none)?;
        Ok(Self { participant, publisher, subscriber, tasks: JoinSet::new() })
    }

    /// Leaves the domain: readers and writers end before their participant does.
    pub(crate) async fn leave(mut self) {
        self.tasks.shutdown().await;
    }

    /// Publishes on a topic.
    pub(crate) fn outlet(&mut self, topic: &str, ty: &str, qos: Qos) -> CreateResult<Outlet> {
        let limits = ResourceLimits {
            max_samples: UNACKNOWLEDGED,
            max_instances: 1,
            max_samples_per_instance: UNACKNOWLEDGED,
        };
        let qos = policies(qos).resource_limits(limits).deadline(REPAIRS).build();
        let dds = self.topic(topic, ty, &qos)?;
        let writer = self.publisher.create_datawriter_no_key::<Payload, Cdr>(&dds, Some(qos))?;
        let (writer, end) = (Arc::new(writer), Arc::new(End::new(topic, ty)));
        let (watched, seen) = (Arc::clone(&writer), Arc::clone(&end));
        let participant = self.participant.clone();
        self.tasks.spawn(async move {
            let statuses = watched.as_async_status_stream();
            pin_mut!(statuses);
            while let Some(status) = statuses.next().await {
                seen.of_writer(&status, &participant);
            }
        });
        Ok(Outlet { writer, stamper: Stamper::default(), end })
    }

    /// Subscribes to a topic; `take` gets each message, in its publisher's order.
    pub(crate) fn inlet<F>(
        &mut self,
        topic: &str,
        ty: &str,
        qos: Qos,
        take: impl Fn(Sample) -> F + Send + 'static,
    ) -> CreateResult<Arc<End>>
    where
        F: Future<Output = ()> + Send,
    {
        let qos = policies(qos).build();
        let dds = self.topic(topic, ty, &qos)?;
        let reader: SimpleDataReader<Payload, Cdr> =
            self.subscriber.create_simple_datareader_no_key(&dds, Some(qos))?;
        let end = Arc::new(End::new(topic, ty));
        let (seen, participant) = (Arc::clone(&end), self.participant.clone());
        self.tasks.spawn(async move {
            let (samples, statuses) = (reader.as_async_stream(), reader.as_async_status_stream());
            pin_mut!(samples, statuses);
            loop {
                tokio::select! {
                    biased;
                    Some(status) = statuses.next() => seen.of_reader(&status, &participant),
                    sample = samples.next() => match sample {
                        Some(Ok(sample)) if seen.is_strange(sample.writer_guid().to_bytes()) => {}
                        Some(sample) => {
                            seen.heard(Instant::now());
                            let sample = sample.map(DeserializedCacheChange::into_value);
                            take(sample.map_err(|error| Unread(error.to_string()))).await;
                        }
                        None => break,
                    },
                }
            }
        });
        Ok(end)
    }

    fn topic(&self, topic: &str, ty: &str, qos: &QosPolicies) -> CreateResult<Topic> {
        self.participant.create_topic(format!("rt{topic}"), dds_type(ty), qos, TopicKind::NoKey)
    }
}

impl Publish for Outlet {
    fn publish(&self, payload: Payload) -> bool {
        match self.writer.write(payload, Some(self.stamper.stamp(Timestamp::now()))) {
            Ok(()) => true,
            Err(WriteError::WouldBlock { .. }) => false,
            Err(error) => {
                warn!(topic = self.end.topic, %error, "not published");
                false
            }
        }
    }

    fn end(&self) -> &Arc<End> {
        &self.end
    }
}

impl Stamper {
    fn stamp(&self, now: Timestamp) -> Timestamp {
        let now = now.to_ticks();
        Timestamp::from_ticks(now.max(self.0.fetch_max(now, Ordering::Relaxed)))
    }
}

impl End {
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
