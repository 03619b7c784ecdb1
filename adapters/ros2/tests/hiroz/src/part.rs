//! Processes that are started here, and end with this one.

use std::env;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use crate::Any;

/// A process; killed when it is dropped.
pub(crate) struct ChildProcess(Child);

impl ChildProcess {
    /// This program in another role.
    pub(crate) fn role(role: &str) -> Result<Self, Any> {
        Ok(Self(Command::new(env::current_exe()?).arg(role).stdin(Stdio::null()).spawn()?))
    }

    /// Another program; what it says goes into a file.
    pub(crate) fn program(program: &str, words: &[&str], log: &Path) -> Result<Self, Any> {
        let log = File::create(log)?;
        let mut command = Command::new(program);
        command.args(words).stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
        Ok(Self(command.spawn().map_err(|error| format!("{program}: {error}"))?))
    }

    /// Asks it to end, and waits.
    pub(crate) fn interrupt(mut self) -> Result<ExitStatus, Any> {
        let id = Pid::from_raw(i32::try_from(self.0.id())?).ok_or("no such process")?;
        kill_process(id, Signal::INT)?;
        Ok(self.0.wait()?)
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop((self.0.kill(), self.0.wait()));
    }
}
