//! [`RunMetadata`]: what a run leaves beside its trace.

use fuseline_tokio::Tally;

/// The facts about a run that its trace does not have.
pub(crate) struct RunMetadata {
    /// The number of calls begun to each cloud.
    pub(crate) begun: Vec<u64>,
    /// The operator's counts.
    pub(crate) tally: Tally,
    /// `true` if the user ended the run.
    pub(crate) interrupted: bool,
    /// The reason why the trace ends before the run does, if it does.
    pub(crate) recording_error: Option<String>,
}
