//! The part of the command's probe that reads recordings.

#[path = "../../../cli/src/probe/pace.rs"]
pub(crate) mod pace;
#[path = "../../../cli/src/probe/recording.rs"]
pub(crate) mod recording;
