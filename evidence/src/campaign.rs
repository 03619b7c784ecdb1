//! Runs every kind of witness under every fault.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use crate::error::EvidenceError;
use crate::fault::SeededFault;
use crate::kind::{EvidenceKind, RunMethod};
use crate::record::{FaultResult, KindRecord};
use crate::tree::Tree;
use crate::work_copy::WorkCopy;

/// What to run, and how.
pub struct Campaign<'a> {
    /// The project.
    pub tree: &'a Tree,
    /// The kinds of witness; one with a command of its own is passed over.
    pub kinds: &'a [&'static EvidenceKind],
    /// The faults.
    pub faults: &'a [SeededFault],
    /// How many copies are worked on at once; at least 1.
    pub jobs: usize,
    /// How long one run of one kind may take, building included; then its witnesses that did not end are red.
    pub limit: Duration,
    /// Whether to run again what the records already say.
    pub again: bool,
    /// Set from outside to end early.
    pub stop: &'a AtomicBool,
}

/// What a campaign found: the faults, each with who caught it, by kind.
pub type CampaignSummary = BTreeMap<String, BTreeMap<&'static str, BTreeSet<String>>>;

/// One kind under one fault.
type CampaignTask<'a> = (&'static EvidenceKind, &'a SeededFault);

impl Campaign<'_> {
    /// Runs what the records lack, and keeps each result as it comes.
    ///
    /// `tell` is called for each run as it ends, with how many ended and how many there are.
    ///
    /// # Errors
    /// A witness is red without a fault, a run says nothing, or `stop` was set.
    pub fn run(
        &self,
        tell: impl Fn(&str, usize, usize) + Sync,
    ) -> Result<CampaignSummary, EvidenceError> {
        let lanes: Vec<WorkCopy> =
            (0..self.jobs.max(1)).map(|number| self.work_copy(number)).collect();
        for work_copy in &lanes {
            self.tree.copy_to(&work_copy.copy)?;
        }
        let rustc = version(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()))?;
        if self.kinds.iter().any(|kind| matches!(kind.run, RunMethod::DrivePrinted { .. })) {
            tell("the command", 0, 0);
            self.build_command()?;
        }
        let mut records = BTreeMap::new();
        let kinds: Vec<&'static EvidenceKind> =
            self.kinds.iter().copied().filter(|kind| kind.is_run_here()).collect();
        for kind in &kinds {
            tell(&format!("{} without a fault", kind.title), 0, 0);
            records.insert(kind.name, self.begin(kind, &lanes[0], &rustc)?);
        }
        let tasks: Vec<CampaignTask> = self
            .faults
            .iter()
            .flat_map(|fault| kinds.iter().map(move |kind| (*kind, fault)))
            .filter(|(kind, fault)| (kind.concerns)(fault))
            .filter(|(kind, fault)| self.again || records[kind.name].caught(fault).is_none())
            .collect();
        let records = Mutex::new(records);
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = |work_copy: &WorkCopy| -> Result<(), EvidenceError> {
            while let Some((kind, fault)) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
                let outcomes = work_copy.run(kind, Some(fault))?;
                let by = outcomes.into_iter().filter(|(_, held)| !held).map(|(name, _)| name);
                let caught = FaultResult { change: fault.digest(), by: by.collect() };
                let ended = done.fetch_add(1, Ordering::Relaxed) + 1;
                tell(&format!("{} under {}", kind.title, fault.name), ended, tasks.len());
                let mut records = records.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                if let Some(record) = records.get_mut(kind.name) {
                    record.faults.insert(fault.name.clone(), caught);
                    record.save(self.tree, kind)?;
                }
            }
            Ok(())
        };
        thread::scope(|scope| {
            let work = &work;
            let workers: Vec<_> =
                lanes.iter().map(|work_copy| scope.spawn(move || work(work_copy))).collect();
            workers.into_iter().try_for_each(|worker| match worker.join() {
                Ok(done) => done,
                Err(panic) => std::panic::resume_unwind(panic),
            })
        })?;
        let records = records.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        Ok(self.summary(&kinds, &records))
    }

    /// The record to go on with: the one that is there if it is current, else that of a run without a fault.
    fn begin(
        &self,
        kind: &'static EvidenceKind,
        work_copy: &WorkCopy,
        rustc: &str,
    ) -> Result<KindRecord, EvidenceError> {
        let sources = kind.digest(&work_copy.copy)?;
        let there = KindRecord::load(self.tree, kind)?;
        if let Some(record) = there.filter(|record| record.sources == sources && !self.again) {
            return Ok(record);
        }
        let outcomes = work_copy.run(kind, None)?;
        let red: Vec<&str> =
            outcomes.iter().filter(|(_, held)| !**held).map(|(name, _)| &**name).collect();
        if !red.is_empty() {
            return Err(EvidenceError::Run {
                kind: kind.name,
                run: "none".to_owned(),
                why: format!("red without a fault: {}", red.join(", ")),
                log: work_copy.target.join("logs"),
            });
        }
        let held = outcomes.into_keys().collect();
        let rustc = if matches!(kind.run, RunMethod::Pytest { .. }) {
            version(&work_copy.python)?
        } else {
            rustc.to_owned()
        };
        Ok(KindRecord { sources, rustc, held, faults: BTreeMap::new() })
    }

    fn summary(
        &self,
        kinds: &[&'static EvidenceKind],
        records: &BTreeMap<&'static str, KindRecord>,
    ) -> CampaignSummary {
        let by_kind = |fault: &SeededFault| {
            let of_it = kinds.iter().filter(|kind| (kind.concerns)(fault));
            let caught = of_it.map(|kind| {
                let by = records.get(kind.name).and_then(|record| record.caught(fault));
                (kind.name, by.cloned().unwrap_or_default())
            });
            caught.collect()
        };
        self.faults.iter().map(|fault| (fault.name.clone(), by_kind(fault))).collect()
    }

    /// The folder of what is built of the project itself.
    fn built(&self) -> PathBuf {
        let named = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
        self.tree.path(named.unwrap_or_else(|| "target".into()))
    }

    /// Builds the project's own command.
    fn build_command(&self) -> Result<(), EvidenceError> {
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.args(["build", "--locked", "--quiet", "--release", "-p", "fuseline"]);
        let ended = cargo.arg("--target-dir").arg(self.built()).current_dir(self.tree.root());
        let ended = ended.status().map_err(EvidenceError::file(self.tree.root()))?;
        if ended.success() {
            return Ok(());
        }
        Err(EvidenceError::content(
            self.tree.root(),
            format!("the command does not build: {ended}"),
        ))
    }

    fn work_copy(&self, number: usize) -> WorkCopy<'_> {
        let folder = self.tree.path("target/evidence").join(number.to_string());
        WorkCopy {
            copy: Tree::new(folder.join("source")),
            target: folder.join("target"),
            command: self.built().join("release/fuseline"),
            python: self.built().join("python/venv/bin/python"),
            limit: self.limit,
            stop: self.stop,
        }
    }
}

/// The version of a compiler or an interpreter.
fn version(of: impl AsRef<OsStr>) -> Result<String, EvidenceError> {
    let printed = Command::new(&of).arg("--version").output();
    let printed = printed.map_err(EvidenceError::file(of.as_ref().as_ref()))?;
    Ok(String::from_utf8_lossy(&printed.stdout).trim().to_owned())
}
