#![doc = include_str!("../README.md")]

mod draw;
mod edge;
mod generate;
mod history;
mod ledger;
mod reach;
mod run;
mod scene;

pub use draw::splitmix64;
pub use edge::Edge;
pub use generate::Generator;
pub use history::History;
pub use ledger::{Ledger, Promise, Terms, Violation, split};
pub use reach::{Cause, Consequence, Mark, Reach, Share};
pub use run::Run;
pub use scene::{Gate, Grounds, Ruling, Scene};
