//! Runs the witnesses of every kind under every fault.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::items::{Function, FunctionIndex};
use crate::kind::{BuildSuite, KINDS, WitnessKind};
use crate::schemata::{self, Rewritten};
use crate::table::ExpectedWitnesses;
use crate::tree::Tree;
use crate::work::{Built, FaultyCopy, Programs, WitnessRun};

/// A witness has this many times as long as it took without a fault.
const PATIENCE: u32 = 10;
/// The least that it has.
const LEAST: Duration = Duration::from_secs(30);
/// What a witness has where nobody knows how long it takes.
const PATIENT: Duration = Duration::from_secs(900);

/// What to run, and how.
pub struct Campaign<'a> {
    /// The project.
    pub tree: &'a Tree,
    /// cargo's target folder.
    pub target: PathBuf,
    /// The kinds of witness.
    pub kinds: &'a [&'static WitnessKind],
    /// All faults, so that one build has them all, whichever run.
    pub faults: &'a [SeededFault],
    /// The names of those that run.
    pub chosen: &'a BTreeSet<String>,
    /// The witnesses that must show each identifier, by kind.
    pub expected: &'a ExpectedWitnesses,
    /// Whether each kind runs that could see a fault, and not only until two have caught it.
    pub thorough: bool,
    /// How many witnesses run at once; at least 1.
    pub jobs: usize,
    /// Set from outside to end early.
    pub stop: &'a AtomicBool,
}

/// Who caught a fault.
#[derive(Clone, Debug, Default)]
pub struct Catches {
    /// By kind: the witnesses that failed; an empty set is a kind that ran and caught nothing.
    pub by: BTreeMap<&'static str, BTreeSet<String>>,
    /// The kinds whose time was up.
    pub out_of_time: BTreeSet<&'static str>,
    /// Whether it had a build of its own, and why.
    pub own_build: Option<String>,
}

/// What a campaign found.
#[derive(Debug, Default)]
pub struct CampaignFindings {
    /// The faults that ran, by name.
    pub faults: BTreeMap<String, Catches>,
    /// The witnesses that held without a fault, by kind.
    pub held: BTreeMap<&'static str, BTreeSet<String>>,
}

/// The files that differ from the project's, with their texts.
type Texts = BTreeMap<String, String>;

/// The faults of a file, and the words `const` that it does without.
type FileChanges<'a> = (Vec<(u32, &'a SeededFault)>, Vec<std::ops::Range<usize>>);

impl Campaign<'_> {
    /// Runs the witnesses; `tell` is called with each step.
    ///
    /// # Errors
    /// A witness fails without a fault, something does not build without one, or `stop` was set.
    pub fn run(&self, tell: impl Fn(&str) + Sync) -> Result<CampaignFindings, FaultsError> {
        let folder = self.target.join("faults");
        let work = FaultyCopy {
            copy: Tree::new(folder.join("tree")),
            target: folder.join("build"),
            python: self.target.join("python/venv/bin/python"),
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
        let (programs, texts) = self.build_shared(&work, &mut apart, &tell)?;
        let mut findings = CampaignFindings::default();
        let mut limits = BTreeMap::new();
        for (kind, seen) in self.without_fault(&work, &programs, &tell)? {
            limits.insert(kind.name, (seen.took * PATIENCE).max(LEAST));
            findings.held.insert(kind.name, seen.outcomes.into_keys().collect());
        }
        let chosen = self.numbered().filter(|(_, fault)| self.chosen.contains(&fault.name));
        let (alone, shared): (Vec<_>, Vec<_>) =
            chosen.partition(|(number, _)| apart.contains_key(number));
        let next = AtomicUsize::new(0);
        let found = Mutex::new(findings);
        self.at_once(|| {
            while let Some((number, fault)) = shared.get(next.fetch_add(1, Ordering::Relaxed)) {
                self.witness(&work, (*number, fault), &programs, &limits, &found, &tell)?;
            }
            Ok(())
        })?;
        for (number, fault) in alone {
            let why = apart.remove(&number).unwrap_or_default();
            tell(&format!("{} has a build of its own: {why}", fault.name));
            let programs = self.build_apart(&work, &texts, fault)?;
            self.witness(&work, (number, fault), &programs, &limits, &found, &tell)?;
            if let Some(caught) = lock(&found).faults.get_mut(&fault.name) {
                caught.own_build = Some(why);
            }
        }
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs all witnesses as they are: each must hold.
    fn without_fault(
        &self,
        work: &FaultyCopy,
        programs: &BTreeMap<&'static str, Programs>,
        tell: &(impl Fn(&str) + Sync),
    ) -> Result<Vec<(&'static WitnessKind, WitnessRun)>, FaultsError> {
        let chosen = || self.faults.iter().filter(|fault| self.chosen.contains(&fault.name));
        let kinds = self.kinds.iter().filter(|kind| chosen().any(|fault| (kind.concerns)(fault)));
        let kinds: Vec<&'static WitnessKind> = kinds.copied().collect();
        let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        self.at_once(|| {
            while let Some(kind) = kinds.get(next.fetch_add(1, Ordering::Relaxed)) {
                let seen = work.run(kind, &programs[kind.suite.name], (0, "none"), PATIENT)?;
                let red = Vec::from_iter(seen.red());
                if !red.is_empty() {
                    let why = format!("{} fails without a fault: {}", kind.name, red.join(", "));
                    return Err(FaultsError::content(&work.target.join("logs"), why));
                }
                tell(&format!("{} without a fault: {:.1} s", kind.name, seen.took.as_secs_f64()));
                lock(&done).push((*kind, seen));
            }
            Ok(())
        })?;
        Ok(done.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs the kinds that could see a fault, the short ones first, until nothing more is to be known.
    fn witness(
        &self,
        work: &FaultyCopy,
        (number, fault): (u32, &SeededFault),
        programs: &BTreeMap<&'static str, Programs>,
        limits: &BTreeMap<&'static str, Duration>,
        found: &Mutex<CampaignFindings>,
        tell: &(impl Fn(&str) + Sync),
    ) -> Result<(), FaultsError> {
        let mut kinds: Vec<&'static WitnessKind> = self.seeing(fault).collect();
        kinds.sort_by_key(|kind| limits.get(kind.name).copied().unwrap_or_default());
        for kind in kinds {
            if self.is_enough(kind, fault, &lock(found)) {
                continue;
            }
            // Whatever takes longer without a fault is broken.
            let limit = limits.get(kind.name).copied().unwrap_or(PATIENT);
            let seen = work.run(kind, &programs[kind.suite.name], (number, &fault.name), limit)?;
            let mut found = lock(found);
            let caught = found.faults.entry(fault.name.clone()).or_default();
            caught.by.insert(kind.name, seen.red());
            if seen.is_out_of_time {
                caught.out_of_time.insert(kind.name);
            }
            let (took, red) = (seen.took.as_secs_f64(), caught.by[kind.name].len());
            let ended = found.faults.len();
            tell(&format!("{ended}: {}: {} {red}, {took:.1} s", fault.name, kind.name));
        }
        Ok(())
    }

    /// Whether a fault was caught by two kinds, and an expected witness of this kind has failed under a fault of each of its
    /// identifiers.
    fn is_enough(&self, kind: &WitnessKind, fault: &SeededFault, found: &CampaignFindings) -> bool {
        let caught = found.faults.get(&fault.name);
        let kinds = caught.map_or(0, |it| it.by.values().filter(|by| !by.is_empty()).count());
        let is_shown = |id: &String| {
            let Some(name) = self.expected.get(id).and_then(|of| of.get(kind.name)) else {
                return true;
            };
            let of_id = self.faults.iter().filter(|fault| fault.breaks.contains(id));
            let mut caught = of_id.filter_map(|fault| found.faults.get(&fault.name));
            caught.any(|it| it.by.get(kind.name).is_some_and(|by| by.contains(name)))
        };
        !self.thorough && kinds >= 2 && fault.breaks.iter().all(is_shown)
    }

    fn numbered(&self) -> impl Iterator<Item = (u32, &SeededFault)> {
        (1..).zip(self.faults)
    }

    fn seeing(&self, fault: &SeededFault) -> impl Iterator<Item = &'static WitnessKind> {
        self.kinds
            .iter()
            .copied()
            .filter(|kind| (kind.concerns)(fault))
            .collect::<Vec<_>>()
            .into_iter()
    }

    /// The suites that the chosen faults need.
    fn suites(&self) -> BTreeMap<&'static str, &'static BuildSuite> {
        let chosen = self.faults.iter().filter(|fault| self.chosen.contains(&fault.name));
        chosen
            .flat_map(|fault| self.seeing(fault))
            .map(|kind| (kind.suite.name, kind.suite))
            .collect()
    }

    /// Builds all faults at once. One that does not compile beside the others has a build of its own.
    fn build_shared(
        &self,
        work: &FaultyCopy,
        apart: &mut BTreeMap<u32, String>,
        tell: &impl Fn(&str),
    ) -> Result<(BTreeMap<&'static str, Programs>, Texts), FaultsError> {
        'again: loop {
            let rewritten = self.rewritten(apart)?;
            let texts: Texts =
                rewritten.iter().map(|(file, it)| (file.clone(), it.text.clone())).collect();
            self.tree.copy_to(&work.copy, texts.clone())?;
            let mut programs = BTreeMap::new();
            for (name, suite) in self.suites() {
                tell(&format!("building {name}"));
                match work.build(suite)? {
                    Built::Programs(built) => drop(programs.insert(name, built)),
                    Built::Refused(places, said) => {
                        let faults = places
                            .iter()
                            .filter_map(|(file, at)| Some(rewritten.get(file)?.faults_at(*at)));
                        let mut faults: BTreeSet<u32> = faults.flatten().collect();
                        // A constant needs what is none beside its faults.
                        if faults.is_empty() && said.contains("[E0015]") {
                            let is_constant = |fault: &SeededFault| {
                                fault.function.as_ref().is_some_and(|it| it.constant.is_some())
                            };
                            let constant = self.numbered().filter(|(_, fault)| is_constant(fault));
                            let constant = constant.map(|(number, _)| number);
                            faults.extend(constant.filter(|number| !apart.contains_key(number)));
                        }
                        if faults.is_empty() {
                            return Err(FaultsError::content(
                                work.copy.root(),
                                format!("{name} does not build:\n{said}"),
                            ));
                        }
                        for number in faults {
                            tell(&format!(
                                "{} does not compile beside the others",
                                self.name(number)
                            ));
                            apart.insert(
                                number,
                                "it does not compile beside the function as it is".to_owned(),
                            );
                        }
                        continue 'again;
                    }
                }
            }
            return Ok((programs, texts));
        }
    }

    /// The files with all faults that share a build.
    fn rewritten(
        &self,
        apart: &BTreeMap<u32, String>,
    ) -> Result<BTreeMap<String, Rewritten>, FaultsError> {
        let mut files: BTreeMap<String, FileChanges> = BTreeMap::new();
        for (number, fault) in self.numbered().filter(|(number, _)| !apart.contains_key(number)) {
            files.entry(fault.file.clone()).or_default().0.push((number, fault));
        }
        for function in self.constants(apart)? {
            files.entry(function.file).or_default().1.extend(function.constant);
        }
        let rewritten = files.into_iter().map(|(file, (faults, constants))| {
            let rewritten = schemata::rewrite(&self.tree.text(&file)?, &faults, &constants)?;
            Ok((file, rewritten))
        });
        rewritten.collect()
    }

    /// The constant functions with faults, and those that call them.
    fn constants(&self, apart: &BTreeMap<u32, String>) -> Result<Vec<Function>, FaultsError> {
        let faulty = self.numbered().filter(|(number, _)| !apart.contains_key(number));
        let faulty = faulty.filter_map(|(_, fault)| fault.function.clone());
        let mut found: Vec<Function> = faulty.filter(|it| it.constant.is_some()).collect();
        let crates: BTreeSet<String> = found.iter().map(|it| it.of_crate().to_owned()).collect();
        let mut items = FunctionIndex::new(self.tree)?;
        for name in crates {
            let constant = items.of_crate(&name)?.iter().filter(|it| it.constant.is_some());
            let constant: Vec<&Function> = constant.collect();
            loop {
                let calls = |it: &Function| -> Result<bool, FaultsError> {
                    let text = self.tree.text(&it.file)?;
                    let body = &text[it.body.clone()];
                    let of_crate = found.iter().filter(|known| known.of_crate() == name);
                    Ok(of_crate.map(Function::name).any(|name| body.contains(&format!("{name}("))))
                };
                let mut more = Vec::new();
                for function in &constant {
                    if !found.contains(function) && calls(function)? {
                        more.push((*function).clone());
                    }
                }
                if more.is_empty() {
                    break;
                }
                found.extend(more);
            }
        }
        found.sort_by(|a, b| (&a.file, a.whole.start).cmp(&(&b.file, b.whole.start)));
        found.dedup();
        Ok(found)
    }

    /// Builds one fault by itself, in a file that has no other.
    fn build_apart(
        &self,
        work: &FaultyCopy,
        texts: &Texts,
        fault: &SeededFault,
    ) -> Result<BTreeMap<&'static str, Programs>, FaultsError> {
        let mut texts = texts.clone();
        texts.insert(fault.file.clone(), fault.seed(&self.tree.text(&fault.file)?)?);
        self.tree.copy_to(&work.copy, texts)?;
        let mut programs = BTreeMap::new();
        for kind in self.seeing(fault) {
            if programs.contains_key(kind.suite.name) {
                continue;
            }
            match work.build(kind.suite)? {
                Built::Programs(built) => drop(programs.insert(kind.suite.name, built)),
                Built::Refused(_, said) => {
                    let why = format!("it does not compile:\n{said}");
                    return Err(FaultsError::Seed { name: fault.name.clone(), why });
                }
            }
        }
        Ok(programs)
    }

    fn name(&self, number: u32) -> &str {
        let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
        index.and_then(|index| self.faults.get(index)).map_or("none", |fault| &fault.name)
    }

    /// Does the same work in as many threads as there are jobs.
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

/// The kinds of these names; all if there is none.
///
/// # Errors
/// There is no kind of a name.
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
