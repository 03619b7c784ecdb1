//! A copy of the project in which faults are seeded and witnesses run.

use std::fs::{self, File};
use std::iter;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};

use crate::error::EvidenceError;
use crate::fault::SeededFault;
use crate::kind::{EvidenceKind, RunMethod};
use crate::printed::Outcomes;
use crate::tree::Tree;

/// How often a running command is looked at.
const GLANCE: Duration = Duration::from_millis(20);

/// A faulty machine may take memory without end; 4 GiB are more than any sound witness takes.
pub(crate) const BOUNDED: &str = "ulimit -v 4194304; exec \"$@\"";

/// One copy with its own folder of built things.
pub(crate) struct WorkCopy<'a> {
    pub(crate) copy: Tree,
    pub(crate) target: PathBuf,
    /// The project's own command, built without a fault, where a kind needs it.
    pub(crate) command: PathBuf,
    /// The interpreter that has the wheel, as `.ci/python` installs it.
    pub(crate) python: PathBuf,
    pub(crate) limit: Duration,
    pub(crate) stop: &'a AtomicBool,
}

impl WorkCopy<'_> {
    /// Runs the witnesses of a kind, under a fault or under none.
    ///
    /// # Errors
    /// The fault cannot be seeded, the code does not build, or no witness ran.
    pub(crate) fn run(
        &self,
        kind: &EvidenceKind,
        fault: Option<&SeededFault>,
    ) -> Result<Outcomes, EvidenceError> {
        let Some(fault) = fault else { return self.witnesses(kind, "none") };
        let path = self.copy.path(&fault.file);
        let sound = fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
        fs::write(&path, fault.seed(&sound)?).map_err(EvidenceError::file(&path))?;
        let outcomes = self.witnesses(kind, &fault.name);
        fs::write(&path, sound).map_err(EvidenceError::file(&path))?;
        outcomes
    }

    fn witnesses(&self, kind: &EvidenceKind, run: &str) -> Result<Outcomes, EvidenceError> {
        let log = self.target.join("logs").join(format!("{}.{run}.txt", kind.name));
        let wrong = |why: &str| EvidenceError::Run {
            kind: kind.name,
            run: run.to_owned(),
            why: why.to_owned(),
            log: log.clone(),
        };
        self.run_until_ended(kind, &log)?;
        let printed = fs::read(&log).map_err(EvidenceError::file(&log))?;
        let printed = String::from_utf8_lossy(&printed);
        if printed.contains("error: could not compile") {
            return Err(wrong("it does not build"));
        }
        let outcomes = (kind.read)(&printed);
        if outcomes.is_empty() { Err(wrong("no witness ran")) } else { Ok(outcomes) }
    }

    /// What has cargo run what it built by the project's own command.
    fn runner(&self, by: &[&str]) -> String {
        let command = self.command.to_string_lossy();
        let words: Vec<&str> = iter::once(&*command).chain(by.iter().copied()).collect();
        format!("target.'cfg(all())'.runner = {words:?}")
    }

    /// What runs the witnesses; none for a kind that has a command of its own.
    fn command(&self, kind: &EvidenceKind) -> Result<Option<Command>, EvidenceError> {
        Ok(Some(match kind.run {
            RunMethod::Cargo { arguments, variables } => {
                let mut command = self.cargo(kind.name, arguments, variables);
                command.envs(variables.iter().copied());
                command
            }
            RunMethod::DrivePrinted { arguments, by } => {
                let mut command = self.cargo(kind.name, arguments, &[]);
                command.arg("--config").arg(self.runner(by));
                command
            }
            RunMethod::Pytest { arguments } => self.pytest(arguments)?,
            RunMethod::Prove { .. } => return Ok(None),
        }))
    }

    fn cargo(&self, kind: &str, arguments: &[&str], variables: &[(&str, &str)]) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", BOUNDED, "sh"]);
        command.arg(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())).args(arguments);
        // Other flags of the compiler build everything anew.
        let is_apart = variables.iter().any(|(name, _)| *name == "RUSTFLAGS");
        let target = self.target.join(if is_apart { kind } else { "plain" });
        let fixed = [
            ("CARGO_TARGET_DIR", target.as_os_str()),
            ("CARGO_NET_OFFLINE", "true".as_ref()),
            ("CARGO_TERM_COLOR", "never".as_ref()),
            ("CARGO_PROFILE_DEV_OPT_LEVEL", "1".as_ref()),
            ("CARGO_PROFILE_DEV_DEBUG", "0".as_ref()),
            // Which run shows it matters little here, how short it is less.
            ("PROPTEST_MAX_SHRINK_ITERS", "300".as_ref()),
            ("RUST_BACKTRACE", "0".as_ref()),
            // In order, so that one that hangs is the last one named.
            ("RUST_TEST_THREADS", "1".as_ref()),
        ];
        command.current_dir(self.copy.root()).envs(fixed).env_remove("PROPTEST_CASES");
        command
    }

    /// pytest on the copy's package, which gets the compiled part that is built of the copy.
    fn pytest(&self, arguments: &[&str]) -> Result<Command, EvidenceError> {
        let folder = self.copy.path("adapters/python");
        let package = folder.join("python");
        let target = self.target.join("python");
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut build = Command::new(cargo);
        build
            .args(["build", "--locked", "--quiet", "--profile", "landing", "--target-dir"])
            .arg(&target)
            .current_dir(&folder)
            .envs([("CARGO_NET_OFFLINE", "true"), ("PYO3_BUILD_EXTENSION_MODULE", "1")])
            .env("PYO3_PYTHON", &self.python);
        let ended = build.status().map_err(EvidenceError::file(&folder))?;
        if !ended.success() {
            let why = format!("the compiled part does not build: {ended}; run .ci/python");
            return Err(EvidenceError::content(&folder, why));
        }
        let there = package.join("fuseline/_fuseline.abi3.so");
        let library = target.join("landing/lib_fuseline.so");
        fs::copy(&library, there).map_err(EvidenceError::file(&library))?;
        let mut command = Command::new("sh");
        command
            .args(["-c", BOUNDED, "sh"])
            .arg(&self.python)
            .args(["-m", "pytest", "--verbose", "--no-header", "--tb=no"])
            // Without the documentation's examples, which the project's own options add.
            .args(["--override-ini=addopts=", "-p", "no:cacheprovider"])
            .args(arguments)
            .current_dir(self.copy.path("adapters/python"))
            // The order of sets' texts is the same in each run.
            .envs([("PYTHONHASHSEED", "0"), ("PYTHONUNBUFFERED", "1")])
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("PYTHONPATH", package);
        Ok(command)
    }

    /// Runs the witnesses until they end or their time is up; what ended them shows in what they printed.
    fn run_until_ended(&self, kind: &EvidenceKind, log: &PathBuf) -> Result<(), EvidenceError> {
        let folder = log.parent().unwrap_or(log);
        fs::create_dir_all(folder).map_err(EvidenceError::file(folder))?;
        let Some(mut command) = self.command(kind)? else { return Ok(()) };
        let out = File::create(log).map_err(EvidenceError::file(log))?;
        let err = out.try_clone().map_err(EvidenceError::file(log))?;
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::from(out))
            .stderr(Stdio::from(err))
            .process_group(0)
            .spawn()
            .map_err(EvidenceError::file(self.copy.root()))?;
        let group = Pid::from_child(&child);
        let start = Instant::now();
        loop {
            if child.try_wait().map_err(EvidenceError::file(self.copy.root()))?.is_some() {
                return Ok(());
            }
            let stopped = self.stop.load(Ordering::Acquire);
            if stopped || start.elapsed() > self.limit {
                // It may have ended just now.
                let _ = kill_process_group(group, Signal::KILL);
                child.wait().map_err(EvidenceError::file(self.copy.root()))?;
                return if stopped { Err(EvidenceError::Interrupted) } else { Ok(()) };
            }
            thread::sleep(GLANCE);
        }
    }
}
