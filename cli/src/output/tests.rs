//! Checks what remains of an output that Ctrl-C ends.
#![cfg(unix)]

use std::env;
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use super::*;
use crate::interrupt::Interrupt;

/// In the process that is interrupted: the folder, and whether the command catches Ctrl-C itself.
const FOLDER: &str = "UNFINISHED_IN";
const CATCHES: &str = "UNFINISHED_CAUGHT";

/// Writes one file, and begins a second one.
fn begin(folder: &Path) {
    if env::var_os(CATCHES).is_some() {
        Interrupt::watch();
    }
    let output = |name| Output::new(&folder.join(name), &[], Overwrite::default()).unwrap();
    let whole = output("whole").write(|out| out.write_all(b"whole").map_err(Fault::Output));
    assert!(whole.is_ok());
    let _ = output("half").write(|out| {
        out.write_all(b"half").and_then(|()| out.flush()).map_err(Fault::Output)?;
        println!("begun");
        thread::sleep(Duration::from_secs(60));
        Ok(())
    });
}

/// D10: of several outputs too, and where the command waits for a second Ctrl-C.
#[test]
fn ctrl_c_leaves_nothing_half_written_of_a_second_output() {
    if let Some(folder) = env::var_os(FOLDER) {
        return begin(folder.as_ref());
    }
    for catches in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(env::current_exe().unwrap());
        child.args(["--exact", "--nocapture"]);
        child.arg("output::tests::ctrl_c_leaves_nothing_half_written_of_a_second_output");
        child.env(FOLDER, folder.path()).stdout(Stdio::piped());
        if catches {
            child.env(CATCHES, "");
        }
        let mut child = child.spawn().unwrap();
        let mut reported = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(reported.any(|line| line.unwrap().ends_with("begun")));
        let names = || {
            let names = fs::read_dir(folder.path()).unwrap();
            names.map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>()
        };
        assert_eq!(names().len(), 2, "{:?}", names());
        let id = Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
        let ended = loop {
            // Where the command catches it, the first one alone does not end it.
            kill_process(id, Signal::INT).unwrap();
            thread::sleep(Duration::from_millis(50));
            if let Some(ended) = child.try_wait().unwrap() {
                break ended;
            }
        };
        assert_eq!((ended.code(), ended.signal()), (Some(INTERRUPTED), None));
        assert_eq!(names(), ["whole"]);
    }
}
