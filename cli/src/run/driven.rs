//! What came of driving the camera.

use std::io;

/// What a run's trace does not tell.
pub(crate) struct Driven {
    /// Requests sent to each cloud.
    pub(crate) sent: Vec<u64>,
    /// Whether the user ended it.
    pub(crate) interrupted: bool,
    /// Why the trace ends before the run does, if so.
    pub(crate) unrecorded: Option<io::Error>,
}
