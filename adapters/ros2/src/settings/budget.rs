//! The end-to-end deadline of messages: when the last node's output is due, and what is kept for the nodes downstream (E3).

use std::time::Duration;

use super::seconds::none_if_zero;
use super::{ParameterReader, SettingsError};

/// What a pipeline's messages have in common.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct EndToEndSettings {
    /// The stream that messages come from; the input's topic unless it is given.
    pub origin: String,
    /// How long after a message was taken in the last output is due.
    pub within: Option<Duration>,
    /// What of that is kept for the nodes downstream.
    pub reserve: Duration,
}

pub(super) fn read(
    r: &mut ParameterReader,
    topic: &str,
) -> Result<EndToEndSettings, SettingsError> {
    let origin = r.text("origin", None)?.value;
    let origin = if origin.is_empty() { topic.to_owned() } else { origin };
    let (within, reserve) = (r.seconds("within")?, r.seconds("reserve")?);
    if !reserve.is_zero() && reserve >= within {
        return Err(r.out_of_range("reserve"));
    }
    Ok(EndToEndSettings { origin, within: none_if_zero(within), reserve })
}
