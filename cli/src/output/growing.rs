//! A file that is written while a command runs, which no other run writes to.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::{OutputError, Overwrite, numbered};
use crate::fault::Fault;

/// A file that is this command's own until it is dropped.
pub(crate) struct Growing {
    path: PathBuf,
    /// Holds the lock.
    file: File,
    /// `true` if it was not there before.
    is_new: bool,
}

impl Growing {
    /// Opens the file at `path`. If no path is given, opens a file called `default`, or adds a
    /// number to that name if the file exists. The file keeps its content until it is emptied.
    ///
    /// # Errors
    /// If it cannot be written, is there and not to be replaced, or another run writes to it.
    pub(crate) fn open(
        path: Option<&Path>,
        default: &str,
        overwrite: Overwrite,
    ) -> Result<Self, Fault> {
        let Some(path) = path else {
            return if overwrite.force {
                Self::named(Path::new(default), overwrite)
            } else {
                Self::numbered(default)
            };
        };
        Self::named(path, overwrite)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Empties it.
    ///
    /// # Errors
    /// If that fails.
    pub(crate) fn empty(&self) -> io::Result<File> {
        self.file.set_len(0)?;
        self.file.try_clone()
    }

    /// Adds to its end what the command itself has to say.
    ///
    /// # Errors
    /// If that fails.
    pub(crate) fn append(&self, line: &[u8]) -> io::Result<()> {
        let mut file = &self.file;
        file.seek(SeekFrom::End(0))?;
        file.write_all(line)
    }

    /// Removes it, if it was not there before: nothing came of the run.
    pub(crate) fn discard(self) {
        if self.is_new {
            // If it cannot be removed, it stays empty.
            let _ = fs::remove_file(&self.path);
        }
    }

    fn named(path: &Path, overwrite: Overwrite) -> Result<Self, Fault> {
        let name = || path.display().to_string();
        match create_new(path) {
            Ok(file) => Self::locked(path.to_owned(), file, true),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                if !overwrite.force {
                    return Err(OutputError::Exists(name()).into());
                }
                let file = File::options().write(true).open(path);
                let file = file.map_err(|source| Fault::Create { name: name(), source })?;
                Self::locked(path.to_owned(), file, false)
            }
            Err(source) => Err(Fault::Create { name: name(), source }),
        }
    }

    /// Two runs that begin at once get two names.
    fn numbered(default: &str) -> Result<Self, Fault> {
        let mut number = 1;
        loop {
            let path = numbered(default, number);
            match create_new(&path) {
                Ok(file) => return Self::locked(path, file, true),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
                Err(source) => {
                    return Err(Fault::Create { name: path.display().to_string(), source });
                }
            }
        }
    }

    fn locked(path: PathBuf, file: File, is_new: bool) -> Result<Self, Fault> {
        if is_locked(&file) {
            return Err(OutputError::Busy(path.display().to_string()).into());
        }
        Ok(Self { path, file, is_new })
    }
}

fn create_new(path: &Path) -> io::Result<File> {
    File::options().write(true).create_new(true).open(path)
}

/// Locks it; says whether another process has. A file system without locks has none.
#[cfg(unix)]
fn is_locked(file: &File) -> bool {
    use rustix::fs::{FlockOperation, flock};
    flock(file, FlockOperation::NonBlockingLockExclusive) == Err(rustix::io::Errno::WOULDBLOCK)
}

/// A lock would keep others from reading the file here.
#[cfg(not(unix))]
const fn is_locked(_: &File) -> bool {
    false
}
