//! What is known of a run beside its trace.

use serde::{Deserialize, Serialize};

/// What a run was, and what other policies would have come to, as it is shown.
#[derive(Clone, PartialEq, Eq, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RunNotes {
    /// Names and values.
    pub configuration: Vec<(String, String)>,
    /// A row a policy, the run's own first.
    pub policies: PolicyScores,
    /// What limits what the figures say, a sentence or two each.
    pub caveats: Vec<String>,
}

/// A table of policies over the same messages.
#[derive(Clone, PartialEq, Eq, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyScores {
    /// What the columns are called.
    pub columns: Vec<String>,
    /// As many cells each as there are columns.
    pub rows: Vec<Vec<String>>,
}
