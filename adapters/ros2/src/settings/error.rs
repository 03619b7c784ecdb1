//! The mistakes that settings can have.

use fuseline_engine::{CapacityErrors, EngineConfigError};
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
    /// A parameter is wrong.
    #[error("{origin}: {name} {flaw}")]
    Flaw { origin: ValueOrigin, name: String, flaw: SettingsFlaw },
    /// A required type is missing.
    #[error(
        "{name} is not given; give it, for example with -p {name}:=sensor_msgs/msg/Image or in a \
         parameter file"
    )]
    Type { name: String },
    /// It is not known where messages of a type have their key.
    #[error(
        "{origin}: it is unknown whether {type_name} begins with a std_msgs/Header; give {name}: \
         header if it does, or else the type of its integer"
    )]
    Key { origin: ValueOrigin, type_name: String, name: String },
    /// A cloud's name cannot be used.
    #[error("{origin}: the cloud {cloud:?}: {why}")]
    Cloud { origin: ValueOrigin, cloud: String, why: &'static str },
    /// A remapping rule that the node cannot follow.
    #[error("-r {rule}: {why}; give one of {names}")]
    Remap { rule: String, why: String, names: String },
    /// There is no policy with these figures.
    #[error("{origin}: the policy's parameters are refused: {why}")]
    Policy { origin: ValueOrigin, why: fuseline_deadline::Invalid },
    /// Security that the node does not have.
    #[error(
        "{enable} is true and {strategy} is Enforce, but this node has no DDS security (SROS2), and would join unsecured; unset \
         {enable} for it and protect the network, or use Zenoh with certificates"
    )]
    Security { enable: &'static str, strategy: &'static str },
    /// There is no such parameter.
    #[error("{origin}: there is no parameter {name}; the nearest is {nearest}")]
    Unknown { origin: ValueOrigin, name: String, nearest: String },
}

/// The flaw of a parameter. Its text follows the parameter's name.
#[derive(Debug, Error)]
pub enum SettingsFlaw {
    /// A value is not valid. The second text describes those that are.
    #[error("is {0}; give {1}")]
    Value(Value, String),
    /// A header has a fixed offset.
    #[error("is for integer keys, but the key is a header; leave it out")]
    Offset,
    /// A topic's name is not valid.
    #[error("is {0:?}, which is not a topic name: {1}; rename it")]
    Topic(String, NameError),
    /// A topic twice. The second text is the other parameter.
    #[error("is {0}, and so is {1}; give each a topic of its own")]
    Shared(String, String),
    /// Two clouds of one priority. The second text is the other cloud.
    #[error("has priority {0}, and so has {1}; give each its own")]
    Priority(u16, String),
    /// One of two parameters that belong together.
    #[error("is given without {0}; give both or none")]
    Alone(String),
    /// Topics for a gRPC server.
    #[error("is given, but {0} is a gRPC server without topics; leave it out")]
    Topics(String),
    /// TLS without a certificate to trust.
    #[error("is https; give the CA's certificate with {0}")]
    Ca(String),
    /// Certificates without TLS.
    #[error("is given, but {0} is http; leave it out, or use https")]
    Plain(String),
    /// A token that anybody on the way could read.
    #[error(
        "is given, but {0} is http to another computer, so that anybody on the way could read the token; \
         use https, or leave it out"
    )]
    Token(String),
    /// The engine refuses the value.
    #[error("is refused: {0}")]
    Refused(EngineConfigError),
    /// A guard that could not guard.
    #[error(
        "is {0}, which needs the speed, but no topic reports it; give \
         policy.speed_topic, or another policy"
    )]
    Speed(&'static str),
    /// The node could not keep up with what comes.
    #[error(
        "is more than the node can keep up with: {0} (by window, \
         <cloud>.in_flight, local.in_flight and deadline)"
    )]
    Workload(CapacityErrors),
    /// Hints that would never come.
    #[error("is given, but calls end when they are due, so no result comes late; give {0} too")]
    Hints(String),
    /// A parameter of a cloud that is not there.
    #[error("is given, but there is no cloud {0}; add it to clouds")]
    NoCloud(String),
}
