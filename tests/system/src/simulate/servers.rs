//! A gRPC server among well-behaved and hostile clients, as `adapters/tokio/tests/visitors.rs`
//! draws them (D6, D8, D12).

use std::io;

use tokio::runtime::Builder;

#[path = "../../../../adapters/tokio/tests/support/hostile_clients.rs"]
mod hostile_clients;
#[path = "../../../../adapters/tokio/tests/support/memory.rs"]
mod memory;
#[path = "../../../../adapters/tokio/tests/support/visitors.rs"]
mod visitors;
#[path = "../../../../adapters/tokio/tests/support/well_behaved_clients.rs"]
mod well_behaved_clients;

/// Returns what is wrong with the server that this seed draws, in virtual time.
///
/// # Errors
/// Returns an error if no runtime can be created.
pub fn server_findings(seed: u64) -> io::Result<Vec<String>> {
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
    Ok(runtime.block_on(visitors::server_wrongs(seed)))
}
