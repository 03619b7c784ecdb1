//! Quality of service: what each topic requires of its middleware.

use std::fmt;

use crate::parameters::{Value, ValueOrigin};
use crate::settings::parameter::{Kind, Preset, Spec};

/// The beginning of the parameters of quality of service.
pub(super) const PREFIX: &str = "qos_overrides.";
/// The policies that can be set.
const POLICIES: [Spec; 4] = [
    policy("reliability", &["reliable", "best_effort"], "reliable sends lost messages again"),
    policy(
        "durability",
        &["volatile", "transient_local"],
        "transient_local gives late subscribers the earlier messages",
    ),
    policy("history", &["keep_last"], "keep_last keeps the last messages"),
    Spec {
        kind: Kind::Integer(1, 1024),
        ..policy("depth", &[], "The number of messages that are kept")
    },
];

/// A topic of the node.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Topic {
    /// Its full name, after remapping.
    pub name: String,
    /// Its messages' type, `package/msg/Type`.
    pub type_name: String,
    /// The side of the topic or service on which the node is.
    pub role: Role,
    /// The quality of service.
    pub qos: Qos,
    /// The parameter that names it, or its own name before it was resolved.
    pub purpose: String,
    /// The parameter that names it.
    pub origin: ValueOrigin,
}

/// A side of a topic.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Role {
    /// The node gets messages.
    Subscription,
    /// The node sends messages.
    Publisher,
}

/// A topic's quality of service. Its history is always the last `depth` messages.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Qos {
    /// `true` if lost messages are sent again.
    pub reliable: bool,
    /// `true` if late subscribers get earlier messages.
    pub transient_local: bool,
    /// The number of messages that are kept, 1 to 1024.
    pub depth: u16,
}

impl Qos {
    /// Returns the default: subscriptions are best effort, as for sensor data; publishers are
    /// reliable, which suits any subscriber.
    #[must_use]
    pub const fn of(role: Role) -> Self {
        Self { reliable: matches!(role, Role::Publisher), transient_local: false, depth: 5 }
    }

    /// Sets a policy to a value that it accepts. The history has only one.
    pub(super) fn set(&mut self, policy: &str, value: &Value) {
        match (policy, value) {
            ("reliability", Value::String(word)) => self.reliable = word == "reliable",
            ("durability", Value::String(word)) => self.transient_local = word == "transient_local",
            ("depth", Value::Integer(depth)) => {
                self.depth = u16::try_from(*depth).unwrap_or(self.depth);
            }
            _ => {}
        }
    }
}

impl Topic {
    fn parameter(&self, policy: &Spec) -> String {
        format!("{PREFIX}{}.{}.{}", self.name, self.role, policy.name)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Subscription => "subscription",
            Self::Publisher => "publisher",
        })
    }
}

impl fmt::Display for Qos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.reliable { "reliable" } else { "best effort" })?;
        f.write_str(if self.transient_local { ", transient local" } else { "" })?;
        write!(f, ", {}", self.depth)
    }
}

const fn policy(name: &'static str, words: &'static [&'static str], about: &'static str) -> Spec {
    let (kind, preset) = (Kind::Words(words), Preset::Nothing);
    Spec { name, kind, preset, at_run_time: false, about }
}

/// Returns the topic and the policy that a parameter is about.
pub(super) fn find(topics: &[Topic], name: &str) -> Option<(usize, Spec)> {
    let of = |topic: &Topic| POLICIES.into_iter().find(|policy| topic.parameter(policy) == name);
    topics.iter().enumerate().find_map(|(at, topic)| Some((at, of(topic)?)))
}

/// Returns the names of all parameters of quality of service that the topics have.
pub(super) fn names(topics: &[Topic]) -> Vec<String> {
    let of = |topic: &Topic| POLICIES.map(|policy| topic.parameter(&policy));
    topics.iter().flat_map(of).collect()
}
