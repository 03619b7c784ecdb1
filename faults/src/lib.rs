//! Seeds faults, and finds which witnesses catch each fault and which show each rule and promise.
//!
//! A witness counts for an identifier only if it cites the identifier and failed under a seeded
//! fault of it; its name alone proves nothing. One copy of the tree contains all faults, each
//! behind a number that an environment variable selects, so one build serves all of them. No result
//! is stored.

mod artifacts;
mod build;
mod campaign;
mod cases;
mod citation;
mod error;
mod fault;
mod guard;
mod items;
mod kind;
mod mcdc;
mod printed;
mod schemata;
mod table;
mod tree;
mod work;

pub use campaign::{Campaign, CampaignFindings, Catches, kinds};
pub use cases::try_all as try_cases;
pub use error::FaultsError;
pub use fault::{MisuseCase, SeededFault, load as load_faults};
pub use guard::load_guards;
pub use items::{Function, FunctionIndex};
pub use kind::{KINDS, Tier, WitnessKind};
pub use mcdc::{Evaluation, IndependencePair, McdcReport, SourceDecision};
pub use schemata::can_share;
pub use table::{ExpectedWitnesses, FaultRow, PromiseRow, Table, expected};
pub use tree::{Tree, hex, write};
