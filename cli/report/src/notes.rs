//! Facts about a run that are not in its trace.

use serde::{Deserialize, Serialize};

/// Describes a run, and the scores that other policies would have had, for the page.
#[derive(Clone, PartialEq, Eq, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RunNotes {
    /// Names and values.
    pub configuration: Vec<(String, String)>,
    /// One row for each policy, with the run's own policy first.
    pub policies: PolicyScores,
    /// Sentences that limit what the figures mean, one or two for each limit.
    pub caveats: Vec<String>,
}

/// A table of policies over the same messages.
#[derive(Clone, PartialEq, Eq, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyScores {
    /// The names of the columns.
    pub columns: Vec<String>,
    /// The rows. Each has one cell for each column.
    pub rows: Vec<Vec<String>>,
}
