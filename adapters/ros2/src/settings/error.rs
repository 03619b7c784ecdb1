//! The mistakes that settings can have.

use fuseline_engine::CapacityErrors;
use thiserror::Error;

use crate::names::NameError;
use crate::parameters::{ParameterError, Value, ValueOrigin};

/// Describes a mistake in the settings in one line: where it is, and what to do about it.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the line that each prints says what its fields are")]
pub enum SettingsError {
    /// A file cannot be read.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A value is not valid.
    #[error("{origin}: {name} is {value}; give {expected}")]
    Value { origin: ValueOrigin, name: String, value: Value, expected: String },
    /// A required type is missing.
    #[error(
        "{name} is not given; add -p {name}:=sensor_msgs/msg/Image, say, or write it into a \
         parameter file"
    )]
    Type { name: String },
    /// It is not known where messages of a type have their key.
    #[error(
        "{origin}: {type_name} is not known to begin with a std_msgs/Header; give {name}: header \
         if it does, or else the type of its integer"
    )]
    Key { origin: ValueOrigin, type_name: String, name: String },
    /// A header has a fixed offset.
    #[error("{origin}: {name} is for integer keys, but the key is a header; leave it out")]
    Offset { origin: ValueOrigin, name: String },
    /// A topic's name is not valid.
    #[error("{origin}: {name} is {topic:?}, which is not a topic name: {source}; rename it")]
    Topic { origin: ValueOrigin, name: String, topic: String, source: NameError },
    /// A topic twice.
    #[error("{origin}: {name} is {topic}, and so is {other}; give each a topic of its own")]
    Shared { origin: ValueOrigin, name: String, topic: String, other: String },
    /// A cloud's name cannot be used.
    #[error("{origin}: the cloud {cloud:?}: {why}")]
    Cloud { origin: ValueOrigin, cloud: String, why: &'static str },
    /// Two clouds of one priority.
    #[error("{origin}: {name} has priority {priority}, and so has {other}; give each its own")]
    Priority { origin: ValueOrigin, name: String, priority: u16, other: String },
    /// One of two parameters that belong together.
    #[error("{origin}: {name} is given without {other}; give both or none")]
    Alone { origin: ValueOrigin, name: String, other: String },
    /// Topics for a gRPC server.
    #[error("{origin}: {name} is given, but {cloud} is a gRPC server without topics; leave it out")]
    Topics { origin: ValueOrigin, name: String, cloud: String },
    /// TLS without a certificate to trust.
    #[error("{origin}: {name} is https; give the CA's certificate with {ca}")]
    Ca { origin: ValueOrigin, name: String, ca: String },
    /// Certificates without TLS.
    #[error("{origin}: {name} is given, but {url} is http; leave it out, or use https")]
    Plain { origin: ValueOrigin, name: String, url: String },
    /// A token that anybody on the way could read.
    #[error(
        "{origin}: {name} is given, but {url} is http to another computer, so that anybody on the way could read the token; \
         use https, or leave it out"
    )]
    Token { origin: ValueOrigin, name: String, url: String },
    /// A remapping rule that the node cannot follow.
    #[error("-r {rule}: {why}; give one of {names}")]
    Remap { rule: String, why: String, names: String },
    /// There is no policy with these figures.
    #[error("{origin}: the policy's parameters are refused: {why}")]
    Policy { origin: ValueOrigin, why: fuseline_deadline::Invalid },
    /// A policy that promises what holds for one output a message.
    #[error(
        "{origin}: policy is {policy}, whose promise assumes one output for each message, but \
         commit: progressive may send more; give another policy, or commit: patient"
    )]
    Outputs { origin: ValueOrigin, policy: &'static str },
    /// A guard that could not guard.
    #[error(
        "{origin}: policy is {policy}, which needs the speed, but no topic reports it; give \
         policy.speed_topic, or another policy"
    )]
    Speed { origin: ValueOrigin, policy: &'static str },
    /// The node could not keep up with what comes.
    #[error(
        "{origin}: policy.rate is more than the node can keep up with: {why} (by window, \
         <cloud>.in_flight, local.in_flight and deadline)"
    )]
    Workload { origin: ValueOrigin, why: CapacityErrors },
    /// Hints that would never come.
    #[error(
        "{origin}: {name} is given, but calls end when they are due, so no result comes late; give \
         {linger} too"
    )]
    Hints { origin: ValueOrigin, name: String, linger: String },
    /// Security that the node does not have.
    #[error(
        "{enable} is true and {strategy} is Enforce, but this node has no DDS security (SROS2), and would join unsecured; unset \
         {enable} for it and protect the network, or use Zenoh with certificates"
    )]
    Security { enable: &'static str, strategy: &'static str },
    /// A parameter of a cloud that is not there.
    #[error("{origin}: {name} is given, but there is no cloud {cloud}; add it to clouds")]
    NoCloud { origin: ValueOrigin, name: String, cloud: String },
    /// There is no such parameter.
    #[error("{origin}: there is no parameter {name}; the nearest is {nearest}")]
    Unknown { origin: ValueOrigin, name: String, nearest: String },
}
