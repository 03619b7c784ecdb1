//! Reads files, or standard input for `-`.

use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::Path;

use crate::fault::Fault;

/// Opens a file, or standard input for `-`, with the name to call it.
pub(crate) fn open(path: &Path) -> Result<(String, Box<dyn Read + Send>), Fault> {
    if is_standard(path) {
        return Ok((name(path), Box::new(io::stdin())));
    }
    match File::open(path) {
        Ok(file) => Ok((name(path), Box::new(file))),
        Err(source) => Err(Fault::Open { name: name(path), source }),
    }
}

pub(crate) fn name(path: &Path) -> String {
    if is_standard(path) { "stdin".to_owned() } else { path.display().to_string() }
}

/// Returns `true` if a path stands for standard input, or output.
pub(crate) fn is_standard(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Returns the identity of the file from which an input is read.
pub(crate) fn metadata(path: &Path) -> Option<Metadata> {
    if is_standard(path) { of_stream(io::stdin()) } else { path.metadata().ok() }
}

/// Returns the identity of the file behind a standard stream.
#[cfg(unix)]
pub(crate) fn of_stream(stream: impl std::os::fd::AsFd) -> Option<Metadata> {
    File::from(stream.as_fd().try_clone_to_owned().ok()?).metadata().ok()
}

/// Returns `None`, because this system does not identify the file behind a standard stream.
#[cfg(not(unix))]
pub(crate) fn of_stream<S>(_: S) -> Option<Metadata> {
    None
}
