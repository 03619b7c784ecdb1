//! Checks a configuration state by state.

use std::thread;
use std::time::{Duration, Instant};

use fuseline_traces::Input;
use stateright::{Checker, HasDiscoveries, Model};
use thiserror::Error;

use crate::claim::Claim;
use crate::counterexample::Counterexample;
use crate::operator::Operator;
use crate::sighting::Sighting;
use crate::world::{Size, World};

/// The time between two reports of progress.
const TICK: Duration = Duration::from_millis(50);

/// The options of a check.
#[derive(Clone, Copy, Debug)]
pub struct CheckOptions {
    /// The number of threads, at least 1.
    pub threads: usize,
    /// `true` to continue after a violation and find further ones.
    pub all: bool,
}

/// The outcome of checking a configuration.
#[derive(Debug)]
pub struct Exploration {
    /// The configuration.
    pub config: &'static World,
    /// The number of unique states. After a violation it does not count all of them.
    pub states: usize,
    /// The greatest number of steps from the first state to another, counting the first.
    pub depth: usize,
    /// The time that the check took.
    pub took: Duration,
    /// The claims that are broken, each with a short run that breaks it.
    pub violations: Vec<Counterexample>,
    /// The sightings that no state showed, if all states were searched.
    pub unmet: Vec<Sighting>,
}

/// The reason there is no verdict.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub enum CheckError {
    /// The machine refuses the configuration.
    #[error("the machine refuses the configuration")]
    Refused,
    /// The model panicked outside of the machine.
    #[error("the model panicked")]
    Panicked,
}

impl Exploration {
    /// Returns `true` if all claims and sightings hold and the number of states is as expected.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.violations.is_empty() && self.unmet.is_empty() && self.states == self.config.states
    }
}

/// Searches all states of a configuration, breadth first unless it is large. `progress` is called
/// with the number of states so far.
///
/// Without [`CheckOptions::all`] it stops soon after the first violation.
///
/// # Errors
/// Returns a [`CheckError`] if there is no verdict.
pub fn check(
    config: &'static World,
    effort: CheckOptions,
    mut progress: impl FnMut(usize),
) -> Result<Exploration, CheckError> {
    // The search is compiled here, so that it is not compiled again for each caller.
    check_all_states(config, effort, &mut progress)
}

fn check_all_states(
    config: &'static World,
    effort: CheckOptions,
    progress: &mut dyn FnMut(usize),
) -> Result<Exploration, CheckError> {
    let operator = Operator::new(config);
    if operator.init_states().is_empty() {
        return Err(CheckError::Refused);
    }
    let finish = if effort.all { HasDiscoveries::All } else { HasDiscoveries::AnyFailures };
    let checker = operator.checker().threads(effort.threads.max(1)).finish_when(finish);
    match config.size {
        Size::Quick | Size::Standard => search(config, effort, checker.spawn_bfs(), progress),
        // In a breadth-first search, the states that wait for their turn would not fit into memory.
        Size::Large => search(config, effort, checker.spawn_dfs(), progress),
    }
}

fn search(
    config: &'static World,
    effort: CheckOptions,
    mut checker: impl Checker<Operator>,
    progress: &mut dyn FnMut(usize),
) -> Result<Exploration, CheckError> {
    let begin = Instant::now();
    let workers = checker.handles();
    while workers.iter().any(|worker| !worker.is_finished()) {
        progress(checker.unique_state_count());
        thread::sleep(TICK);
    }
    for worker in workers {
        worker.join().map_err(|_| CheckError::Panicked)?;
    }
    let discoveries = checker.discoveries();
    let broken = Claim::ALL.iter().filter_map(|claim| {
        let inputs: Vec<Input> = discoveries.get(claim.name())?.clone().into_actions();
        Some(Counterexample::of(config, *claim, inputs))
    });
    let violations: Vec<_> = broken.collect();
    let unmet = config.sightings().filter(|sighting| !discoveries.contains_key(sighting.name()));
    let unmet = if violations.is_empty() || effort.all { unmet.collect() } else { Vec::new() };
    Ok(Exploration {
        config,
        states: checker.unique_state_count(),
        depth: checker.max_depth(),
        took: begin.elapsed(),
        violations,
        unmet,
    })
}
