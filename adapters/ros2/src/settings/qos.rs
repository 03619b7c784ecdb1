//! Quality of service: what each topic requires of its middleware.

use std::fmt;

use crate::parameters::{ParameterOverride, Value, ValueOrigin};
use crate::settings::SettingsError;
use crate::settings::nearest::nearest;

/// The beginning of the parameters of quality of service.
pub(super) const PREFIX: &str = "qos_overrides.";
/// The policies that can be set, with a description and the values expected.
const POLICIES: [(&str, &str, &str); 4] = [
    ("reliability", "Whether lost messages are sent again", "reliable or best_effort"),
    ("durability", "Whether late subscribers get earlier messages", "volatile or transient_local"),
    ("history", "Which messages are kept", "keep_last"),
    ("depth", "How many messages are kept", "an integer from 1 to 1024"),
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
    /// Returns the default: subscriptions are best effort, as for sensor data; publishers are reliable, which
    /// suits any subscriber.
    #[must_use]
    pub const fn of(role: Role) -> Self {
        Self { reliable: matches!(role, Role::Publisher), transient_local: false, depth: 5 }
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

/// Applies `<topic>.<role>.<policy>` to one of the topics; returns the policy's description and the values expected.
pub(super) fn apply(
    topics: &mut [Topic],
    name: &str,
    parameter: &ParameterOverride,
) -> Result<(&'static str, &'static str), SettingsError> {
    let of = |topic: &Topic, policy| format!("{}.{}.{policy}", topic.name, topic.role);
    for topic in topics.iter_mut() {
        for (policy, about, expected) in POLICIES {
            if of(topic, policy) == name {
                return match set(&mut topic.qos, policy, &parameter.value) {
                    Some(()) => Ok((about, expected)),
                    None => Err(SettingsError::Value {
                        origin: parameter.origin.clone(),
                        name: parameter.name.clone(),
                        value: parameter.value.clone(),
                        expected: expected.to_owned(),
                    }),
                };
            }
        }
    }
    let names = topics.iter().flat_map(|topic| {
        POLICIES.iter().map(move |(policy, ..)| format!("{PREFIX}{}", of(topic, policy)))
    });
    let names: Vec<String> = names.collect();
    let nearest = nearest(&parameter.name, names.iter().map(String::as_str));
    Err(SettingsError::Unknown {
        origin: parameter.origin.clone(),
        name: parameter.name.clone(),
        nearest,
    })
}

fn set(qos: &mut Qos, policy: &str, value: &Value) -> Option<()> {
    match (policy, value) {
        ("reliability", Value::String(value)) => {
            qos.reliable = one_of(value, ["best_effort", "reliable"])?;
        }
        ("durability", Value::String(value)) => {
            qos.transient_local = one_of(value, ["volatile", "transient_local"])?;
        }
        ("history", Value::String(value)) if value == "keep_last" => {}
        ("depth", Value::Integer(depth @ 1..=1024)) => qos.depth = u16::try_from(*depth).ok()?,
        _ => return None,
    }
    Some(())
}

/// Returns whether the value is the second of two words, or `None` if it is neither.
fn one_of(value: &str, [no, yes]: [&str; 2]) -> Option<bool> {
    (value == no || value == yes).then_some(value == yes)
}
