//! The command's service of locations.

#[path = "../../../cli/src/serve/location.rs"]
pub(crate) mod location;
#[path = "../../../cli/src/serve/locations.rs"]
pub(crate) mod locations;
