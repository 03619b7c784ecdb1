#![doc = include_str!("../README.md")]

mod context;
mod coverage;
mod draw;
mod edge;
mod ends;
mod generate;
mod history;
mod ledger;
#[cfg(feature = "networks")]
pub mod networks;
mod rng;
mod run;
mod shrink;
mod varied;

pub use context::{Gate, HoldingReasons, RuleDecision, RunContext};
pub use coverage::{Cause, Consequence, Coverage, CoverageShare, Mark};
pub use edge::Edge;
pub use ends::admissions_and_ends;
pub use generate::Generator;
pub use history::History;
pub use ledger::{Ledger, OperatorConfig, Promise, Violation, split};
pub use rng::Rng;
pub use run::Run;
pub use shrink::{Simplification, Steps, shrink};
pub use varied::VariedGenerator;
