//! The decisions that a progressive run must share with a patient one (P13).

use fuseline_traces::{Commit, Decision};

/// Returns the decisions that progressive and patient must share (P13), from decisions made under
/// `commit`. They are refusals of opens and offers, requests, and the ends of timestamps, each with
/// its last source.
///
/// If a progressive and a patient machine take the same inputs, these decisions are the same after
/// each input.
#[must_use]
pub fn admissions_and_ends<'a>(
    commit: Commit,
    decisions: impl IntoIterator<Item = &'a Decision>,
) -> Vec<Decision> {
    let kept = |decision: &Decision| match *decision {
        Decision::RefuseOpen { .. }
        | Decision::RefuseOffer { .. }
        | Decision::Request { .. }
        | Decision::Final { .. }
        | Decision::Miss { .. } => Some(*decision),
        Decision::Emit { at, t, p } if commit != Commit::Progressive => {
            Some(Decision::Final { at, t, p })
        }
        Decision::Timer { .. }
        | Decision::Hold { .. }
        | Decision::Drop { .. }
        | Decision::Emit { .. }
        | Decision::Cancel { .. } => None,
    };
    decisions.into_iter().filter_map(kept).collect()
}
