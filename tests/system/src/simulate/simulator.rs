//! Plays scenarios and checks them.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

use fuseline_tokio::Tally;
use tempfile::TempDir;

use crate::judge::Finding;
use crate::simulate::checks::Facts;
use crate::simulate::log::Log;
use crate::simulate::play::{OperatorEnd, RunResult, play};
use crate::simulate::scenario::Scenario;
use crate::simulate::shrink;

/// Plays scenarios, one after the other, with files in its own folder, which is in memory if
/// possible.
pub struct Simulator {
    folder: TempDir,
}

/// The outcome of one run.
pub struct Simulated {
    /// The checks that do not hold.
    pub findings: Vec<Finding>,
    /// The number of messages that were written.
    pub messages: u64,
    /// Its length in virtual time, until the operator was stopped or the last item was read.
    pub life: Duration,
    /// The operator's trace.
    pub trace: Vec<u8>,
    /// The other observations; `None` if a panic came through.
    external_log: Option<ExternalLog>,
}

/// The observations outside of the trace.
#[derive(Debug)]
#[expect(dead_code, reason = "it is shown as a whole")]
struct ExternalLog {
    log: Log,
    ended: OperatorEnd,
    tally: Option<Tally>,
    most: [usize; 2],
    remaining: [usize; 3],
}

impl Simulator {
    /// Creates a simulator.
    ///
    /// # Errors
    /// Returns an error if there is no place for its files.
    pub fn new() -> io::Result<Self> {
        let memory = Path::new("/dev/shm");
        let folder =
            if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        Ok(Self { folder: folder? })
    }

    /// Plays a scenario and checks it.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn simulate(&self, scenario: &Scenario) -> io::Result<Simulated> {
        // The operator's own tasks must handle a panic; this one came through.
        let played = catch_unwind(AssertUnwindSafe(|| play(scenario, self.folder.path())));
        let played = match played {
            Ok(played) => played?,
            Err(panic) => return Ok(Simulated::panicked(&*panic)),
        };
        let findings = Facts::new(scenario, &played).findings();
        Ok(Simulated::new(findings, played))
    }

    /// Returns the smallest run that can be found for which this check does not hold either.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn smallest(&self, scenario: &Scenario, check: &str) -> io::Result<Scenario> {
        shrink::smallest(scenario, |smaller| {
            let findings = self.simulate(smaller)?.findings;
            Ok(findings.iter().any(|finding| finding.check == check))
        })
    }
}

impl Simulated {
    fn new(findings: Vec<Finding>, played: RunResult) -> Self {
        let last = played.log.items.iter().flatten().map(|read| read.at).max().unwrap_or(0);
        let life = Duration::from_nanos(played.log.stopped.unwrap_or(last));
        let RunResult { log, trace, ended, tally, most, remaining, .. } = played;
        let messages = log.written.len() as u64;
        let external_log = Some(ExternalLog { log, ended, tally, most, remaining });
        Self { findings, messages, life, trace, external_log }
    }

    fn panicked(panic: &(dyn std::any::Any + Send)) -> Self {
        let reason = panic.downcast_ref::<String>().map(String::as_str);
        let reason = reason.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words");
        let finding = Finding { check: "d7_no_panic_comes_through", reason: reason.to_owned() };
        let (trace, external_log) = (Vec::new(), None);
        Self { findings: vec![finding], messages: 0, life: Duration::ZERO, trace, external_log }
    }

    /// Describes everything that was seen outside of the trace. The same seed gives the same text.
    #[must_use]
    pub fn external_log(&self) -> String {
        format!("{:#?}", self.external_log)
    }
}
