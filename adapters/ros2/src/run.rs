//! Starts a node, plain or managed, by its settings.

use fuseline_engine::Tally;

use crate::error::NodeError;
use crate::rosout::PendingLogs;
use crate::settings::Settings;
use crate::stop::Stop;
use crate::{managed, node};

/// Runs the node until it is stopped; returns its counts. What comes on `lines`, if anything, goes
/// to `/rosout`.
///
/// Call it within a tokio runtime.
///
/// # Errors
/// If it cannot be started with these settings, or its trace could not be written whole.
pub async fn run(
    settings: &Settings,
    stop: &mut Stop,
    lines: Option<PendingLogs>,
) -> Result<Tally, NodeError> {
    if settings.lifecycle {
        // A plain node does not carry its future.
        Box::pin(managed::run(settings, stop, lines)).await
    } else {
        node::run(settings, stop, lines).await
    }
}
