//! The node's ends of topics: serialized messages in and out, and the peers at the other end.

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
    pub(crate) end: Arc<End>,
}

/// One writer's source timestamps: the time of day, but never going back.
///
/// DDS refuses a time before the last sample's, and Fast DDS drops such a sample from a full
/// history; but clocks are set back.
#[derive(Debug, Default)]
struct Stamper(AtomicU64);

/// The node's end of a topic, and its peers.
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
    /// Peers with messages of another type, which `rustdds` does not check.
    strangers: BTreeMap<GUID, String>,
    incompatible: Option<Incompatible>,
}

/// Peers whose quality of service does not fit.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Incompatible {
    pub(crate) count: i32,
    /// The policy in which the last of them differs.
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
    /// Publishes without waiting; false if it cannot, as a reliable subscriber is too far behind.
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

    /// Sets how long counts as silence; none leaves it to the gaps between messages.
    pub(crate) fn patience(&self, patience: Option<std::time::Duration>) {
        *self.rhythm() = Rhythm::new(patience);
    }

    /// A message came.
    pub(crate) fn heard(&self, now: Instant) {
        self.rhythm().beat(now);
    }

    /// How long nothing has come, if that is too long and a publisher is there.
    pub(crate) fn silence(&self) -> Option<std::time::Duration> {
        if self.matched() == 0 { None } else { self.rhythm().silence(Instant::now()) }
    }

    /// How many peers there are.
    pub(crate) fn matched(&self) -> usize {
        self.peers().matched.len()
    }

    /// The peers found whose quality of service does not fit.
    pub(crate) fn incompatible(&self) -> Option<Incompatible> {
        self.peers().incompatible.clone()
    }

    /// The message type of a peer that has another one, if there is such a peer.
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

    /// Changes are made whole, so even a poisoned lock holds a sound state.
    fn peers(&self) -> MutexGuard<'_, Peers> {
        self.peers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn rhythm(&self) -> MutexGuard<'_, Rhythm> {
        self.rhythm.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A message type's name in DDS: `pkg/msg/Type` is `pkg::msg::dds_::Type_`.
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
