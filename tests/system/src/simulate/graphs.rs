//! Graphs of operators, as `adapters/tokio/tests/graphs.rs` draws them (E1 to E7).

use std::io;

use tokio::runtime::Builder;

#[path = "../../../../adapters/tokio/tests/support/graph.rs"]
mod drawn;

/// What is wrong with the graph that this seed draws, in virtual time.
///
/// # Errors
/// If there is no runtime.
pub fn graph_findings(seed: u64) -> io::Result<Vec<String>> {
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
    Ok(runtime.block_on(drawn::wrongs(seed)).0)
}
