//! Runs the checker's tools in their root, within limits of time and memory.

use std::fs::{self, File};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use tempfile::TempDir;

use crate::error::Error;

/// Set by Ctrl-C.
pub(crate) static STOP: AtomicBool = AtomicBool::new(false);

/// The time between two polls of a running tool.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The limits of one run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    pub(crate) time: Duration,
    pub(crate) memory_mib: u64,
}

/// The outcome of a run.
#[derive(Debug)]
pub(crate) struct ToolOutput {
    /// The exit code, or `None` if the run was ended.
    pub(crate) code: Option<i32>,
    pub(crate) timed_out: bool,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    pub(crate) seconds: f64,
    pub(crate) peak_mib: u64,
}

/// The root that has the tools, with a folder for this run that is removed when this value is dropped.
pub(crate) struct Tools {
    root: PathBuf,
    work: TempDir,
}

impl Tools {
    /// # Errors
    /// Returns an error if the folder cannot be created.
    pub(crate) fn new(root: &Path) -> Result<Self, Error> {
        let parent = root.join("tmp");
        let work = tempfile::Builder::new().prefix("fuseline-prove.").tempdir_in(&parent);
        Ok(Self { root: root.to_owned(), work: work.map_err(Error::file(&parent))? })
    }

    /// Returns this run's folder.
    pub(crate) fn work(&self) -> &Path {
        self.work.path()
    }

    /// Runs a tool in a folder below this run's folder. Its output is stored there while it runs.
    ///
    /// # Errors
    /// Returns an error if it cannot be started or Ctrl-C ended it.
    pub(crate) fn run(
        &self,
        folder: &Path,
        limits: Limits,
        tool: &str,
        arguments: &[String],
    ) -> Result<ToolOutput, Error> {
        const BOUNDED: &str =
            "cd \"$1\" && export TMPDIR=\"$1\" && ulimit -v \"$2\" && shift 2 && exec \"$@\"";
        let inside = Path::new("/").join(folder.strip_prefix(&self.root).unwrap_or(folder));
        let mut command = if self.root == Path::new("/") {
            Command::new("/bin/sh")
        } else {
            let mut command = Command::new("chroot");
            command.arg(&self.root).arg("/bin/sh");
            command
        };
        command.args(["-c", BOUNDED, "sh"]).arg(&inside);
        command.arg((limits.memory_mib * 1024).to_string());
        command.arg(format!("/usr/bin/{tool}")).args(arguments);
        let path = std::env::var_os("PATH").unwrap_or_default();
        command.env_clear().env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin");
        if !Path::new("/usr/sbin/chroot").exists() {
            command.env("PATH", path);
        }
        let (out, err) = (folder.join(format!("{tool}.out")), folder.join(format!("{tool}.err")));
        command.stdin(Stdio::null());
        command.stdout(File::create(&out).map_err(Error::file(&out))?);
        command.stderr(File::create(&err).map_err(Error::file(&err))?);
        let start = Instant::now();
        let mut child =
            command.process_group(0).spawn().map_err(Error::file(Path::new("chroot")))?;
        let group = Pid::from_child(&child);
        let (mut peak_mib, mut timed_out) = (0, false);
        let status = loop {
            if let Some(status) = child.try_wait().map_err(Error::file(folder))? {
                break status;
            }
            peak_mib = peak_mib.max(resident_mib(group));
            timed_out = start.elapsed() > limits.time;
            if timed_out || STOP.load(Ordering::Acquire) {
                // The tool may have ended in the meantime.
                let _ = kill_process_group(group, Signal::KILL);
                break child.wait().map_err(Error::file(folder))?;
            }
            thread::sleep(POLL_INTERVAL);
        };
        // A solver that outlives the checker would continue alone.
        let _ = kill_process_group(group, Signal::KILL);
        if STOP.load(Ordering::Acquire) {
            return Err(Error::Interrupted);
        }
        let text = |path: &Path| {
            fs::read(path)
                .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
                .map_err(Error::file(path))
        };
        Ok(ToolOutput {
            code: status.code(),
            timed_out,
            stdout: text(&out)?,
            stderr: text(&err)?,
            seconds: start.elapsed().as_secs_f64(),
            peak_mib,
        })
    }

    /// Returns the checker and the compiler with their versions.
    ///
    /// # Errors
    /// Returns an error if a tool does not state its version.
    pub(crate) fn versions(&self) -> Result<String, Error> {
        let mut versions = Vec::new();
        for tool in ["cbmc", "rustc"] {
            let output =
                self.succeed(self.work(), tool, "its version", &["--version".to_owned()])?;
            let version =
                output.stdout.split_whitespace().find(|word| word.starts_with(char::is_numeric));
            versions.push(format!("{tool} {}", version.unwrap_or("of no known version")));
        }
        Ok(versions.join(", "))
    }

    /// Runs a tool that must succeed.
    ///
    /// # Errors
    /// Returns an error if it does not succeed.
    pub(crate) fn must(
        &self,
        folder: &Path,
        tool: &'static str,
        what: &str,
        arguments: &[String],
    ) -> Result<(), Error> {
        self.succeed(folder, tool, what, arguments).map(drop)
    }

    fn succeed(
        &self,
        folder: &Path,
        tool: &'static str,
        what: &str,
        arguments: &[String],
    ) -> Result<ToolOutput, Error> {
        const LIMITS: Limits = Limits { time: Duration::from_secs(120), memory_mib: 8192 };
        let output = self.run(folder, LIMITS, tool, arguments)?;
        if output.code == Some(0) {
            return Ok(output);
        }
        let message = if output.timed_out { "it took too long".to_owned() } else { output.stderr };
        Err(Error::Tool { tool, what: what.to_owned(), message })
    }
}

/// Returns the memory that the processes of a group use, in MiB.
fn resident_mib(group: Pid) -> u64 {
    let Ok(processes) = fs::read_dir("/proc") else { return 0 };
    let own = |stat: String| {
        // The name, in parentheses, may contain anything. Group and resident pages are the 5th and the 24th
        // field.
        let (_, fields) = stat.rsplit_once(')')?;
        let fields: Vec<&str> = fields.split_whitespace().collect();
        let of_group: i32 = fields.get(2)?.parse().ok()?;
        let pages: u64 = fields.get(21)?.parse().ok()?;
        (of_group == group.as_raw_nonzero().get()).then_some(pages)
    };
    let stats = processes.flatten().filter(|entry| {
        entry.file_name().to_string_lossy().bytes().all(|byte| byte.is_ascii_digit())
    });
    let pages = stats.filter_map(|entry| own(fs::read_to_string(entry.path().join("stat")).ok()?));
    pages.sum::<u64>() * rustix::param::page_size() as u64 / (1024 * 1024)
}
