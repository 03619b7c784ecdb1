//! Seeded faults of the machine, who catches each, and the matrix that says what shows each rule and promise.
//!
//! Nothing here trusts a name: a witness counts for an identifier only if it cites it and went red under a
//! seeded fault of it.

mod campaign;
mod citation;
mod error;
mod fault;
mod kind;
mod lane;
mod matrix;
mod record;
mod table;
mod tree;

pub use campaign::{Campaign, Summary};
pub use error::Error;
pub use fault::{Fault, load as load_faults};
pub use kind::{KINDS, Kind};
pub use matrix::{Matrix, Row};
pub use record::{Record, folder as records};
pub use table::{Artefact, artefacts};
pub use tree::Tree;
