//! Files that appear whole or not at all.

use std::io;
use std::path::Path;

use tempfile::{Builder, NamedTempFile};

/// The exit code of a command that Ctrl-C ended.
pub(crate) const INTERRUPTED: i32 = 130;

/// A file with a temporary name beside `path`, to be renamed to it once it is whole.
pub(crate) fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let name = path.file_name().ok_or(io::ErrorKind::IsADirectory)?;
    // What a rename would replace must be a trace, neither a directory nor a device.
    match path.metadata() {
        Ok(metadata) if metadata.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
        Ok(metadata) if !metadata.is_file() => return Err(io::ErrorKind::AlreadyExists.into()),
        Ok(_) | Err(_) => {}
    }
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        Some(_) | None => Path::new("."),
    };
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(name);
    builder.prefix(&prefix).suffix(".tmp").tempfile_in(directory)
}
