//! The command's probe, as far as its recordings are read.

#[path = "../../../cli/src/probe/pace.rs"]
pub(crate) mod pace;
#[path = "../../../cli/src/probe/recording.rs"]
pub(crate) mod recording;
