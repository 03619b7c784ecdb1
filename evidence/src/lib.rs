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
mod measure;
mod mutants;
mod older;
mod printed;
mod record;
mod sources;
mod table;
mod tool;
mod tree;
mod work_copy;

pub use campaign::{Campaign, Summary};
pub use error::Error;
pub use fault::{SeededFault, load as load_faults};
pub use gap::Gap;
pub use kind::{KINDS, Kind};
pub use matrix::{Matrix, MeasurementRow, Row, Seeded};
pub use measure::{MEASURES, Measure, MeasurementResult};
pub use record::{Record, folder as records};
pub use table::{GeneratedFile, artefacts};
pub use tree::{Tree, hex};
