//! One run over harnesses and faults, several at once.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use fuseline_faults::{SeededFault, Tree, load_faults};
use indicatif::{ProgressBar, ProgressStyle};

use crate::check::{self, CheckResult, Verdict};
use crate::error::Error;
use crate::ledger::{self, Provenance, VerdictLedger};
use crate::line::{LedgerLine, under};
use crate::mutants::{self, Exclusions, Mutant, MutantOutcome, Mutants};
use crate::record::{CatchRecord, Record};
use crate::source::{Harness, HarnessSources};
use crate::tools::{Limits, Tools};
use crate::translate::Copy;
use crate::uncatchable::UncatchableFaults;

/// The groups that take longest. A fault is first tried with the others.
const SLOWEST_GROUPS: [&str; 2] = ["fusion", "wait"];

/// The sources and the settings of a run.
pub(crate) struct ProofRun<'a> {
    pub(crate) tree: &'a Path,
    pub(crate) root: &'a Path,
    pub(crate) sources: &'a HarnessSources,
    pub(crate) jobs: usize,
    pub(crate) limits: Limits,
    pub(crate) json: bool,
    /// `true` to put good verdicts into the committed ledger.
    pub(crate) keep: bool,
    /// The time for questions that the ledger already answers; `None` asks all of them.
    pub(crate) sample: Option<Duration>,
}

impl ProofRun<'_> {
    /// Proves the named harnesses, or all of them.
    ///
    /// # Errors
    /// Returns an error if no harness has a name, one does not build, or on Ctrl-C.
    pub(crate) fn harnesses(&self, names: &[String]) -> Result<bool, Error> {
        let mut harnesses: Vec<&Harness> = if names.is_empty() {
            self.sources.harnesses.iter().collect()
        } else {
            names.iter().map(|name| self.harness(name)).collect::<Result<_, _>>()?
        };
        let tools = Tools::new(self.root)?;
        let copy = Copy::new(&tools, self.tree)?;
        let ledger = Mutex::new(VerdictLedger::load(self.tree)?);
        let provenance = Provenance::now(self.tree, &tools)?;
        self.draw(&ledger, &mut harnesses, |harness| {
            Ok((harness.name.clone(), provenance.about(harness)))
        })?;
        let lines = self.all(
            "harnesses",
            &harnesses,
            |line| self.report(line),
            |harness| {
                let checked = check::prove(&tools, &copy, harness, self.limits)?;
                let line = line(harness, None, checked);
                self.keep(&ledger, &line, &provenance.about(harness))?;
                Ok((harness.name.clone(), line))
            },
        )?;
        Ok(self.sum_up(&lines, "proved") && !harnesses.is_empty())
    }

    /// Checks that the named harnesses, or all of them, catch the faults that they are recorded to catch.
    ///
    /// # Errors
    /// Returns the same errors as [`harnesses`](Self::harnesses).
    pub(crate) fn faults(&self, record: &Record, names: &[String]) -> Result<bool, Error> {
        let faults = load_faults(&Tree::new(self.tree.to_owned()))?;
        let uncatchable = UncatchableFaults::load(self.tree, &faults)?;
        let mut good = true;
        let mut wrong = |what: String| {
            eprintln!("{what}");
            good = false;
        };
        record.uncaught(&faults, &uncatchable).into_iter().for_each(&mut wrong);
        let able: BTreeSet<&str> = if names.is_empty() {
            self.sources.harnesses.iter().map(|harness| harness.name.as_str()).collect()
        } else {
            names.iter().map(String::as_str).collect()
        };
        let mut pairs: Vec<(String, String)> = record.pairs(&faults, &able).into_iter().collect();
        let caught: BTreeSet<&String> = pairs.iter().map(|(_, name)| name).collect();
        if names.is_empty() {
            for harness in &self.sources.harnesses {
                if !caught.contains(&harness.name) {
                    wrong(format!("no fault is recorded that {} catches", harness.name));
                }
            }
        }
        let tools = Tools::new(self.root)?;
        let copy = Copy::new(&tools, self.tree)?;
        let ledger = Mutex::new(VerdictLedger::load(self.tree)?);
        let provenance = Provenance::now(self.tree, &tools)?;
        let known = |name: &String| {
            let fault = faults.iter().find(|known| known.name == *name);
            fault.ok_or_else(|| none("fault", name))
        };
        self.draw(&ledger, &mut pairs, |(fault, name)| {
            let provenance = provenance.about(self.harness(name)?).with(known(fault)?.digest());
            Ok((under(fault, name), provenance))
        })?;
        let lines = self.all(
            "faults",
            &pairs,
            |line| self.report(line),
            |(fault, name)| {
                let (harness, fault) = (self.harness(name)?, known(fault)?);
                let checked = self.under(&tools, &copy, fault, harness)?;
                let line = line(harness, Some(fault), checked);
                self.keep(&ledger, &line, &provenance.about(harness).with(fault.digest()))?;
                Ok((line.name(), line))
            },
        )?;
        Ok(self.sum_up(&lines, "caught") && good)
    }

    /// Searches for the harnesses that catch each fault, first among the harnesses that cite an
    /// identifier that it breaks.
    ///
    /// # Errors
    /// Returns the same errors as [`harnesses`](Self::harnesses), and an error if the record cannot
    /// be written.
    pub(crate) fn search(
        &self,
        record: &mut Record,
        names: &[String],
        by: &[String],
    ) -> Result<bool, Error> {
        let faults = load_faults(&Tree::new(self.tree.to_owned()))?;
        let uncatchable = UncatchableFaults::load(self.tree, &faults)?;
        record.take(self.sources);
        record.faults.retain(|name, _| faults.iter().any(|fault| fault.name == *name));
        let wanted: Vec<&SeededFault> = faults
            .iter()
            .filter(|fault| !uncatchable.holds(fault))
            .filter(|fault| {
                let known = record.faults.get(&fault.name);
                let stale = known.is_none_or(|c| c.change != fault.digest() || c.by.is_empty());
                if names.is_empty() { stale } else { names.contains(&fault.name) }
            })
            .collect();
        let tools = Tools::new(self.root)?;
        let copy = Copy::new(&tools, self.tree)?;
        let record = Mutex::new(record);
        let catches = |fault: &SeededFault, harness: &Harness| {
            let checked = self.under(&tools, &copy, fault, harness)?;
            let caught = matches!(checked.verdict, Verdict::Refuted(_));
            let mut record = record.lock().unwrap_or_else(PoisonError::into_inner);
            let change = fault.digest();
            let entry = record.faults.entry(fault.name.clone()).or_default();
            if entry.change != change {
                *entry = CatchRecord { change, by: BTreeSet::new() };
            }
            if caught {
                entry.by.insert(harness.name.clone());
                println!("{} is caught by {}", fault.name, harness.name);
            }
            record.save(self.tree)?;
            Ok::<_, Error>(caught)
        };
        // The harnesses that cite an identifier that the fault breaks come first.
        let found = self.all(
            "faults",
            &wanted,
            |_| {},
            |fault| {
                let all = self.sources.harnesses.iter();
                let (citing, others): (Vec<&Harness>, Vec<&Harness>) =
                    all.partition(|h| is_cited(h, fault));
                let mut order: Vec<&Harness> = citing.into_iter().chain(others).collect();
                order.retain(|harness| by.is_empty() || by.contains(&harness.name));
                order.sort_by_key(|harness| SLOWEST_GROUPS.contains(&harness.group.as_str()));
                for harness in order {
                    if catches(fault, harness)? {
                        return Ok((fault.name.clone(), true));
                    }
                }
                Ok((fault.name.clone(), false))
            },
        )?;
        if !by.is_empty() {
            return Ok(found.values().all(|good| *good));
        }
        let idle: Vec<&Harness> = {
            let record = record.lock().unwrap_or_else(PoisonError::into_inner);
            let catches = |h: &&Harness| record.faults.values().any(|c| c.by.contains(&h.name));
            self.sources.harnesses.iter().filter(|harness| !catches(harness)).collect()
        };
        let reachable: Vec<&SeededFault> =
            faults.iter().filter(|fault| !uncatchable.holds(fault)).collect();
        let busy = self.all(
            "harnesses",
            &idle,
            |_| {},
            |harness| {
                for fault in reachable.iter().filter(|fault| is_cited(harness, fault)) {
                    if catches(fault, harness)? {
                        return Ok((harness.name.clone(), true));
                    }
                }
                Ok((harness.name.clone(), false))
            },
        )?;
        for (name, _) in found.iter().chain(&busy).filter(|(_, good)| !**good) {
            println!("nothing was found for {name}");
        }
        Ok(found.values().chain(busy.values()).all(|good| *good))
    }

    /// Searches for a harness, among the named ones or all, that catches each mutant of façade and
    /// window, and records it. A mutant that the named harnesses do not catch does not count as
    /// missed, because others may catch it.
    ///
    /// # Errors
    /// Returns the same errors as [`harnesses`](Self::harnesses), and an error if there is no list
    /// of mutants.
    pub(crate) fn mutants(&self, named: &[String], parts: &[String]) -> Result<bool, Error> {
        let (listed, by) = Mutant::list(self.tree)?;
        let mut mutants = Mutants::current(self.tree, by, ledger::digest(self.tree)?)?;
        mutants.of.retain(|name, _| listed.iter().any(|mutant| mutant.name == *name));
        let open = listed.iter().enumerate().filter(|(_, one)| !mutants.of.contains_key(&one.name));
        let is_wanted = |one: &&Mutant| {
            parts.is_empty() || parts.iter().any(|part| one.name.contains(part.as_str()))
        };
        let open: Vec<(usize, &Mutant)> = open.filter(|(_, one)| is_wanted(one)).collect();
        let tools = Tools::new(self.root)?;
        let copy = Copy::new(&tools, self.tree)?;
        let ledger = VerdictLedger::load(self.tree)?;
        let (record, exclusions) = (Mutex::new(mutants), Exclusions::load(self.tree)?);
        let lock = || record.lock().unwrap_or_else(PoisonError::into_inner);
        let keep = |mutant: &Mutant, outcome: MutantOutcome| {
            let mut record = lock();
            record.of.insert(mutant.name.clone(), outcome.clone());
            record.save(self.tree)?;
            Ok((mutant.name.clone(), outcome))
        };
        self.all(
            "mutants",
            &open,
            |_| {},
            |(at, mutant)| {
                if exclusions.holds(&mutant.name) {
                    return keep(mutant, MutantOutcome::Excluded);
                }
                let first = lock().catchers(&listed, mutant);
                let place = (format!("mutant-{at}"), first);
                let place = (place.0.as_str(), &place.1);
                let outcome = self.outcome(&tools, &copy, (&ledger, named), place, mutant)?;
                if outcome == MutantOutcome::Missed && !named.is_empty() {
                    return Ok((mutant.name.clone(), outcome));
                }
                keep(mutant, outcome)
            },
        )?;
        let (wrong, summary) = mutants::checked(self.tree)?;
        println!("{summary}");
        for wrong in &wrong {
            println!("{wrong}");
        }
        Ok(wrong.is_empty())
    }

    /// Returns the outcome of one mutant. The harnesses of its group are tried, `first` and then the
    /// quickest.
    fn outcome(
        &self,
        tools: &Tools,
        copy: &Copy,
        (ledger, named): (&VerdictLedger, &[String]),
        (folder, first): (&str, &BTreeSet<String>),
        mutant: &Mutant,
    ) -> Result<MutantOutcome, Error> {
        let text = Tree::new(self.tree.to_owned()).text(&mutant.file)?;
        let changed = mutant.seed(&text).ok_or_else(|| none("place", &mutant.name))?;
        let of_mutant = copy.with(folder, &mutant.file, &changed)?;
        let group = mutants::FILES.iter().find(|(file, _)| *file == mutant.file);
        let group = group.map_or("", |(_, group)| group);
        let harnesses = self.sources.harnesses.iter();
        let is_able =
            |of: &&Harness| of.group == group && (named.is_empty() || named.contains(&of.name));
        let mut able: Vec<&Harness> = harnesses.filter(is_able).collect();
        able.sort_by(|a, b| ledger.seconds(&a.name).total_cmp(&ledger.seconds(&b.name)));
        // A harness that caught one mutant of a function usually catches the next.
        able.sort_by_key(|harness| !first.contains(&harness.name));
        let mut outcome = MutantOutcome::Missed;
        for harness in able {
            match check::refute(tools, &of_mutant, harness, self.limits) {
                Ok(CheckResult { verdict: Verdict::Refuted(_), .. }) => {
                    outcome = MutantOutcome::CaughtBy(harness.name.clone());
                    break;
                }
                Err(Error::Tool { .. }) => {
                    outcome = MutantOutcome::NotBuilt;
                    break;
                }
                Ok(_) => {}
                Err(error) => return Err(error),
            }
        }
        of_mutant.remove();
        Ok(outcome)
    }

    /// Keeps a sample of `tasks` if that is enough, and prints how many are left out.
    fn draw<T>(
        &self,
        ledger: &Mutex<VerdictLedger>,
        tasks: &mut Vec<T>,
        question: impl Fn(&T) -> Result<(String, Provenance), Error>,
    ) -> Result<(), Error> {
        let Some(budget) = self.sample else { return Ok(()) };
        let questions = tasks.iter().map(question).collect::<Result<Vec<_>, _>>()?;
        let ledger = ledger.lock().unwrap_or_else(PoisonError::into_inner);
        let (chosen, summary) = ledger.sample(&questions, budget);
        eprintln!("{summary}");
        let mut questions = questions.into_iter();
        tasks.retain(|_| questions.next().is_some_and(|(name, _)| chosen.contains(&name)));
        Ok(())
    }

    /// Keeps a good line in the ledger if that was requested.
    fn keep(
        &self,
        ledger: &Mutex<VerdictLedger>,
        line: &LedgerLine,
        provenance: &Provenance,
    ) -> Result<(), Error> {
        if !self.keep {
            return Ok(());
        }
        ledger.lock().unwrap_or_else(PoisonError::into_inner).add(self.tree, line, provenance)
    }

    /// Checks a harness on a machine with a fault.
    fn under(
        &self,
        tools: &Tools,
        copy: &Copy,
        fault: &SeededFault,
        harness: &Harness,
    ) -> Result<CheckResult, Error> {
        if !fault.file.starts_with("core/src/") {
            let verdict = Verdict::Unknown(format!("{} is not proved", fault.file));
            return Ok(CheckResult { verdict, seconds: 0.0, peak_mib: 0 });
        }
        let name = format!("{}.{}", fault.name, harness.name);
        let faulty = copy.with(
            &name,
            &fault.file,
            &fault.seed(&Tree::new(self.tree.to_owned()).text(&fault.file)?)?,
        )?;
        let checked = check::refute(tools, &faulty, harness, self.limits);
        faulty.remove();
        checked
    }

    fn harness(&self, name: &str) -> Result<&Harness, Error> {
        let found = self.sources.harnesses.iter().find(|harness| harness.name == name);
        found.ok_or_else(|| none("harness", name))
    }

    /// Prints how many lines are good, and how to see the others. Returns `true` if all are.
    fn sum_up(&self, lines: &BTreeMap<String, LedgerLine>, word: &str) -> bool {
        let good = lines.values().filter(|line| line.good).count();
        if !self.json {
            println!("{good} of {} {word}", lines.len());
            for line in lines.values().filter(|line| !line.good && !line.values.is_empty()) {
                let values: Vec<String> = line.values.iter().map(u64::to_string).collect();
                println!("proofs/prove --replay {} {}", line.harness, values.join(" "));
            }
        }
        good == lines.len() && !lines.is_empty()
    }

    /// Prints a line of the ledger.
    fn report(&self, line: &LedgerLine) {
        if self.json {
            println!("{}", serde_json::to_string(line).unwrap_or_default());
        } else {
            println!("{line}");
        }
    }

    /// Works on all of `tasks`, several at once, until one fails.
    fn all<T: Sync, R: Send>(
        &self,
        what: &'static str,
        tasks: &[T],
        report: impl Fn(&R) + Sync,
        work: impl Fn(&T) -> Result<(String, R), Error> + Sync,
    ) -> Result<BTreeMap<String, R>, Error> {
        let bar = ProgressBar::new(tasks.len() as u64);
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed} {wide_msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_message(what);
        let next = AtomicUsize::new(0);
        let worker = || {
            let mut done = BTreeMap::new();
            while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
                match work(task) {
                    Ok((name, result)) => {
                        bar.suspend(|| report(&result));
                        bar.set_message(name.clone());
                        done.insert(name, result);
                    }
                    Err(error) => {
                        next.store(tasks.len(), Ordering::Relaxed);
                        return Err(error);
                    }
                }
                bar.inc(1);
            }
            Ok(done)
        };
        let done = thread::scope(|scope| {
            let workers: Vec<_> = (0..self.jobs.max(1)).map(|_| scope.spawn(worker)).collect();
            let join = |worker: thread::ScopedJoinHandle<'_, Result<_, Error>>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            workers.into_iter().map(join).collect::<Vec<_>>()
        });
        bar.finish_and_clear();
        let mut all = BTreeMap::new();
        for done in done {
            all.extend(done?);
        }
        Ok(all)
    }
}

/// Returns the ledger's line for one question.
fn line(harness: &Harness, fault: Option<&SeededFault>, checked: CheckResult) -> LedgerLine {
    let good = match (&checked.verdict, fault) {
        (Verdict::Proved, None) | (Verdict::Refuted(_), Some(_)) => true,
        (_, _) => false,
    };
    let verdict = match (&checked.verdict, fault) {
        (Verdict::Refuted(found), Some(_)) => format!("caught: {}", found.message),
        (Verdict::Proved, Some(_)) => "MISSED".to_owned(),
        (verdict, _) => verdict.word(),
    };
    let values = match checked.verdict {
        Verdict::Refuted(found) => found.values,
        _ => Vec::new(),
    };
    LedgerLine {
        harness: harness.name.clone(),
        fault: fault.map(|fault| fault.name.clone()),
        engine: "cbmc".to_owned(),
        bounds: harness.stated_bounds(),
        solver: harness.solver.clone(),
        verdict,
        good,
        seconds: (checked.seconds * 10.0).round() / 10.0,
        memory_mib: checked.peak_mib,
        values,
    }
}

fn none(kind: &'static str, name: &str) -> Error {
    Error::Name { kind, name: name.to_owned() }
}

fn is_cited(harness: &Harness, fault: &SeededFault) -> bool {
    cites(harness).iter().any(|id| fault.breaks.contains(id))
}

/// Returns the identifiers that a harness cites in its name and its documentation.
fn cites(harness: &Harness) -> BTreeSet<String> {
    let separated = |c: char| !c.is_ascii_alphanumeric();
    let is_id = |word: &str| {
        let digits = word.trim_start_matches(['F', 'P', 'A']).trim_end_matches('g');
        word.len() >= 2
            && word.len() - digits.len() <= 2
            && !digits.is_empty()
            && digits.bytes().all(|byte| byte.is_ascii_digit())
            && word.starts_with(['F', 'P', 'A'])
    };
    let named = harness.name.split('_').next().unwrap_or_default();
    let named = match named.split_at_checked(1) {
        Some((first, rest)) => format!("{}{rest}", first.to_uppercase()),
        None => String::new(),
    };
    let words = harness.says.split(separated).map(str::to_owned);
    words.chain([named]).filter(|word| is_id(word)).collect()
}
