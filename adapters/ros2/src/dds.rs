//! The node's ends of topics: serialized messages in and out, and who is at the other end.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use futures_util::{StreamExt, pin_mut};
use rustdds::dds::statusevents::{DataReaderStatus, DataWriterStatus, StatusEvented};
use rustdds::dds::{CreateResult, ReadError, WriteError};
use rustdds::discovery::SubscriptionBuiltinTopicData;
use rustdds::no_key::{DataWriter, DeserializedCacheChange, SimpleDataReader};
use rustdds::policy::{Deadline, Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, Duration, GUID, Publisher, QosPolicies,
    QosPolicyBuilder, Subscriber, Timestamp, Topic, TopicKind,
};
use tokio::task::JoinSet;
use tokio::time::Instant;
use tracing::{info, warn};

use crate::raw::{Cdr, Payload};
use crate::rhythm::Rhythm;
use crate::settings::Qos;

/// How many samples a reliable publisher keeps for subscribers that have not acknowledged them; with
/// so many, none is written.
///
/// One that was killed acknowledges nothing until its lease ends, 10 s or 20 s by the habit of other
/// implementations, and the others must not wait for it: this is half a minute at 30 Hz.
const UNACKNOWLEDGED: i32 = 1024;

/// The deadline that publishers offer, five times as long as `rustdds` waits between two repairs of
/// 8 KiB each: with its own choice an image of which some datagrams were lost holds up its topic for
/// ten seconds and more. Nothing watches it, and it fits whatever deadline a subscriber requests.
const REPAIRS: Deadline = Deadline(Duration::from_millis(5));

/// The node in its domain.
pub(crate) struct Domain {
    pub(crate) participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    /// What looks at the endpoints; ends with this.
    tasks: JoinSet<()>,
}

/// A publisher of serialized messages.
pub(crate) struct Outlet {
    writer: Arc<DataWriter<Payload, Cdr>>,
    stamper: Stamper,
    pub(crate) end: Arc<End>,
}

/// The source timestamps of one writer: the time of day that never goes back.
///
/// DDS refuses a time before that of the last sample, and Fast DDS drops such a sample from a history
/// that is full; but the time of day is set back.
#[derive(Debug, Default)]
struct Stamper(AtomicU64);

/// Who is at the other end of a topic.
#[derive(Debug)]
pub(crate) struct End {
    pub(crate) topic: String,
    /// The type's name in DDS.
    type_name: String,
    peers: Mutex<Peers>,
    rhythm: Mutex<Rhythm>,
}

#[derive(Default, Debug)]
struct Peers {
    matched: BTreeSet<GUID>,
    /// Those with messages of another type, which `rustdds` does not look at.
    strangers: BTreeMap<GUID, String>,
    incompatible: Option<Incompatible>,
}

/// Peers of the topic that want or offer another quality of service.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Incompatible {
    pub(crate) count: i32,
    /// What the last of them differs in.
    pub(crate) policy: String,
}

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

    /// Leaves it: readers and writers end before their participant does.
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

    /// Subscribes to a topic; `take` gets each message, in the order of its publisher.
    pub(crate) fn inlet<F>(
        &mut self,
        topic: &str,
        ty: &str,
        qos: Qos,
        take: impl Fn(Result<Payload, ReadError>) -> F + Send + 'static,
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
                        Some(Ok(sample)) if seen.is_strange(sample.writer_guid()) => {}
                        Some(sample) => {
                            seen.heard(Instant::now());
                            take(sample.map(DeserializedCacheChange::into_value)).await;
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

impl Outlet {
    /// Publishes without waiting. False if that cannot be: a reliable subscriber is too far behind.
    pub(crate) fn publish(&self, payload: Payload) -> bool {
        match self.writer.write(payload, Some(self.stamper.stamp(Timestamp::now()))) {
            Ok(()) => true,
            Err(WriteError::WouldBlock { .. }) => false,
            Err(error) => {
                warn!(topic = self.end.topic, %error, "not published");
                false
            }
        }
    }
}

impl Stamper {
    fn stamp(&self, now: Timestamp) -> Timestamp {
        let now = now.to_ticks();
        Timestamp::from_ticks(now.max(self.0.fetch_max(now, Ordering::Relaxed)))
    }
}

impl End {
    pub(crate) fn new(topic: &str, ty: &str) -> Self {
        let (peers, rhythm) = (Mutex::default(), Mutex::default());
        Self { topic: topic.into(), type_name: dds_type(ty), peers, rhythm }
    }

    /// Says what is silence; none is for the gaps between messages to say.
    pub(crate) fn patience(&self, patience: Option<std::time::Duration>) {
        *self.rhythm() = Rhythm::new(patience);
    }

    /// A message came.
    pub(crate) fn heard(&self, now: Instant) {
        self.rhythm().beat(now);
    }

    /// How long nothing came, if that is too long with a publisher there.
    pub(crate) fn silence(&self) -> Option<std::time::Duration> {
        if self.matched() == 0 { None } else { self.rhythm().silence(Instant::now()) }
    }

    /// How many there are.
    pub(crate) fn matched(&self) -> usize {
        self.peers().matched.len()
    }

    /// Those that were met and want or offer another quality of service.
    pub(crate) fn incompatible(&self) -> Option<Incompatible> {
        self.peers().incompatible.clone()
    }

    /// The type of one whose messages are of another, if there is one.
    pub(crate) fn other_type(&self) -> Option<String> {
        self.peers().strangers.values().next().cloned()
    }

    fn is_strange(&self, peer: GUID) -> bool {
        self.peers().strangers.contains_key(&peer)
    }

    fn of_writer(&self, status: &DataWriterStatus, participant: &DomainParticipant) {
        match status {
            DataWriterStatus::PublicationMatched { current, reader, .. } => {
                let readers = participant.discovered_readers();
                let mut topics = readers.iter().map(|reader| &reader.subscription_topic_data);
                let ty = topics.find(|topic| topic.key() == *reader);
                self.change(
                    *reader,
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
                self.change(*writer, current.count_change(), ty.map(|topic| &topic.type_name));
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

    /// A peer came or left.
    pub(crate) fn change(&self, peer: GUID, by: i32, type_name: Option<&String>) {
        let mut peers = self.peers();
        if by <= 0 {
            peers.strangers.remove(&peer);
            if peers.matched.remove(&peer) {
                info!(topic = self.topic, peers = peers.matched.len(), "a peer left");
            }
        } else if let Some(other) = type_name.filter(|name| **name != self.type_name) {
            warn!(topic = self.topic, ours = self.type_name, other, "a peer has another type");
            peers.strangers.insert(peer, other.clone());
        } else if peers.matched.insert(peer) {
            info!(topic = self.topic, peers = peers.matched.len(), "a peer came");
            self.rhythm().rest(Instant::now());
        }
    }

    fn refuse(&self, count: i32, policy: String) {
        warn!(topic = self.topic, policy, "a peer's quality of service does not fit");
        self.peers().incompatible = Some(Incompatible { count, policy });
    }

    /// What is changed is changed whole, so that a poisoned lock holds nothing strange.
    fn peers(&self) -> MutexGuard<'_, Peers> {
        self.peers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn rhythm(&self) -> MutexGuard<'_, Rhythm> {
        self.rhythm.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The name that a message type has in DDS: `pkg/msg/Type` is `pkg::msg::dds_::Type_`.
fn dds_type(ty: &str) -> String {
    match ty.rsplit_once('/') {
        Some((package, name)) => format!("{}::dds_::{name}_", package.replace('/', "::")),
        None => ty.into(),
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

    /// D14.
    #[test]
    fn a_peer_with_another_type_is_no_peer_until_it_leaves() {
        let (end, peer) = (End::new("/input", "a_msgs/msg/A"), GUID::GUID_UNKNOWN);
        let other = "b_msgs::msg::dds_::B_".to_owned();
        end.change(peer, 1, Some(&other));
        assert_eq!((end.matched(), end.other_type(), end.is_strange(peer)), (0, Some(other), true));
        end.change(peer, -1, None);
        assert_eq!((end.matched(), end.other_type(), end.is_strange(peer)), (0, None, false));
        end.change(peer, 1, Some(&"a_msgs::msg::dds_::A_".to_owned()));
        assert_eq!((end.matched(), end.other_type(), end.is_strange(peer)), (1, None, false));
        end.change(peer, -1, None);
        assert_eq!(end.matched(), 0);
    }

    #[test]
    fn names_of_types_are_those_of_dds() {
        assert_eq!(dds_type("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
    }
}
