//! What came of driving the camera.

use fuseline_tokio::Tally;

/// What a run's trace does not have.
pub(crate) struct RunMetadata {
    /// Calls begun to each cloud.
    pub(crate) begun: Vec<u64>,
    /// What the operator counted.
    pub(crate) tally: Tally,
    /// Whether the user ended it.
    pub(crate) interrupted: bool,
    /// Why the trace ends before the run does, if so.
    pub(crate) recording_error: Option<String>,
}
