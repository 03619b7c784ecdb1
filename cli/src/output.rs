//! Outputs: files that appear whole or not at all, or standard output for `-`.
//!
//! An [`Output`] is never a file that the command reads, and an existing file is replaced only if
//! the user said so.

use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use tempfile::{Builder, NamedTempFile};
use thiserror::Error;

use crate::diagnostics::print_line;
use crate::exit::INTERRUPTED;
use crate::fault::Fault;
use crate::input;
use crate::sink::OutputSink;

/// The file that is being written, and not yet whole.
static UNFINISHED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// The destination of a command's output, which is never a file that it reads.
pub(crate) struct Output {
    name: String,
    target: Target,
    overwrite: Overwrite,
}

/// The kind of an output.
enum Target {
    Stdout,
    /// A file, links followed.
    File(PathBuf),
    /// A device or a pipe.
    Special(PathBuf),
}

/// The treatment of existing files.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Overwrite {
    /// Replace files that exist. Without it, an existing file that you name is refused, and a
    /// default file name gets a number.
    #[arg(long)]
    pub(crate) force: bool,
}

/// The reason why a path cannot be written.
#[derive(Debug, Error)]
enum OutputError {
    #[error("{0}: this is a directory; name a file in it")]
    Directory(String),
    #[error("{0}: this is a device or a pipe, which cannot be read again; name a file")]
    Special(String),
    #[error("{0}: this is a link to a file that does not exist; name the file itself")]
    Dangling(String),
    #[error("{0}: another run is writing to it; name another file")]
    Busy(String),
    #[error("{0}: it exists; name another file, or replace it with --force")]
    Exists(String),
}

impl From<OutputError> for Fault {
    fn from(error: OutputError) -> Self {
        Self::own(error)
    }
}

impl Output {
    /// Returns the file at `path`, or standard output for `-`.
    ///
    /// # Errors
    /// If one of `inputs` is the same file, however it is named, or it can be no file, or there is
    /// one already that is not to be replaced.
    pub(crate) fn new(path: &Path, inputs: &[&Path], overwrite: Overwrite) -> Result<Self, Fault> {
        if input::is_standard(path) {
            refuse_onto_stdout(inputs)?;
            let (name, target) = ("standard output".to_owned(), Target::Stdout);
            return Ok(Self { name, target, overwrite });
        }
        let name = path.display().to_string();
        if is_special(path) {
            return Ok(Self { name, target: Target::Special(path.to_owned()), overwrite });
        }
        let target = Target::File(file(path, inputs, overwrite)?);
        Ok(Self { name, target, overwrite })
    }

    /// Returns the file at `path`. Without a path, it is called `default`, with a number if that
    /// file exists.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn or_numbered(
        path: Option<&Path>,
        default: &str,
        inputs: &[&Path],
        overwrite: Overwrite,
    ) -> Result<Self, Fault> {
        match path {
            Some(path) => Self::new(path, inputs, overwrite),
            None if overwrite.force => Self::new(Path::new(default), inputs, overwrite),
            None => Self::new(&unused(default), inputs, overwrite),
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns `true` if what is written goes to standard output.
    pub(crate) const fn is_stdout(&self) -> bool {
        matches!(self.target, Target::Stdout)
    }

    /// Writes by `put`; if that fails or Ctrl-C ends the process, nothing was written.
    ///
    /// # Errors
    /// The error of `put`; a [`Fault::Output`] gets the name of the output.
    pub(crate) fn write(
        &self,
        put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        static CAUGHT: Once = Once::new();
        let path = match &self.target {
            Target::Stdout => return to_stdout(put),
            Target::Special(path) => return self.to_special(path, put),
            Target::File(path) => path,
        };
        CAUGHT.call_once(|| {
            // Where the command has caught it, that discards the file; where the system refuses, it
            // stays.
            let _ = ctrlc::set_handler(|| {
                discard();
                print_line("interrupted; nothing was written");
                process::exit(INTERRUPTED);
            });
        });
        let whole = beside(path).map_err(|source| self.fault(source))?;
        *unfinished() = Some(whole.path().to_owned());
        let written = self.finish(whole, path, put);
        *unfinished() = None;
        written
    }

    fn finish(
        &self,
        whole: NamedTempFile,
        path: &Path,
        put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let fault = |source| self.fault(source);
        let mut out = BufWriter::new(File::create(whole.path()).map_err(fault)?);
        put(&mut out).map_err(|error| match error {
            Fault::Output(source) => fault(source),
            error => error,
        })?;
        out.flush().map_err(fault)?;
        if !self.overwrite.force && path.exists() {
            return Err(OutputError::Exists(self.name.clone()).into());
        }
        whole.persist(path).map_err(|error| fault(error.error))?;
        Ok(())
    }

    /// Writes to a device or a pipe once all is there.
    fn to_special(
        &self,
        path: &Path,
        put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let mut whole = gathered(put)?;
        let copied = File::options().write(true).open(path).and_then(|mut special| {
            io::copy(&mut whole, &mut special)?;
            special.flush()
        });
        copied.map_err(|source| self.fault(source))
    }

    fn fault(&self, source: io::Error) -> Fault {
        Fault::Create { name: self.name.clone(), source }
    }
}

/// Removes what is not whole: the process ends now.
pub(crate) fn discard() {
    if let Some(path) = unfinished().take() {
        // It may have become whole, and has its own name then.
        let _ = fs::remove_file(path);
    }
}

fn unfinished() -> MutexGuard<'static, Option<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the first name that no file has, of `name.end`, `name-2.end`, `name-3.end`, …
pub(crate) fn unused(name: &str) -> PathBuf {
    let is_unused = |path: &PathBuf| path.symlink_metadata().is_err();
    let mut names = (1_u64..).map(|number| numbered(name, number));
    names.find(is_unused).unwrap_or_else(|| name.into())
}

fn numbered(name: &str, number: u64) -> PathBuf {
    match name.rsplit_once('.') {
        _ if number == 1 => name.into(),
        Some((stem, end)) => format!("{stem}-{number}.{end}").into(),
        None => format!("{name}-{number}").into(),
    }
}

/// Returns `true` if there is a device or a pipe.
fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir())
}

/// Returns the file at a path, links followed.
///
/// # Errors
/// If one of `inputs` is the same file, however it is named, or it is no file, or not to be
/// replaced.
pub(crate) fn file(path: &Path, inputs: &[&Path], overwrite: Overwrite) -> Result<PathBuf, Fault> {
    let name = || path.display().to_string();
    let metadata = match path.metadata() {
        Ok(metadata) => metadata,
        Err(_) if path.is_symlink() => return Err(OutputError::Dangling(name()).into()),
        // A file to be made; what hinders that shows when it is.
        Err(_) if path.file_name().is_some() => return Ok(path.to_owned()),
        Err(_) => return Err(OutputError::Directory(name()).into()),
    };
    if metadata.is_dir() {
        return Err(OutputError::Directory(name()).into());
    }
    if !metadata.is_file() {
        return Err(OutputError::Special(name()).into());
    }
    if let Some(input) = same(&metadata, Some(path), inputs) {
        return Err(Fault::Same { output: name(), input });
    }
    if !overwrite.force {
        return Err(OutputError::Exists(name()).into());
    }
    path.canonicalize().map_err(|source| Fault::Create { name: name(), source })
}

/// Checks that standard output does not go to a file that is read.
///
/// # Errors
/// If it does.
pub(crate) fn refuse_onto_stdout(inputs: &[&Path]) -> Result<(), Fault> {
    let stdout = input::of_stream(io::stdout()).filter(Metadata::is_file);
    match stdout.and_then(|stdout| same(&stdout, None, inputs)) {
        Some(input) => Err(Fault::Same { output: "standard output".to_owned(), input }),
        None => Ok(()),
    }
}

/// Returns the name of the input that is the same file.
fn same(output: &Metadata, path: Option<&Path>, inputs: &[&Path]) -> Option<String> {
    let is_same = |input: &Path| {
        let known = input::metadata(input).filter(Metadata::is_file);
        known.is_some_and(|metadata| is_one(output, path, &metadata, input))
    };
    inputs.iter().find(|input| is_same(input)).map(|input| input::name(input))
}

/// Returns `true` if two paths are one file, even by hard or symbolic links.
#[cfg(unix)]
fn is_one(output: &Metadata, _: Option<&Path>, input: &Metadata, _: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    (output.dev(), output.ino()) == (input.dev(), input.ino())
}

/// Returns `true` if two paths are one file, even by symbolic links.
#[cfg(not(unix))]
fn is_one(_: &Metadata, output: Option<&Path>, _: &Metadata, input: &Path) -> bool {
    let [output, input] = [output, Some(input)].map(|path| path?.canonicalize().ok());
    output.is_some() && output == input
}

/// Gathers the output in a file without a name.
fn gathered(put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>) -> Result<File, Fault> {
    let mut out = BufWriter::new(tempfile::tempfile().map_err(Fault::Output)?);
    put(&mut out)?;
    let mut whole = out.into_inner().map_err(|error| Fault::Output(error.into_error()))?;
    whole.rewind().map_err(Fault::Output)?;
    Ok(whole)
}

/// Gathers all first.
fn to_stdout(put: impl FnOnce(&mut BufWriter<File>) -> Result<(), Fault>) -> Result<(), Fault> {
    let mut whole = gathered(put)?;
    // A reader that has gone away still needs the exit code.
    let mut stdout = OutputSink::new(io::stdout().lock());
    io::copy(&mut whole, &mut stdout).and_then(|_| stdout.flush()).map_err(Fault::Output)
}

/// Returns a file with a temporary name beside `path`, to be renamed to it once it is whole.
fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        Some(_) | None => Path::new("."),
    };
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(path.file_name().unwrap_or_default());
    builder.prefix(&prefix).suffix(".tmp").tempfile_in(directory)
}

mod growing;

pub(crate) use self::growing::Growing;

#[cfg(test)]
mod tests;
