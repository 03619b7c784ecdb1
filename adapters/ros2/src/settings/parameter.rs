//! What is known of a parameter.

use crate::parameters::{Value, ValueOrigin};

/// What a cloud's parameters are called, below its name.
const PARTS: [&str; 17] = [
    "middleware",
    "priority",
    "deadline",
    "enabled",
    "limit",
    "resume",
    "in_flight",
    "linger",
    "hints",
    "input_topic",
    "output_topic",
    "grpc.url",
    "grpc.ca",
    "grpc.certificate",
    "grpc.key",
    "grpc.token_file",
    "grpc.server_name",
];

/// A parameter of the node.
#[derive(Clone, PartialEq, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// What it is for, in a few words.
    pub about: &'static str,
    /// Which values it may have, in a few words.
    pub expected: String,
    /// The least and the greatest value, if it is a number with bounds.
    pub range: Option<Range>,
    /// Whether it may be changed while the node runs.
    pub at_run_time: bool,
    /// Where its value comes from.
    pub origin: ValueOrigin,
}

/// The least and the greatest value of a number.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Range {
    /// Of a whole number.
    Integer(i64, i64),
    /// Of a number with a point.
    Double(f64, f64),
}

/// Whether `<cloud>.<part>` is a parameter of clouds.
pub(super) fn is_of_a_cloud(part: &str) -> bool {
    PARTS.contains(&part)
}
