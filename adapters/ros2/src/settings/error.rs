//! What is wrong with settings.

use fuseline_engine::CapacityErrors;
use thiserror::Error;

use crate::names::NameError;
use crate::parameters::{ParameterError, Value, ValueOrigin};

/// What is wrong with settings, where, and what to do about it, in one line.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the line that each prints says what its fields are")]
pub enum SettingsError {
    /// A file cannot be read.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A value is not valid.
    #[error("{place}: {name} is {value}; give {expected}")]
    Value { place: ValueOrigin, name: String, value: Value, expected: String },
    /// A required type is missing.
    #[error(
        "{name} is not given; add -p {name}:=sensor_msgs/msg/Image, say, or write it into a \
         parameter file"
    )]
    Type { name: String },
    /// It is not known where messages of a type have their key.
    #[error(
        "{place}: {type_name} is not known to begin with a std_msgs/Header; give {name}: header \
         if it does, or else the type of its integer"
    )]
    Key { place: ValueOrigin, type_name: String, name: String },
    /// A header has a fixed place.
    #[error("{place}: {name} is for integer keys, but the key is a header; leave it out")]
    Offset { place: ValueOrigin, name: String },
    /// A topic's name is not valid.
    #[error("{place}: {name} is {topic:?}, which is not a topic name: {source}; rename it")]
    Topic { place: ValueOrigin, name: String, topic: String, source: NameError },
    /// A topic twice.
    #[error("{place}: {name} is {topic}, and so is {other}; give each a topic of its own")]
    Shared { place: ValueOrigin, name: String, topic: String, other: String },
    /// A cloud's name cannot be used.
    #[error("{place}: the cloud {cloud:?}: {why}")]
    Cloud { place: ValueOrigin, cloud: String, why: &'static str },
    /// Two clouds of one priority.
    #[error("{place}: {name} has priority {priority}, and so has {other}; give each its own")]
    Priority { place: ValueOrigin, name: String, priority: u16, other: String },
    /// One of two parameters that belong together.
    #[error("{place}: {name} is given without {other}; give both or none")]
    Alone { place: ValueOrigin, name: String, other: String },
    /// Topics for a gRPC server.
    #[error("{place}: {name} is given, but {cloud} is a gRPC server without topics; leave it out")]
    Topics { place: ValueOrigin, name: String, cloud: String },
    /// TLS without a certificate to trust.
    #[error("{place}: {name} is https; give the CA's certificate with {ca}")]
    Ca { place: ValueOrigin, name: String, ca: String },
    /// Certificates without TLS.
    #[error("{place}: {name} is given, but {url} is http; leave it out, or use https")]
    Plain { place: ValueOrigin, name: String, url: String },
    /// There is no policy with these figures.
    #[error("{place}: the policy's parameters are refused: {why}")]
    Policy { place: ValueOrigin, why: fuseline_deadline::Invalid },
    /// A guard that could not guard.
    #[error(
        "{place}: policy is {policy}, which goes by the speed, and nothing tells it; give \
         policy.speed_topic, or another policy"
    )]
    Speed { place: ValueOrigin, policy: &'static str },
    /// The node could not keep up with what comes.
    #[error(
        "{place}: policy.rate is more than the node can keep up with: {why} (by window, \
         <cloud>.in_flight, local.in_flight and deadline)"
    )]
    Workload { place: ValueOrigin, why: CapacityErrors },
    /// Hints that would never come.
    #[error(
        "{place}: {name} is given, but calls end when they are due, and nothing comes late; give \
         {linger}, too"
    )]
    Hints { place: ValueOrigin, name: String, linger: String },
    /// A parameter of a cloud that is not there.
    #[error("{place}: {name} is given, but there is no cloud {cloud}; add it to clouds")]
    NoCloud { place: ValueOrigin, name: String, cloud: String },
    /// There is no such parameter.
    #[error("{place}: there is no parameter {name}; the nearest is {nearest}")]
    Unknown { place: ValueOrigin, name: String, nearest: String },
}
