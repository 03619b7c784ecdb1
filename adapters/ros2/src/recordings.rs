//! The node's recordings. A file that is there already is kept, for it may tell of a crash: the
//! next one has a number.

use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use fuseline_engine::{Engine, Header, HeaderAnnotations, Mcap, Recorder, Recording};
use rustix::fs::{Access, access, makedev};
use tracing::warn;

use crate::error::NodeError;
use crate::settings::Settings;

/// The files that were created. They are removed with this, unless the node started: a start that
/// fails again and again leaves nothing behind.
pub(crate) struct CreatedFiles(Vec<PathBuf>);

impl CreatedFiles {
    /// Keeps the recordings, because the node started.
    pub(crate) fn keep(mut self) {
        self.0.clear();
    }
}

impl Drop for CreatedFiles {
    fn drop(&mut self) {
        self.0.iter().for_each(|path| drop(fs::remove_file(path)));
    }
}

/// Checks whether the recordings could be made, as far as that is known without making them.
pub(crate) fn check(settings: &Settings) -> Result<(), NodeError> {
    let paths = [settings.trace.as_deref(), settings.mcap.as_deref()];
    for path in paths.into_iter().flatten() {
        let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let why = match folder.metadata() {
            Ok(found) if !found.is_dir() => "the path to it leads through a file, not a folder",
            Ok(_) if path.is_dir() => "it is a folder; give a file",
            Ok(_) if is_full(path) => "it is always full; give a file",
            Ok(_) if !is_special(path) && access(folder, Access::WRITE_OK).is_err() => {
                "this user may not write to its folder; give another one"
            }
            Ok(_) => continue,
            Err(_) => "its folder does not exist; make it, and give the full path in place of ~",
        };
        let error = io::Error::other(why);
        return Err(NodeError::Recording { path: path.to_owned(), error });
    }
    match paths {
        [Some(trace), Some(mcap)] if is_same(trace, mcap) || trace == mcap => {
            let error =
                io::Error::other("trace.file and trace.mcap are the same file; give each its own");
            Err(NodeError::Recording { path: mcap.to_owned(), error })
        }
        _ => Ok(()),
    }
}

/// Makes the files that the settings name, and records the engine's inputs and decisions in them.
pub(crate) fn record<V, R>(
    engine: &mut Engine<V, R>,
    settings: &Settings,
    header: &Header,
) -> Result<CreatedFiles, NodeError> {
    let given = [settings.trace.as_deref(), settings.mcap.as_deref()];
    let (files, created) = claimed(given)?;
    for (given, file) in given.into_iter().zip(&files) {
        if let (Some(given), Some(file)) = (given, file)
            && given != file
        {
            warn!(kept = %given.display(), recording = %file.display(), "an existing recording is kept; this run is recorded in another file");
        }
    }
    let wrong = |path: &Path| {
        let path = path.to_owned();
        move |error| NodeError::Recording { path, error }
    };
    let [trace, mcap] = files;
    if let Some(path) = trace {
        Recorder::create(&path, header, Recording::default())
            .and_then(|recorder| engine.record(recorder))
            .map_err(wrong(&path))?;
    }
    if let Some(path) = mcap {
        let epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let epoch = u64::try_from(epoch.as_nanos()).unwrap_or(0);
        Mcap::create(&path, header, &HeaderAnnotations::default(), epoch)
            .and_then(|mcap| engine.record(mcap))
            .map_err(wrong(&path))?;
    }
    Ok(created)
}

/// Creates both files, empty, under the first number under which neither is there.
fn claimed(given: [Option<&Path>; 2]) -> Result<([Option<PathBuf>; 2], CreatedFiles), NodeError> {
    let mut number = 1;
    loop {
        let files = given.map(|path| path.map(|path| numbered(path, number)));
        let mut created = CreatedFiles(Vec::new());
        let claimed = files.iter().flatten().try_for_each(|path| {
            if create(path).map_err(|error| (path, error))? {
                created.0.push(path.clone());
            }
            Ok(())
        });
        match claimed {
            Ok(()) => return Ok((files, created)),
            // If both recordings have the same file, no number separates them.
            Err((path, error))
                if error.kind() == io::ErrorKind::AlreadyExists
                    && !created.0.iter().any(|other| is_same(other, path)) =>
            {
                number += 1;
            }
            Err((path, error)) => {
                return Err(NodeError::Recording { path: path.clone(), error });
            }
        }
    }
}

/// Creates a file that is not there yet, also if another node tries it at this moment; false for
/// what is no file, such as a pipe, which is written to as it is.
fn create(path: &Path) -> io::Result<bool> {
    if is_special(path) {
        return Ok(false);
    }
    OpenOptions::new().write(true).create_new(true).open(path).map(|_| true)
}

fn is_same(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Returns `true` if it is Linux's device that has no room.
fn is_full(path: &Path) -> bool {
    cfg!(target_os = "linux")
        && is_special(path)
        && fs::metadata(path).is_ok_and(|it| it.rdev() == makedev(1, 7))
}

/// Returns the numbered name: the first one has the name that was given, and then `trace.jsonl` is
/// `trace-2.jsonl`, and so on.
fn numbered(path: &Path, number: u32) -> PathBuf {
    if number == 1 || is_special(path) {
        return path.to_owned();
    }
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let (stem, rest) = file.split_once('.').unwrap_or((&file, ""));
    let dot = if rest.is_empty() { "" } else { "." };
    path.with_file_name(format!("{stem}-{number}{dot}{rest}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered_before_their_ends() {
        for (path, number, expected) in [
            ("/log/a.jsonl", 1, "/log/a.jsonl"),
            ("/log/a.jsonl", 2, "/log/a-2.jsonl"),
            ("/log.d/a", 13, "/log.d/a-13"),
            ("b.x.mcap", 2, "b-2.x.mcap"),
            ("/dev/null", 2, "/dev/null"),
        ] {
            assert_eq!(numbered(Path::new(path), number), Path::new(expected));
        }
    }

    /// D10: whatever an earlier run wrote stays as it is, and both files of a run have one number.
    #[test]
    fn earlier_recordings_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name);
        let (trace, mcap) = (file("a.jsonl"), file("a.mcap"));
        let next = || {
            let (files, created) = claimed([Some(&trace), Some(&mcap)]).unwrap();
            created.keep();
            files.map(Option::unwrap)
        };
        assert_eq!(next(), [trace.clone(), mcap.clone()]);
        fs::write(&trace, "of a crash").unwrap();
        fs::remove_file(&mcap).unwrap();
        assert_eq!(next(), [file("a-2.jsonl"), file("a-2.mcap")]);
        fs::write(file("a-3.mcap"), "somebody's").unwrap();
        assert_eq!(next(), [file("a-4.jsonl"), file("a-4.mcap")]);
        assert!(!file("a-3.jsonl").exists() && !mcap.exists(), "what was claimed in vain is left");
        assert_eq!(fs::read_to_string(&trace).unwrap(), "of a crash");
        assert_eq!(fs::read_to_string(file("a-3.mcap")).unwrap(), "somebody's");
    }

    #[test]
    fn what_is_no_file_is_written_to_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let null = Path::new("/dev/null");
        let trace = folder.path().join("a.jsonl");
        fs::write(&trace, "").unwrap();
        let (files, created) = claimed([Some(&trace), Some(null)]).unwrap();
        let files_there = || files.each_ref().map(|path| path.as_ref().unwrap().exists());
        assert_eq!(files_there(), [true, true]);
        drop(created);
        assert_eq!(files_there(), [false, true], "the start failed");
        assert_eq!(files, [Some(folder.path().join("a-2.jsonl")), Some(null.to_owned())]);
        let nowhere = folder.path().join("none/a.jsonl");
        assert!(matches!(claimed([Some(&nowhere), None]), Err(NodeError::Recording { .. })));
        let (one, same) = (folder.path().join("b"), folder.path().join("./b"));
        assert!(matches!(claimed([Some(&one), Some(&same)]), Err(NodeError::Recording { .. })));
        assert!(!one.exists());
        assert_eq!(claimed([None, None]).unwrap().0, [None, None]);
    }
}
