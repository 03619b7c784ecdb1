//! The end-to-end deadline of messages, and the part of it that is kept for the nodes downstream
//! (E3).

use std::time::Duration;

use super::parameter::none_if_zero;
use super::{ParameterReader, SettingsError};

/// The origin and the end-to-end deadline of a pipeline's messages.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct EndToEndSettings {
    /// The stream that messages come from; the input's topic unless it is given.
    pub origin: String,
    /// The time from a message's acceptance until the last output of the pipeline is due.
    pub within: Option<Duration>,
    /// The part of that time that is kept for the nodes downstream.
    pub reserve: Duration,
}

pub(super) fn read(
    r: &mut ParameterReader,
    topic: &str,
) -> Result<EndToEndSettings, SettingsError> {
    let origin = r.text("origin", None)?;
    let origin = if origin.is_empty() { topic.to_owned() } else { origin };
    let (within, reserve) = (r.seconds("within")?, r.seconds("reserve")?);
    if !reserve.is_zero() && reserve >= within {
        return Err(r.refused("reserve"));
    }
    Ok(EndToEndSettings { origin, within: none_if_zero(within), reserve })
}
