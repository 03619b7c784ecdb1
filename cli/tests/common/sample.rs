//! A trace, files of traces, and what a command prints as it comes.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::ChildStdout;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

pub(crate) const TRACE: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":2,"limit":31},{"p":1,"limit":31}]}
{"ev":"open","at":0,"t":0,"x":{"camera":[1.5,null]}}
{"ev":"offer","at":0,"t":0,"p":1,"deadline":500,"backlog":0}
{"ev":"request","at":0,"t":0,"p":1,"due":500}
{"ev":"offer","at":1,"t":0,"p":2,"deadline":500,"backlog":0}
{"ev":"request","at":1,"t":0,"p":2,"due":501}
{"at":150,"ev":"result","t":0,"p":1}
{"ev":"hold","at":150,"t":0,"p":1}
{"ev":"tick","at":500}
{"ev":"timer","at":500,"t":0,"p":1}
{"ev":"emit","at":500,"t":0,"p":1}
{"ev":"cancel","at":500,"t":0,"p":2}
"#;

/// A directory with these files; it goes with the answer.
pub(crate) fn files(named: &[(&str, &str)]) -> (tempfile::TempDir, Vec<PathBuf>) {
    let dir = tempfile::tempdir().unwrap();
    let paths = named.iter().map(|(name, text)| {
        let path = dir.path().join(name);
        fs::write(&path, text).unwrap();
        path
    });
    let paths = paths.collect();
    (dir, paths)
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The lines of an output as they come. Waiting for one that never comes fails.
pub(crate) struct Lines(pub(crate) Receiver<String>);

impl Lines {
    pub(crate) fn of(output: ChildStdout) -> Self {
        let (sender, lines) = channel();
        thread::spawn(move || {
            for line in BufReader::new(output).lines() {
                drop(sender.send(line.unwrap()));
            }
        });
        Self(lines)
    }

    pub(crate) fn next(&self) -> String {
        self.0.recv_timeout(Duration::from_secs(60)).unwrap()
    }
}
