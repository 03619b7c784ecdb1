//! Seeded faults of the machine, who catches each, and the matrix that says what shows each rule and promise.
//!
//! Nothing here trusts a name: a witness counts for an identifier only if it cites it and went red under a
//! seeded fault of it. Beside it stand measurements of the tests: mutants that survive, code that never runs.

mod campaign;
mod citation;
mod coverage;
mod error;
mod fault;
mod gap;
mod kind;
mod matrix;
mod mcdc;
mod measure;
mod mutants;
mod older;
mod printed;
mod reach;
mod record;
mod sources;
mod table;
mod tool;
mod tree;
mod work_copy;

pub use campaign::{Campaign, CampaignSummary};
pub use error::EvidenceError;
pub use fault::{SeededFault, load as load_faults};
pub use gap::CoverageGap;
pub use kind::{EvidenceKind, KINDS};
pub use matrix::{Matrix, MatrixRow, MeasurementRow, Seeded};
pub use mcdc::{Evaluation, IndependencePair, McdcReport, SourceDecision};
pub use measure::{MEASURES, Measure, MeasurementResult, core_coverage};
pub use reach::CoverageReport;
pub use record::{KindRecord, folder as records};
pub use table::{GeneratedFile, artefacts};
pub use tree::{Tree, hex};
