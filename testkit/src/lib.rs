#![doc = include_str!("../README.md")]

mod draw;
mod edge;
mod generate;
mod history;
mod ledger;
mod coverage;
mod run;
mod context;

pub use draw::splitmix64;
pub use edge::Edge;
pub use generate::Generator;
pub use history::History;
pub use ledger::{Ledger, Promise, OperatorConfig, Violation, split};
pub use coverage::{Cause, Consequence, Mark, Coverage, CoverageShare};
pub use run::Run;
pub use context::{Gate, HoldingReasons, RuleDecision, RunContext};
