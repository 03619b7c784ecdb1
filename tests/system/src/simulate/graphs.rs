//! Graphs of operators, as `adapters/tokio/tests` draws them. Checks their promises (E1 to E7) and
//! their floor (E11).

use std::io;

use tokio::runtime::Builder;

use crate::simulate::link;

#[path = "../../../../adapters/tokio/tests/support/graph.rs"]
mod drawn;
#[path = "../../../../adapters/tokio/tests/support/floor.rs"]
#[expect(dead_code, reason = "conditions are broken by the tests of the adapter alone")]
mod floor;

/// Returns what is wrong with the graph that this seed draws, and with the floor of the pipeline
/// that it draws, in virtual time.
///
/// # Errors
/// Returns an error if no runtime can be created.
pub fn graph_findings(seed: u64) -> io::Result<Vec<String>> {
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
    let mut wrong = runtime.block_on(drawn::wrongs(seed)).0;
    wrong.extend(runtime.block_on(floor::lost(seed, floor::Breach::None)).0);
    Ok(wrong)
}
