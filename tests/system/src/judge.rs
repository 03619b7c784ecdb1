//! Judges a simulated run by named checks: by its counts, and by its trace beside a model of the
//! queues.

pub mod account;
pub mod replay;

use std::collections::BTreeMap;
use std::fmt;

/// A condition that must hold for every run. `H` is the type of the function that checks it.
#[derive(Clone, Copy)]
pub struct Check<H> {
    /// The check's name, which begins with the promise of SPEC.md that it is about.
    pub name: &'static str,
    /// Returns an error with the reason if the condition does not hold.
    pub holds: H,
}

/// A check that does not hold for a run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Finding {
    /// The check's name.
    pub check: &'static str,
    /// A description of what is wrong.
    pub reason: String,
}

/// The first seed that broke each check, and how.
#[derive(Default)]
pub struct BrokenChecks(BTreeMap<&'static str, (u64, String)>);

/// Returns the checks that do not hold. `run` calls one of them.
pub fn findings<H>(checks: &[Check<H>], run: impl Fn(&H) -> Result<(), String>) -> Vec<Finding> {
    let found = |check: &Check<H>| {
        let reason = run(&check.holds).err()?;
        Some(Finding { check: check.name, reason })
    };
    checks.iter().filter_map(found).collect()
}

/// Returns an error with the reason if `holds` is `false`.
///
/// # Errors
/// Returns the reason if `holds` is `false`.
pub fn ensure(holds: bool, reason: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(reason()) }
}

impl BrokenChecks {
    /// Adds the findings from the run of a seed.
    pub fn add(&mut self, seed: u64, findings: Vec<Finding>) {
        for Finding { check, reason } in findings {
            self.0.entry(check).or_insert((seed, reason));
        }
    }

    /// Adds the findings from other runs.
    pub fn extend(&mut self, other: Self) {
        for (check, broken) in other.0 {
            self.0.entry(check).or_insert(broken);
        }
    }

    /// Passes if no seed broke the check.
    ///
    /// # Panics
    /// Panics with the seed and the reason if a seed broke it, and if there is no such check.
    pub fn holds<H>(&self, checks: &[Check<H>], check: &str) {
        assert!(checks.iter().any(|known| known.name == check), "there is no check {check}");
        if let Some((seed, reason)) = self.0.get(check) {
            let reason: String = reason.chars().take(2000).collect();
            panic!("seed {seed}: {reason}");
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.reason)
    }
}
