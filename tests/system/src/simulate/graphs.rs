//! Graphs of operators, as `adapters/tokio/tests` draws them. Checks their promises (E1 to E7) and
//! their floor (E11).

use std::io;
use std::path::Path;

use tokio::runtime::Builder;

use crate::simulate::link;
use crate::simulate::simulator::{Drawn, Simulated};

#[path = "../../../../adapters/tokio/tests/support/graph.rs"]
mod drawn;
#[path = "../../../../adapters/tokio/tests/support/floor.rs"]
#[expect(dead_code, reason = "conditions are broken by the tests of the adapter alone")]
mod floor;

/// The graph that a seed draws, and the floor of the pipeline that it draws.
#[derive(Clone, Copy)]
pub struct Graph(u64);

impl Drawn for Graph {
    const OPTION: &str = "graph";

    fn draw(seed: u64) -> Self {
        Self(seed)
    }

    fn play(&self, _: &Path) -> io::Result<Simulated> {
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
        let mut wrong = runtime.block_on(drawn::wrongs(self.0)).0;
        wrong.extend(runtime.block_on(floor::lost(self.0, floor::Breach::None)).0);
        Ok(Simulated::of(Self::OPTION, &wrong))
    }
}
