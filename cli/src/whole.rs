//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Arc, OnceLock};

use tempfile::{Builder, NamedTempFile};

use crate::fault::Fault;

/// The exit code of a command that Ctrl-C ended.
pub(crate) const INTERRUPTED: i32 = 130;

/// Writes a file by `put`; if that fails or Ctrl-C ends it, there is none. Once in a command.
pub(crate) fn write(
    path: &Path,
    put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>,
) -> Result<(), Fault> {
    let name = path.display().to_string();
    let fault = |source: io::Error| Fault::Create { name: name.clone(), source };
    let unfinished: Arc<OnceLock<PathBuf>> = Arc::default();
    let left = Arc::clone(&unfinished);
    // Where the system refuses a handler, Ctrl-C leaves the unfinished file.
    let _ = ctrlc::set_handler(move || {
        let _ = left.get().map(fs::remove_file);
        process::exit(INTERRUPTED);
    });
    let whole = beside(path).map_err(fault)?;
    let _ = unfinished.set(whole.path().to_owned());
    let mut out = BufWriter::new(File::create(whole.path()).map_err(fault)?);
    put(&mut out)?;
    out.flush().map_err(fault)?;
    whole.persist(path).map_err(|error| fault(error.error))?;
    Ok(())
}

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
