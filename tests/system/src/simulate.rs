#![doc = include_str!("../simulate/README.md")]

mod checks;
mod draw;
mod graphs;
#[path = "../../../adapters/tokio/tests/support/link.rs"]
mod link;
mod log;
pub mod nodes;
mod peers;
mod play;
mod saved_seeds;
mod scenario;
mod servers;
mod shrink;
mod simulator;
mod value;

pub use checks::CHECKS;
pub use graphs::Graph;
pub use saved_seeds::{SavedSeed, saved_seeds};
pub use scenario::{
    CallResult, Disk, Finish, MessageScript, OfferAction, OnBoard, ReaderPlan, Scenario,
    ScenarioCloud, SourceAction,
};
pub use servers::Server;
pub use simulator::{Drawn, SeedResults, Simulated, Simulator};
