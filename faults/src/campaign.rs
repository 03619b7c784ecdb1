//! Runs the witnesses of every kind under every fault.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use crate::citation;
use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::kind::{BuildSuite, KINDS, WitnessKind};
use crate::schemata;
use crate::table::{ENOUGH, ExpectedWitnesses};
use crate::tree::Tree;
use crate::work::{FaultyCopy, Programs, Trial, WitnessRun};

/// A witness may take this many times as long as it took without a fault.
const PATIENCE: u32 = 4;
/// The least time limit of a witness.
const LEAST: Duration = Duration::from_secs(30);
/// The greatest time limit of one case of misuse.
const FOR_A_CASE: Duration = Duration::from_secs(120);
/// The time limit of a witness whose usual time is unknown.
const PATIENT: Duration = Duration::from_secs(900);

/// The settings of a campaign.
pub struct Campaign<'a> {
    /// The project.
    pub tree: &'a Tree,
    /// cargo's target folder.
    pub target: PathBuf,
    /// The kinds of witness.
    pub kinds: &'a [&'static WitnessKind],
    /// All faults. One build contains all of them, even if only some run.
    pub faults: &'a [SeededFault],
    /// The names of the faults that run.
    pub chosen: &'a BTreeSet<String>,
    /// The witnesses that must show each identifier, by kind.
    pub expected: &'a ExpectedWitnesses,
    /// `true` if each kind runs that could see a fault. Otherwise the kinds stop once two have
    /// caught it.
    pub thorough: bool,
    /// The number of witnesses that run at once, at least 1.
    pub jobs: usize,
    /// Ends the campaign early when it is set.
    pub stop: &'a AtomicBool,
}

/// The witnesses that caught a fault.
#[derive(Clone, Debug, Default)]
pub struct Catches {
    /// The witnesses that failed, by kind. The set is empty if the kind ran and caught nothing.
    pub by: BTreeMap<&'static str, BTreeSet<String>>,
    /// The kinds that ran out of time.
    pub out_of_time: BTreeSet<&'static str>,
    /// The reason why the fault had a build of its own, if it had one.
    pub own_build: Option<String>,
}

/// The results of a campaign.
#[derive(Debug, Default)]
pub struct CampaignFindings {
    /// The faults that ran, by name.
    pub faults: BTreeMap<String, Catches>,
    /// The witnesses that held without a fault, by kind.
    pub held: BTreeMap<&'static str, BTreeSet<String>>,
    /// The kinds with a witness that cites an identifier and failed under a fault of it, by
    /// identifier.
    pub(crate) shown: BTreeMap<String, BTreeSet<&'static str>>,
    /// The number of runs under a fault, and how many of them caught it, by kind.
    tries: BTreeMap<&'static str, (u32, u32)>,
}

/// The results of each kind's witnesses without a fault.
type FaultlessRuns = BTreeMap<&'static str, WitnessRun>;

impl Catches {
    /// Returns the number of kinds that caught the fault.
    pub(crate) fn kinds(&self) -> usize {
        self.by.values().filter(|by| !by.is_empty()).count()
    }
}

impl Campaign<'_> {
    /// Runs the witnesses; `report` is called with each step.
    ///
    /// # Errors
    /// Returns an error if a witness fails without a fault, something does not build without one,
    /// or `stop` was set.
    pub fn run(&self, report: impl Fn(&str) + Sync) -> Result<CampaignFindings, FaultsError> {
        let folder = self.target.join("faults");
        let work = FaultyCopy {
            tree: self.tree,
            copy: Tree::new(folder.join("tree")),
            target: folder.join("build"),
            python: self.target.join("python/venv/bin/python"),
            peers: self.target.join("ros2-peers/bin/python"),
            stop: self.stop,
        };
        let mut apart = BTreeMap::new();
        for (number, fault) in self.numbered() {
            if !schemata::can_share(fault) {
                let stated = fault.own_build.clone();
                apart.insert(
                    number,
                    stated.unwrap_or_else(|| "it is in no body of a function".into()),
                );
            }
        }
        let (programs, texts) = self.build_shared(&work, &mut apart, &report)?;
        let mut findings = CampaignFindings::default();
        let mut faultless = FaultlessRuns::new();
        for (kind, mut seen) in self.without_fault(&work, &programs, &report)? {
            let held = std::mem::take(&mut seen.outcomes).into_keys().collect();
            findings.held.insert(kind.name, held);
            faultless.insert(kind.name, seen);
        }
        let chosen = self.numbered().filter(|(_, fault)| self.chosen.contains(&fault.name));
        let (alone, shared): (Vec<_>, Vec<_>) =
            chosen.partition(|(number, _)| apart.contains_key(number));
        let next = AtomicUsize::new(0);
        let found = Mutex::new(findings);
        self.at_once(|| {
            while let Some((number, fault)) = shared.get(next.fetch_add(1, Ordering::Relaxed)) {
                self.witness(&work, (*number, fault), &programs, &faultless, &found, &report)?;
            }
            Ok(())
        })?;
        for (number, fault) in alone {
            let why = apart.remove(&number).unwrap_or_default();
            report(&format!("{} has a build of its own: {why}", fault.name));
            let programs = self.build_apart(&work, &texts, fault)?;
            // Nobody knows which programs reach it.
            for seen in faultless.values_mut() {
                seen.reached.clear();
            }
            self.witness(&work, (number, fault), &programs, &faultless, &found, &report)?;
            if let Some(caught) = lock(&found).faults.get_mut(&fault.name) {
                caught.own_build = Some(why);
            }
        }
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs all witnesses on the sources without a fault. Each of them must hold.
    fn without_fault(
        &self,
        work: &FaultyCopy,
        programs: &BTreeMap<&'static str, Programs>,
        report: &(impl Fn(&str) + Sync),
    ) -> Result<Vec<(&'static WitnessKind, WitnessRun)>, FaultsError> {
        let chosen = || self.faults.iter().filter(|fault| self.chosen.contains(&fault.name));
        let kinds = self.kinds.iter().filter(|kind| chosen().any(|fault| kind.sees(fault)));
        let kinds: Vec<&'static WitnessKind> = kinds.copied().collect();
        let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        self.at_once(|| {
            while let Some(kind) = kinds.get(next.fetch_add(1, Ordering::Relaxed)) {
                let trial = Trial {
                    fault: (0, "none"),
                    case: None,
                    limit: PATIENT,
                    stops: false,
                    is_enough: &|_| false,
                    reached: None,
                };
                let seen = work.run(kind, &programs[kind.suite.name], trial)?;
                let red = Vec::from_iter(seen.red());
                if !red.is_empty() {
                    let why = format!("{} fails without a fault: {}", kind.name, red.join(", "));
                    return Err(FaultsError::content(&work.target.join("logs"), why));
                }
                report(&format!("{} without a fault: {:.1} s", kind.name, seen.took.as_secs_f64()));
                lock(&done).push((*kind, seen));
            }
            Ok(())
        })?;
        Ok(done.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs the kinds that could see a fault until none can show more. It begins with kinds that
    /// catch many faults in little time.
    fn witness(
        &self,
        work: &FaultyCopy,
        (number, fault): (u32, &SeededFault),
        programs: &BTreeMap<&'static str, Programs>,
        faultless: &FaultlessRuns,
        found: &Mutex<CampaignFindings>,
        report: &(impl Fn(&str) + Sync),
    ) -> Result<(), FaultsError> {
        let mut kinds: Vec<&'static WitnessKind> = self.seeing(fault).collect();
        {
            let tries = &lock(found).tries;
            kinds.sort_by_key(|kind| {
                let (runs, catches) = tries.get(kind.name).copied().unwrap_or_default();
                let took = faultless.get(kind.name).map_or(PATIENT, |it| it.took);
                took * (runs + 1) / (catches + 1)
            });
        }
        for kind in kinds {
            let is_settled = self.is_settled(kind, fault, &BTreeSet::new(), &lock(found));
            let is_enough =
                |red: &BTreeSet<String>| self.is_settled(kind, fault, red, &lock(found));
            let by = lock(found).faults.get(&fault.name).map_or(0, Catches::kinds);
            if is_settled && by >= ENOUGH {
                continue;
            }
            let sound = faultless.get(kind.name);
            // A witness that takes much longer than it did without a fault has failed.
            let limit = sound.map_or(PATIENT, |sound| (sound.took * PATIENCE).max(LEAST));
            let case = fault.case.as_ref().map(|case| &*case.name);
            let trial = Trial {
                fault: (number, &*fault.name),
                case,
                limit: if case.is_some() { limit.min(FOR_A_CASE) } else { limit },
                stops: kind.stops || is_settled,
                is_enough: &is_enough,
                reached: sound.map(|sound| &sound.reached),
            };
            let seen = work.run(kind, &programs[kind.suite.name], trial)?;
            let cited = citation::cited(self.tree, kind, &seen.red())?;
            let mut found = lock(found);
            for id in cited.intersection(&fault.breaks) {
                found.shown.entry(id.clone()).or_default().insert(kind.name);
            }
            let caught = found.faults.entry(fault.name.clone()).or_default();
            caught.by.insert(kind.name, seen.red());
            if seen.is_out_of_time {
                caught.out_of_time.insert(kind.name);
            }
            let (took, red) = (seen.took.as_secs_f64(), caught.by[kind.name].len());
            let (runs, catches) = found.tries.entry(kind.name).or_default();
            (*runs, *catches) = (*runs + 1, *catches + u32::from(red > 0));
            let ended = found.faults.len();
            report(&format!("{ended}: {}: {} {red}, {took:.1} s", fault.name, kind.name));
        }
        Ok(())
    }

    /// Returns `true` if this kind can show nothing more, once these witnesses have failed, than
    /// that it catches the fault. Then it or two others have shown each of the fault's identifiers,
    /// and the expected witness of this kind has failed under a fault of each.
    fn is_settled(
        &self,
        kind: &WitnessKind,
        fault: &SeededFault,
        red: &BTreeSet<String>,
        found: &CampaignFindings,
    ) -> bool {
        let Ok(cited) = citation::cited(self.tree, kind, red) else { return false };
        let is_met = |id: &String| {
            let Some(name) = self.expected.get(id).and_then(|of| of.get(kind.name)) else {
                return true;
            };
            let of_id = self.faults.iter().filter(|fault| fault.breaks.contains(id));
            let mut caught = of_id.filter_map(|fault| found.faults.get(&fault.name));
            red.contains(name)
                || caught.any(|it| it.by.get(kind.name).is_some_and(|by| by.contains(name)))
        };
        // An ambiguity needs no witness of its own.
        let is_shown = |id: &String| {
            let by = found.shown.get(id);
            let has_shown =
                |kinds: &BTreeSet<_>| kinds.len() >= ENOUGH || kinds.contains(kind.name);
            id.starts_with('A') || cited.contains(id) || by.is_some_and(has_shown)
        };
        !self.thorough && fault.breaks.iter().all(|id| is_met(id) && is_shown(id))
    }

    pub(crate) fn numbered(&self) -> impl Iterator<Item = (u32, &SeededFault)> {
        (1..).zip(self.faults)
    }

    /// Returns the parts of all faults, each with its fault's number. Guards are included only if
    /// one of them is to run, because a landing removes none.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (u32, &SeededFault)> {
        let mut chosen = self.faults.iter().filter(|fault| self.chosen.contains(&fault.name));
        let has_guards = chosen.any(|fault| fault.case.is_some());
        let faults = self.numbered().filter(move |(_, fault)| has_guards || fault.case.is_none());
        faults.flat_map(|(number, fault)| fault.parts().map(move |part| (number, part)))
    }

    pub(crate) fn seeing(&self, fault: &SeededFault) -> impl Iterator<Item = &'static WitnessKind> {
        let kinds = self.kinds.iter().copied().filter(|kind| kind.sees(fault));
        kinds.collect::<Vec<_>>().into_iter()
    }

    /// Returns the suites that the chosen faults need.
    pub(crate) fn suites(&self) -> BTreeMap<&'static str, &'static BuildSuite> {
        let chosen = self.faults.iter().filter(|fault| self.chosen.contains(&fault.name));
        chosen
            .flat_map(|fault| self.seeing(fault))
            .map(|kind| (kind.suite.name, kind.suite))
            .collect()
    }

    pub(crate) fn name(&self, number: u32) -> &str {
        let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
        index.and_then(|index| self.faults.get(index)).map_or("none", |fault| &fault.name)
    }

    /// Does the same work in as many threads as `jobs` allows.
    fn at_once(
        &self,
        worker: impl Fn() -> Result<(), FaultsError> + Sync,
    ) -> Result<(), FaultsError> {
        thread::scope(|scope| {
            let workers: Vec<_> = (0..self.jobs.max(1)).map(|_| scope.spawn(&worker)).collect();
            workers.into_iter().try_for_each(|worker| match worker.join() {
                Ok(done) => done,
                Err(panic) => std::panic::resume_unwind(panic),
            })
        })
    }
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the kinds with these names, or all kinds if no name is given.
///
/// # Errors
/// Returns an error if there is no kind with one of these names.
pub fn kinds(names: &[String]) -> Result<Vec<&'static WitnessKind>, String> {
    if names.is_empty() {
        return Ok(KINDS.iter().collect());
    }
    let kind = |name: &String| {
        let known = || KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        WitnessKind::find(name)
            .ok_or_else(|| format!("there is no kind {name}; there are {}", known()))
    };
    names.iter().map(kind).collect()
}
