//! The copy of the project in which faults are seeded and witnesses run.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use serde_json::Value;

use crate::artifacts::{primary_places, take_program};
use crate::cases::INTERFACES;
use crate::error::FaultsError;
use crate::kind::{BuildSuite, Program, WitnessKind};
use crate::printed::{Outcomes, failures};
use crate::schemata::{REACHED, VARIABLE};
use crate::tree::{Tree, write};

/// The exit code of a program that a signal ended.
const KILLED: i32 = -1;
/// The time between two looks at a running program.
const GLANCE: Duration = Duration::from_millis(10);
/// The number of scenarios in which the operators of Python and of tokio are compared.
const SCENARIOS: &str = "100";
/// A faulty machine may allocate without end. No sound witness needs 4 GiB.
const BOUNDED: &str = "ulimit -v 4194304; exec \"$@\"";

/// The copy, with a target folder of its own.
pub(crate) struct FaultyCopy<'a> {
    /// The project itself.
    pub(crate) tree: &'a Tree,
    pub(crate) copy: Tree,
    pub(crate) target: PathBuf,
    /// The interpreter with the packages of the wheel's tests, as `.ci/python` installs them.
    pub(crate) python: PathBuf,
    /// The interpreter with the packages of the peers, as `.ci/ros2` installs them.
    pub(crate) peers: PathBuf,
    pub(crate) stop: &'a AtomicBool,
}

/// The programs of a suite by package and target, each with the folder in which it runs.
pub(crate) type Programs = BTreeMap<(String, String), (PathBuf, PathBuf)>;

/// The result of a build.
pub(crate) enum Built {
    Programs(Programs),
    /// The sources do not compile at these places, each a file and a byte.
    Refused(Vec<(String, usize)>, String),
}

/// One run of the witnesses of a kind.
#[derive(Clone, Copy)]
pub(crate) struct Trial<'a> {
    /// The number and the name of the fault. The number is 0 without a fault.
    pub(crate) fault: (u32, &'a str),
    /// The only case of misuse that runs, or `None` for all cases.
    pub(crate) case: Option<&'a str>,
    pub(crate) limit: Duration,
    /// `true` if the run ends at the first witness that fails.
    pub(crate) stops: bool,
    /// Returns `true` if the run may end once these witnesses have failed, because the others can
    /// show nothing more.
    pub(crate) is_enough: &'a dyn Fn(&BTreeSet<String>) -> bool,
    /// The faults that each program reached without a fault. A program that never reached this
    /// fault does not run.
    pub(crate) reached: Option<&'a ReachedFaults>,
}

/// The numbers of the faults whose functions a program called, by the program's target.
pub(crate) type ReachedFaults = BTreeMap<&'static str, BTreeSet<u32>>;

/// The results of a kind's witnesses.
#[derive(Default)]
pub(crate) struct WitnessRun {
    pub(crate) outcomes: Outcomes,
    pub(crate) is_out_of_time: bool,
    pub(crate) took: Duration,
    /// The faults that each program reached, if it ran without a fault.
    pub(crate) reached: ReachedFaults,
}

impl Trial<'_> {
    /// Returns `true` if the run may end once these witnesses have failed. A case of misuse runs to
    /// its end.
    fn ends(&self, red: &BTreeSet<String>) -> bool {
        self.case.is_none() && !red.is_empty() && (self.stops || (self.is_enough)(red))
    }
}

impl WitnessRun {
    pub(crate) fn red(&self) -> BTreeSet<String> {
        self.outcomes.iter().filter(|(_, held)| !**held).map(|(name, _)| name.clone()).collect()
    }
}

impl FaultyCopy<'_> {
    /// Builds the programs of a suite from the copy.
    ///
    /// # Errors
    /// Returns an error if cargo cannot be run, or fails for a reason other than the sources.
    pub(crate) fn build(&self, suite: &BuildSuite) -> Result<Built, FaultsError> {
        if suite.packages.is_empty() {
            return self.build_wheel();
        }
        let mut programs = Programs::new();
        for (words, targets) in
            [(&["test", "--no-run"][..], suite.tests), (&["build"], suite.programs)]
        {
            if targets.is_empty() {
                continue;
            }
            match self.build_targets(suite, words, targets)? {
                Built::Programs(built) => programs.extend(built),
                refused @ Built::Refused(..) => return Ok(refused),
            }
        }
        Ok(Built::Programs(programs))
    }

    fn build_targets(
        &self,
        suite: &BuildSuite,
        words: &[&str],
        targets: &[&str],
    ) -> Result<Built, FaultsError> {
        let mut command = Self::cargo(self.copy.root());
        // Other flags of the compiler would build everything again, so they get a folder of their
        // own.
        let is_apart = suite.variables.iter().any(|(name, _)| *name == "RUSTFLAGS");
        let target = self.target.join(if is_apart { suite.name } else { "plain" });
        command
            .args(words)
            .args(["--locked", "--message-format=json"])
            .args(suite.packages)
            .args(targets)
            .env("CARGO_TARGET_DIR", target)
            .envs(suite.variables.iter().copied());
        let log = self.log(suite.name, "build");
        let errors = create(&log)?;
        let child = command.stderr(errors).stdout(Stdio::piped()).process_group(0).spawn();
        let printed = self.until_ended(child.map_err(FaultsError::file(self.copy.root()))?)?;
        let (mut programs, mut places, mut said) = (Programs::new(), Vec::new(), String::new());
        for message in printed.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
            match message["reason"].as_str() {
                Some("compiler-artifact") => take_program(&message, &mut programs),
                Some("compiler-message") if message["message"]["level"] == "error" => {
                    said.push_str(message["message"]["rendered"].as_str().unwrap_or_default());
                    places.extend(primary_places(&message["message"]));
                }
                Some("build-finished") if message["success"] == true => {
                    return Ok(Built::Programs(programs));
                }
                _ => {}
            }
        }
        if said.is_empty() {
            let (what, why) = (suite.name.to_owned(), "cargo cannot build it".to_owned());
            return Err(FaultsError::Run { what, why, log });
        }
        fs::write(&log, &said).map_err(FaultsError::file(&log))?;
        Ok(Built::Refused(places, said))
    }

    /// Builds the compiled part of the wheel, and puts it where the copy's package expects it.
    fn build_wheel(&self) -> Result<Built, FaultsError> {
        let folder = self.copy.path("adapters/python");
        if !self.python.exists() {
            let why = "the wheel's interpreter is not there: .ci/python packages makes it";
            return Err(FaultsError::content(&self.python, why));
        }
        let target = self.target.join("wheel");
        let log = self.log("wheel", "build");
        let mut wheel = Self::cargo(&folder);
        wheel
            .args(["build", "--locked", "--quiet", "--profile", "landing", "--target-dir"])
            .arg(&target)
            .env("PYO3_BUILD_EXTENSION_MODULE", "1")
            .env("PYO3_PYTHON", &self.python);
        // The operator of tokio, with which that of Python is compared.
        let mut scenarios = Self::cargo(self.copy.root());
        scenarios
            .args([
                "build",
                "--locked",
                "--quiet",
                "-p",
                "fuseline-tokio",
                "--example",
                "scenarios",
            ])
            .env("CARGO_TARGET_DIR", self.target.join("plain"));
        for mut build in [wheel, scenarios] {
            let ended = build.stderr(create(&log)?).status().map_err(FaultsError::file(&folder))?;
            if !ended.success() {
                let said = fs::read_to_string(&log).map_err(FaultsError::file(&log))?;
                return Ok(Built::Refused(Vec::new(), said));
            }
        }
        let library = target.join("landing/lib_fuseline.so");
        let there = folder.join("python/fuseline/_fuseline.abi3.so");
        fs::copy(&library, there).map_err(FaultsError::file(&library))?;
        // The package asks for its version, and this interpreter need not have an installed one.
        let metadata = folder.join("python/fuseline.dist-info/METADATA");
        let version = concat!("Name: fuseline\nVersion: ", env!("CARGO_PKG_VERSION"), "\n");
        write(&metadata, version)?;
        let program = ("fuseline-python".to_owned(), "pytest".to_owned());
        Ok(Built::Programs([(program, (self.python.clone(), folder))].into()))
    }

    /// Begins a cargo command for a copy.
    pub(crate) fn cargo(folder: &Path) -> Command {
        let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        command
            .current_dir(folder)
            .stdin(Stdio::null())
            .env("CARGO_NET_OFFLINE", "true")
            .env("CARGO_TERM_COLOR", "never")
            // The recorder of MC/DC needs unstable features. Every command sets this, because cargo
            // rebuilds dependencies when it changes.
            .env("RUSTC_BOOTSTRAP", "fuseline_core,fuseline_c")
            .env_remove("RUSTFLAGS")
            .env_remove("RUSTC_WORKSPACE_WRAPPER");
        command
    }

    /// Runs the witnesses of a kind under the fault with this number, or under none.
    ///
    /// # Errors
    /// Returns an error if a program does not exist or cannot be started, no witness ran, or the
    /// run was interrupted.
    pub(crate) fn run(
        &self,
        kind: &'static WitnessKind,
        programs: &Programs,
        trial: Trial,
    ) -> Result<WitnessRun, FaultsError> {
        let (number, name) = trial.fault;
        let log = self.log(kind.name, name);
        let wrong = |why: &str| FaultsError::Run {
            what: format!("{} under {name}", kind.name),
            why: why.to_owned(),
            log: log.clone(),
        };
        let mut seen = WitnessRun::default();
        remove(&log)?;
        let begin = Instant::now();
        let comes_to_it = |program: &Program| {
            let reached = trial.reached.and_then(|reached| reached.get(program.target));
            reached.is_none_or(|reached| reached.contains(&number))
        };
        let to_run = kind.programs.iter().filter(|program| comes_to_it(program));
        let to_run: Vec<&Program> = to_run.collect();
        for program in &to_run {
            let key = (program.package.to_owned(), program.target.to_owned());
            let place = programs.get(&key);
            let place = place.ok_or_else(|| wrong(&format!("{} was not built", program.target)))?;
            if INTERFACES.iter().any(|(interface, _, _)| kind.interface() == Some(interface)) {
                self.run_cases(kind, place, (trial, begin), &log, &mut seen)?;
                continue;
            }
            let mut command = if kind.is_among_peers() {
                self.among_peers(programs, place, trial)?
            } else {
                self.command(kind, program, place, trial)
            };
            let reached = log.with_extension("reached");
            if number == 0 {
                remove(&reached)?;
                command.env(REACHED, &reached);
            }
            let left = trial.limit.saturating_sub(begin.elapsed());
            let ends = |failed: &str| {
                let mut red = seen.red();
                red.extend((kind.read)(program.target, failed).into_keys());
                trial.ends(&red)
            };
            let (printed, ended) = self.print(&mut command, left, &ends, &log)?;
            let mut outcomes = (kind.read)(program.target, &printed);
            // Pytest's `-k` and the peers select each test whose name contains the case's.
            let case = trial.case.filter(|_| kind.takes_parts_of_names());
            if let Some(case) = case {
                outcomes.retain(|name, _| {
                    name.rsplit("::")
                        .next()
                        .is_some_and(|it| it.strip_prefix("test_").unwrap_or(it) == case)
                });
            }
            if ended.is_none() {
                seen.is_out_of_time = true;
            }
            // If several tests run at once, the output of a program that was killed or ran out of
            // memory does not name the test. It names a case even then. If it does not, there is no
            // such case, and that shows nothing.
            if (case.is_none() || ended.is_none())
                && ended != Some(0)
                && outcomes.values().all(|held| *held)
            {
                let how = if ended.is_none() { "out of time" } else { "ended early" };
                outcomes.insert(format!("{} ({how})", program.target), false);
            }
            seen.outcomes.extend(outcomes);
            if number == 0 {
                let numbers = fs::read_to_string(&reached).unwrap_or_default();
                let numbers = numbers.lines().filter_map(|line| line.parse().ok());
                seen.reached.insert(program.target, numbers.collect());
            }
            if seen.is_out_of_time || trial.ends(&seen.red()) {
                break;
            }
        }
        seen.took = begin.elapsed();
        let is_empty = seen.outcomes.is_empty() && !to_run.is_empty();
        if is_empty { Err(wrong("no witness ran")) } else { Ok(seen) }
    }

    /// Returns the command that runs one case, or all cases, of a node with real peers.
    fn among_peers(
        &self,
        programs: &Programs,
        (node, folder): &(PathBuf, PathBuf),
        trial: Trial,
    ) -> Result<Command, FaultsError> {
        if !self.peers.exists() {
            let why = "the interpreter of the peers is not there: .ci/ros2 --packages makes it";
            return Err(FaultsError::content(&self.peers, why));
        }
        let judge = &programs[&("fuseline".to_owned(), "fuseline".to_owned())].0;
        let mut command = Command::new("sh");
        command
            .args(["-c", BOUNDED, "sh"])
            .arg(&self.peers)
            .arg(self.copy.path("adapters/ros2/tests/peers/run.py"))
            .args([trial.case.unwrap_or("--misuse"), "--node"])
            .arg(node)
            .arg("--fuseline")
            .arg(judge)
            .current_dir(folder)
            .env(VARIABLE, trial.fault.0.to_string())
            .env("PYTHONDONTWRITEBYTECODE", "1");
        Ok(command)
    }

    fn command(
        &self,
        kind: &WitnessKind,
        program: &Program,
        (path, folder): &(PathBuf, PathBuf),
        trial: Trial,
    ) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", BOUNDED, "sh"]).arg(path).current_dir(folder);
        if kind.suite.packages.is_empty() {
            // Leaves out the documentation's examples, which the project's own options add.
            command
                .args([
                    "-m",
                    "pytest",
                    "--verbose",
                    "--no-header",
                    "--tb=no",
                    "--override-ini=addopts=",
                ])
                .args(["-p", "no:cacheprovider"])
                .envs([("PYTHONHASHSEED", "0"), ("PYTHONUNBUFFERED", "1")])
                .env("PYTHONDONTWRITEBYTECODE", "1")
                .env("PYTHONPATH", folder.join("python"))
                .env("FUSELINE_SCENARIOS", self.target.join("plain/debug/examples/scenarios"))
                .env("SCENARIOS", SCENARIOS);
        }
        if let Some(case) = trial.case {
            let is_python = kind.suite.packages.is_empty();
            let python = ["-k".to_owned(), format!("test_{case}")];
            let rust = ["--exact".to_owned(), case.to_owned()];
            command.args(if is_python { python } else { rust });
        }
        command
            // If the first failure is enough, a model does not continue after it.
            .args(program.arguments.iter().filter(|it| !(trial.stops && **it == "--keep-going")))
            .env(VARIABLE, trial.fault.0.to_string())
            .env("CARGO_MANIFEST_DIR", folder)
            .env("RUST_BACKTRACE", "0")
            // If one test runs at a time, the last test that is named hangs.
            .env("RUST_TEST_THREADS", kind.threads)
            .env("PROPTEST_MAX_SHRINK_ITERS", "300")
            .env_remove("PROPTEST_CASES")
            .env_remove("CASES");
        command
    }

    /// Returns a program's output and its exit code, or `None` if it ran out of time. If `ends`
    /// accepts the failures printed so far, ends the program and returns only these failures.
    pub(crate) fn print(
        &self,
        command: &mut Command,
        limit: Duration,
        ends: &dyn Fn(&str) -> bool,
        log: &Path,
    ) -> Result<(String, Option<i32>), FaultsError> {
        let own = log.with_extension("part");
        let out = create(&own)?;
        let err = out.try_clone().map_err(FaultsError::file(&own))?;
        let child = command.stdin(Stdio::null()).stdout(out).stderr(err).process_group(0).spawn();
        let mut child = child.map_err(FaultsError::file(&own))?;
        let begin = Instant::now();
        let (mut failed, mut is_cut) = (String::new(), false);
        let ended = loop {
            if let Some(status) = child.try_wait().map_err(FaultsError::file(&own))? {
                break Some(status.code().unwrap_or(KILLED));
            }
            let is_stopped = self.stop.load(Ordering::Acquire);
            let so_far = failures(&fs::read_to_string(&own).unwrap_or_default());
            let has_failed = so_far.len() > failed.len() && ends(&so_far);
            failed = so_far;
            if is_stopped || has_failed || begin.elapsed() > limit {
                // The child may have ended in the meantime.
                let _ = kill_process_group(Pid::from_child(&child), Signal::KILL);
                child.wait().map_err(FaultsError::file(&own))?;
                if is_stopped {
                    return Err(FaultsError::Interrupted);
                }
                is_cut = has_failed;
                break has_failed.then_some(KILLED);
            }
            thread::sleep(GLANCE);
        };
        let printed = fs::read(&own).map_err(FaultsError::file(&own))?;
        let printed = String::from_utf8_lossy(&printed).into_owned();
        let before = fs::read_to_string(log).unwrap_or_default();
        fs::write(log, before + &printed).map_err(FaultsError::file(log))?;
        fs::remove_file(&own).map_err(FaultsError::file(&own))?;
        // A test that was still running has not failed.
        Ok((if is_cut { failed } else { printed }, ended))
    }

    /// Returns cargo's output.
    fn until_ended(&self, mut child: std::process::Child) -> Result<String, FaultsError> {
        let mut out = child.stdout.take();
        let reader = thread::spawn(move || {
            let mut printed = String::new();
            if let Some(out) = &mut out {
                let _ = std::io::Read::read_to_string(out, &mut printed);
            }
            printed
        });
        while child.try_wait().map_err(FaultsError::file(self.copy.root()))?.is_none() {
            if self.stop.load(Ordering::Acquire) {
                let _ = kill_process_group(Pid::from_child(&child), Signal::KILL);
                child.wait().map_err(FaultsError::file(self.copy.root()))?;
                return Err(FaultsError::Interrupted);
            }
            thread::sleep(GLANCE);
        }
        Ok(reader.join().unwrap_or_default())
    }

    fn log(&self, kind: &str, run: &str) -> PathBuf {
        let run = run.replace(['/', ' '], "-");
        self.target.join("logs").join(format!("{kind}.{run}.txt"))
    }
}

/// Removes a file if it is there.
fn remove(path: &Path) -> Result<(), FaultsError> {
    fs::remove_file(path).or_else(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Ok(()),
        _ => Err(FaultsError::file(path)(error)),
    })
}

fn create(path: &Path) -> Result<File, FaultsError> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(FaultsError::file(folder))?;
    File::create(path).map_err(FaultsError::file(path))
}
