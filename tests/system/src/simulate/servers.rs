//! A gRPC server among well-behaved and hostile clients, as `adapters/tokio/tests/visitors.rs`
//! draws them (D6, D8, D12).

use std::io;
use std::path::Path;

use tokio::runtime::Builder;

use crate::simulate::simulator::{Drawn, Simulated};

#[path = "../../../../adapters/tokio/tests/support/hostile_clients.rs"]
mod hostile_clients;
#[path = "../../../../adapters/tokio/tests/support/memory.rs"]
mod memory;
#[path = "../../../../adapters/tokio/tests/support/visitors.rs"]
mod visitors;
#[path = "../../../../adapters/tokio/tests/support/well_behaved_clients.rs"]
mod well_behaved_clients;

/// The server that a seed draws.
#[derive(Clone, Copy)]
pub struct Server(u64);

impl Drawn for Server {
    const OPTION: &str = "server";

    fn draw(seed: u64) -> Self {
        Self(seed)
    }

    fn play(&self, _: &Path) -> io::Result<Simulated> {
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
        let wrong = runtime.block_on(visitors::server_wrongs(self.0));
        Ok(Simulated::of(Self::OPTION, &wrong))
    }
}
