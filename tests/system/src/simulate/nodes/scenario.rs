//! One run of a node as plain data: its parameters, its inputs, and the behaviour of the network
//! and of its peers.

use std::fmt;
use std::path::Path;
use std::time::Duration;

use fuseline_ros2::settings::Change;
use fuseline_ros2::{Commit, Settings, in_process};

/// A run that is drawn from a seed and can be made smaller.
#[derive(Clone, PartialEq, Debug)]
pub struct Scenario {
    pub(crate) window: u16,
    pub(crate) commit: Commit,
    /// The number of further messages that may wait for local.
    pub(crate) waiting: u16,
    /// Local, then the clouds. The priority of a cloud is its index.
    pub(crate) peers: Vec<Peer>,
    /// The inputs, in the order of their instants.
    pub(crate) inputs: Vec<Input>,
    /// The other events, in the order of their instants.
    pub(crate) turns: Vec<(Duration, Disturbance)>,
}

/// Local or a cloud.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Peer {
    pub(crate) in_flight: u16,
    /// The gate's limit. Local has no gate.
    pub(crate) limit: u16,
    /// `true` if it is called, and `false` if it receives by topics as local does.
    pub(crate) is_called: bool,
    /// `true` if its late results are published.
    pub(crate) hints: bool,
}

/// A sample on the input's topic, and its fate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Input {
    pub(crate) at: Duration,
    pub(crate) key: u64,
    pub(crate) form: Form,
    /// `true` if its output finds a subscriber that is too far behind.
    pub(crate) is_unsent: bool,
    /// The fate of the input at each peer that gets a request.
    pub(crate) fates: Vec<Delivery>,
}

/// The form of a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Form {
    Whole,
    /// Shorter than its key.
    Short,
    NotCdr,
}

/// The delivery of a request, and of the results that it leads to.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Delivery {
    /// The time that the request takes to its peer, or `None` if it is lost.
    pub(crate) delay: Option<Duration>,
    /// The time for which the peer computes.
    pub(crate) took: Duration,
    /// The replies. None means that the result is lost, and two mean that it is duplicated.
    pub(crate) replies: Vec<Reply>,
}

/// A reply, and how long it takes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Reply {
    pub(crate) delay: Duration,
    pub(crate) kind: ReplyKind,
}

/// The form of a reply.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ReplyKind {
    Result,
    /// A result whose key belongs to no message.
    Stray,
    Short,
    NotCdr,
}

/// An event that is not an input.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Disturbance {
    /// A parameter is set.
    Set(Change),
    /// The topic of deadlines carries this many seconds.
    Deadline(f64),
    /// The manager of the node's lifecycle activates or deactivates it.
    Activate(bool),
    /// A peer is killed and loses everything that it computes. The node may notice that or not.
    Dies { peer: usize, is_seen: bool },
    /// A peer is back.
    Lives(usize),
    /// The node's process stands still for this long.
    Stalls(Duration),
}

/// The index of local among the peers.
pub(crate) const LOCAL: usize = 0;

/// The number of inputs that come after everything works again.
const CALM: u64 = 20;

/// The time between these inputs. Each peer takes less than half of it.
const APART: Duration = Duration::from_millis(100);

/// The keys of the calm and of strays are greater than all others.
const CALM_KEYS: u64 = 1 << 32;
pub(crate) const STRAY_KEYS: u64 = 1 << 40;

impl Scenario {
    /// Returns the parameters in the form that a node takes.
    fn parameters(&self) -> Vec<String> {
        let mut all = vec![
            "lifecycle:=true".to_owned(),
            format!("window:={}", self.window),
            format!("commit:={}", self.commit),
            format!("local.waiting:={}", self.waiting),
            format!("local.in_flight:={}", self.peers[LOCAL].in_flight),
        ];
        for (index, peer) in self.peers.iter().enumerate().skip(1) {
            all.push(format!("cloud{index}.in_flight:={}", peer.in_flight));
            all.push(format!("cloud{index}.limit:={}", peer.limit));
            if peer.is_called {
                all.push(format!("cloud{index}.grpc.url:=http://localhost:1"));
            }
            if peer.hints {
                all.push(format!("cloud{index}.hints:=late{index}"));
            }
        }
        all
    }

    /// Returns the settings of the node, which records in this file.
    pub(crate) fn settings(&self, trace: &Path) -> Settings {
        let mut parameters = self.parameters();
        parameters.push(format!("trace.file:={}", trace.display()));
        in_process::settings(self.peers.len() - 1, parameters)
    }

    /// Returns when everything works again and no lost message is awaited. The messages that wait
    /// for local may be lost one after the other, which takes a second each.
    pub(crate) fn calm(&self) -> Duration {
        let inputs = self.inputs.iter().map(|input| input.at);
        let last = inputs.chain(self.turns.iter().map(|turn| turn.0)).max().unwrap_or_default();
        last + Duration::from_secs(4 + self.inputs.len() as u64)
    }

    /// Returns the inputs, including the inputs of the calm.
    pub(crate) fn all_inputs(&self) -> Vec<Input> {
        let calm = (0..CALM).map(|number| Input {
            at: self.calm() + APART * u32::try_from(number).unwrap_or(0),
            key: CALM_KEYS + number,
            form: Form::Whole,
            is_unsent: false,
            fates: (0..self.peers.len()).map(Delivery::fair).collect(),
        });
        self.inputs.iter().cloned().chain(calm).collect()
    }

    /// Returns the other events, including the events that make everything work again.
    pub(crate) fn all_turns(&self, settings: &Settings) -> Vec<(Duration, Disturbance)> {
        let set = |change| Disturbance::Set(change);
        let mut last = vec![
            Disturbance::Activate(true),
            set(Change::Deadline(settings.deadline)),
            set(Change::LocalDeadline(settings.local.deadline)),
        ];
        for cloud in 0..self.peers.len() - 1 {
            last.push(set(Change::CloudEnabled(cloud, true)));
            last.push(set(Change::CloudDeadline(cloud, None)));
        }
        last.extend((0..self.peers.len()).map(Disturbance::Lives));
        let before = self.calm().saturating_sub(Duration::from_millis(10));
        self.turns.iter().copied().chain(last.into_iter().map(|turn| (before, turn))).collect()
    }

    /// Returns when the node is stopped.
    pub(crate) fn end(&self) -> Duration {
        self.calm() + APART * u32::try_from(CALM).unwrap_or(0) + Duration::from_secs(2)
    }
}

impl fmt::Display for Scenario {
    /// Writes the parameters, then a line for each event.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.parameters().join(" "))?;
        for (index, peer) in self.peers.iter().enumerate() {
            writeln!(f, "  {index}: {peer:?}")?;
        }
        for (at, turn) in &self.turns {
            writeln!(f, "  at {at:?}: {turn:?}")?;
        }
        self.inputs.iter().try_for_each(|input| writeln!(f, "  {input:?}"))
    }
}

/// Returns the name of a peer.
pub(crate) fn name(index: usize) -> String {
    if index == LOCAL { "local".into() } else { format!("cloud{index}") }
}

impl Delivery {
    /// Returns a delivery in which nothing goes wrong. The result of a peer with a greater priority
    /// comes later.
    pub(crate) fn fair(index: usize) -> Self {
        let took = Duration::from_millis(20 + index as u64);
        let reply = Reply { delay: Duration::from_millis(2), kind: ReplyKind::Result };
        Self { delay: Some(Duration::from_millis(2)), took, replies: vec![reply] }
    }
}
