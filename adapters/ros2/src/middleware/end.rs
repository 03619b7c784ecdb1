//! The node's end of a topic, and the peers at the other end.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard};

use fuseline_engine::lock;
use tokio::time::Instant;
use tracing::{info, warn};

use crate::silence_detector::SilenceDetector;

/// The identifier of an endpoint, as ROS has it.
pub(crate) type Gid = [u8; 16];

/// The node's end of a topic, and its peers.
#[derive(Debug)]
pub(crate) struct Endpoint {
    pub(crate) topic: String,
    /// The type's name in DDS.
    type_name: String,
    /// The peers of the endpoint in use. After a rejoin over DDS, that is another endpoint.
    peers: Mutex<SharedPeers>,
    silence_detector: Arc<Mutex<SilenceDetector>>,
}

type SharedPeers = Arc<Mutex<Peers>>;

#[derive(Default, Debug)]
struct Peers {
    /// With the numbers of their messages that came.
    matched: BTreeMap<Gid, Option<Numbers>>,
    /// Peers with messages of another type, which no middleware checks.
    strangers: BTreeMap<Gid, String>,
    incompatible: Option<Incompatible>,
    /// Others that publish on the topic, where the node does.
    rivals: BTreeSet<Gid>,
}

#[derive(Clone, Copy, Debug)]
struct Numbers {
    first: i64,
    last: i64,
}

/// Peers whose quality of service does not fit.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Incompatible {
    pub(crate) count: i32,
    /// The policy in which the last of them differs.
    pub(crate) policy: String,
}

impl Endpoint {
    pub(crate) fn new(topic: &str, ty: &str) -> Self {
        let (peers, silence_detector) = (Mutex::default(), Arc::default());
        Self { topic: topic.into(), type_name: dds_type(ty), peers, silence_detector }
    }

    /// Creates the topic's endpoint in another participant, which has met nobody yet.
    pub(super) fn in_new_participant(&self) -> Self {
        let (topic, type_name) = (self.topic.clone(), self.type_name.clone());
        Self {
            topic,
            type_name,
            peers: Mutex::default(),
            silence_detector: Arc::clone(&self.silence_detector),
        }
    }

    /// Returns `true` if it has met all peers that the other end has.
    pub(super) fn has_all_peers_of(&self, other: &Self) -> bool {
        let others = other.peers(|peers| peers.matched.clone());
        self.peers(|peers| others.keys().all(|peer| peers.matched.contains_key(peer)))
    }

    /// A message with this number came from a peer, and all before it have come.
    pub(super) fn note(&self, peer: Gid, number: i64) {
        self.peers(|peers| {
            if let Some(numbers) = peers.matched.get_mut(&peer) {
                numbers.get_or_insert(Numbers { first: number, last: number }).last = number;
            }
        });
    }

    /// Returns `true` if it gets messages from each peer of the former end, which has got all
    /// before, and if it keeps up with the former end. Over DDS, a new subscription can stand still
    /// for ten seconds after its first messages: `rustdds` assembles at most 128 fragmented
    /// messages at a time, among them messages that a publisher sends again although they came.
    pub(super) fn follows(&self, former: &Self) -> bool {
        let formers = former.peers(|peers| peers.matched.clone());
        self.peers(|peers| {
            formers.iter().all(|(peer, former)| {
                let next = peers.matched.get(peer).copied().flatten();
                next.zip(*former).is_some_and(|(next, former)| {
                    next.first <= former.last + 1 && next.last >= former.last
                })
            })
        })
    }

    /// Takes over the peers of the other endpoint.
    pub(super) fn use_peers_of(&self, other: &Self) {
        let peers = Arc::clone(&lock(&other.peers));
        *lock(&self.peers) = peers;
    }

    /// Sets how long counts as silence; none leaves it to the gaps between messages.
    pub(crate) fn patience(&self, patience: Option<std::time::Duration>) {
        *self.silence_detector() = SilenceDetector::new(patience);
    }

    /// Notes that a message came.
    pub(crate) fn received(&self, now: Instant) {
        self.silence_detector().beat(now);
    }

    /// Notes that messages are expected from now on; `patience` is as in
    /// [`patience`](Self::patience).
    pub(crate) fn expect(&self, patience: Option<std::time::Duration>) {
        *self.silence_detector() = SilenceDetector::expecting(patience, Instant::now());
    }

    /// Returns the time since the last message, if that is too long.
    pub(crate) fn silence(&self) -> Option<std::time::Duration> {
        self.silence_detector().silence(Instant::now())
    }

    /// Returns the time since the wait for the first message began, if that is too long.
    pub(crate) fn absence(&self) -> Option<std::time::Duration> {
        self.silence_detector().absence(Instant::now())
    }

    /// Returns the number of peers.
    pub(crate) fn matched(&self) -> usize {
        self.peers(|peers| peers.matched.len())
    }

    /// Returns the peers found whose quality of service does not fit.
    pub(crate) fn incompatible(&self) -> Option<Incompatible> {
        self.peers(|peers| peers.incompatible.clone())
    }

    /// Returns the message type of a peer whose type differs from the node's, if there is one.
    pub(crate) fn other_type(&self) -> Option<String> {
        self.peers(|peers| peers.strangers.values().next().cloned())
    }

    /// Returns the number of other publishers of a topic on which the node publishes.
    pub(crate) fn rivals(&self) -> usize {
        self.peers(|peers| peers.rivals.len())
    }

    /// Sets the others that now publish on the topic.
    pub(crate) fn set_rivals(&self, rivals: BTreeSet<Gid>) {
        let others = rivals.len();
        let is_new = self.peers(|peers| {
            let is_new = !rivals.is_subset(&peers.rivals);
            peers.rivals = rivals;
            is_new
        });
        if is_new {
            warn!(topic = self.topic, others, "another node also publishes on this topic");
        }
    }

    /// Notes that another publisher of the topic came or left.
    #[cfg(feature = "zenoh")]
    pub(super) fn rival(&self, other: Gid, is_there: bool) {
        let mut rivals = self.peers(|peers| peers.rivals.clone());
        if is_there {
            rivals.insert(other);
        } else {
            rivals.remove(&other);
        }
        self.set_rivals(rivals);
    }

    pub(super) fn is_strange(&self, peer: Gid) -> bool {
        self.peers(|peers| peers.strangers.contains_key(&peer))
    }

    /// Notes that a peer came or left.
    pub(crate) fn change(&self, peer: Gid, by: i32, type_name: Option<&String>) {
        self.peers(|peers| {
            if by <= 0 {
                peers.strangers.remove(&peer);
                if peers.matched.remove(&peer).is_some() {
                    info!(topic = self.topic, peers = peers.matched.len(), "a peer left");
                }
            } else if let Some(other) = type_name.filter(|name| **name != self.type_name) {
                warn!(topic = self.topic, ours = self.type_name, other, "a peer has another type");
                peers.strangers.insert(peer, other.clone());
            } else if let Entry::Vacant(place) = peers.matched.entry(peer) {
                place.insert(None);
                info!(topic = self.topic, peers = peers.matched.len(), "a peer came");
                self.silence_detector().rest(Instant::now());
            }
        });
    }

    pub(super) fn refuse(&self, count: i32, policy: String) {
        warn!(topic = self.topic, policy, "a peer's quality of service does not fit");
        self.peers(|peers| peers.incompatible = Some(Incompatible { count, policy }));
    }

    fn peers<R>(&self, access: impl FnOnce(&mut Peers) -> R) -> R {
        let peers = Arc::clone(&lock(&self.peers));
        access(&mut lock(&peers))
    }

    fn silence_detector(&self) -> MutexGuard<'_, SilenceDetector> {
        lock(&self.silence_detector)
    }
}

/// Returns a message type's name in DDS: `pkg/msg/Type` is `pkg::msg::dds_::Type_`.
pub(super) fn dds_type(ty: &str) -> String {
    match ty.rsplit_once('/') {
        Some((package, name)) => format!("{}::dds_::{name}_", package.replace('/', "::")),
        None => ty.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D14.
    #[test]
    fn a_peer_with_another_type_is_no_peer_until_it_leaves() {
        let (end, peer) = (Endpoint::new("/input", "a_msgs/msg/A"), [7; 16]);
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

    /// D13.
    #[test]
    fn a_new_participant_meets_the_peers_of_a_topic_before_they_are_taken_from_it() {
        let (end, peer, late) = (Endpoint::new("/input", "a_msgs/msg/A"), [7; 16], [8; 16]);
        end.change(peer, 1, None);
        let next = end.in_new_participant();
        assert!(!next.has_all_peers_of(&end));
        next.change(peer, 1, None);
        assert!(next.has_all_peers_of(&end));
        end.change(late, 1, None);
        assert!(!next.has_all_peers_of(&end));
        assert_eq!((end.matched(), next.matched()), (2, 1));
        end.use_peers_of(&next);
        assert_eq!(end.matched(), 1);
        next.change(peer, -1, None);
        assert_eq!(end.matched(), 0);
    }

    /// D13.
    #[test]
    fn follows_once_nothing_is_missing_between() {
        let (first, peer) = (Endpoint::new("/input", "a_msgs/msg/A"), [7; 16]);
        let second = first.in_new_participant();
        assert!(second.follows(&first), "there is no peer");
        first.change(peer, 1, None);
        second.change(peer, 1, None);
        first.note(peer, 4);
        assert!(!second.follows(&first), "the peer has met the first alone");
        second.note(peer, 6);
        second.note(peer, 7);
        assert!(!second.follows(&first), "the first has yet to get 5");
        first.note(peer, 5);
        assert!(second.follows(&first));
        first.note(peer, 8);
        assert!(!second.follows(&first), "the second stands still");
        second.note(peer, 8);
        assert!(second.follows(&first));
        first.change([8; 16], 1, None);
        assert!(!second.follows(&first), "the other peer may have met the first alone");
        first.change([8; 16], -1, None);
        assert!(second.follows(&first));
    }

    #[test]
    fn names_of_types_are_those_of_dds() {
        assert_eq!(dds_type("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
    }

    /// D15.
    #[tokio::test(start_paused = true)]
    async fn a_publisher_that_comes_again_is_silent_only_once_it_had_time_to_begin() {
        let second = std::time::Duration::from_secs(1);
        let (end, peer) = (Endpoint::new("/input", "a_msgs/msg/A"), [7; 16]);
        end.change(peer, 1, None);
        for _ in 0..2 {
            end.received(Instant::now());
            tokio::time::advance(second).await;
        }
        tokio::time::advance(60 * second).await;
        assert_eq!(end.silence(), Some(61 * second));
        end.change(peer, -1, None);
        assert_eq!(end.silence(), Some(61 * second));
        end.change(peer, 1, None);
        assert_eq!(end.silence(), None);
        tokio::time::advance(11 * second).await;
        // A publisher that was known has not just come.
        end.change(peer, 1, None);
        assert_eq!(end.silence(), Some(11 * second));
        end.patience(Some(20 * second));
        end.received(Instant::now());
        tokio::time::advance(20 * second).await;
        assert_eq!(end.silence(), None);
        tokio::time::advance(second).await;
        assert_eq!(end.silence(), Some(21 * second));
    }
}
