//! The checks of every run, by name.
//!
//! A [`Check`] sees a run from outside: its trace, items, calls and counts ([`Facts`]), but never
//! the operator's state.

mod account;
mod calls;
mod items;

use std::collections::BTreeMap;

use crate::judge::replay::{QueueConfig, Replay};
use crate::judge::{self, Check, Finding, ensure};
use crate::simulate::log::LoggedCall;
use crate::simulate::play::{OperatorEnd, RunResult};
use crate::simulate::scenario::{Disk, Finish, Scenario};

/// Returns the reason as an error if a check does not hold.
type HoldsFor = fn(&Facts<'_>) -> Result<(), String>;

/// All checks.
pub const CHECKS: &[Check<HoldsFor>] = &[
    Check {
        name: "d7_no_panic_comes_through",
        // A run that panics is found before there are facts.
        holds: |_| Ok(()),
    },
    Check { name: "d8_everything_ends", holds: ends },
    Check { name: "d1_one_item", holds: items::one_item },
    Check { name: "d2_its_own_value", holds: items::its_own_value },
    Check { name: "d3_the_rules_decide", holds: calls::the_rules_decide },
    Check { name: "d4_true_backlog", holds: calls::true_backlog },
    Check { name: "d5_time_left", holds: calls::time_left },
    Check { name: "d6_aborted", holds: calls::aborted },
    Check { name: "d7_failures", holds: items::failures },
    Check { name: "d8_bounded", holds: calls::bounded },
    Check { name: "d9_served_in_time", holds: calls::served_in_time },
    Check { name: "d10_whole_trace", holds: account::whole_trace },
    Check { name: "d11_one_account", holds: account::one_account },
    Check { name: "t5_every_end_is_reported", holds: account::every_end_is_reported },
];

/// The facts about one run.
pub struct Facts<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) played: &'a RunResult,
    pub(crate) replay: Replay,
    /// The calls and local computations, by source and timestamp.
    pub(crate) calls: BTreeMap<(u16, u64), &'a LoggedCall>,
    /// `true` if the trace has everything.
    pub(crate) is_whole: bool,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(scenario: &'a Scenario, played: &'a RunResult) -> Self {
        let is_cut = matches!(scenario.disk, Disk::FullAfter(..));
        let is_whole = match played.ended {
            OperatorEnd::Early | OperatorEnd::NotStarted(_) => false,
            OperatorEnd::Well => !is_cut || played.tally.is_some(),
            OperatorEnd::Crashed | OperatorEnd::Panicked | OperatorEnd::Never => !is_cut,
        };
        let replay = Replay::of(&queues(scenario), &played.trace);
        let calls = played.log.calls.iter().map(|call| ((call.p, call.t), call)).collect();
        Self { scenario, played, replay, calls, is_whole }
    }

    /// Returns everything that does not hold.
    pub(crate) fn findings(&self) -> Vec<Finding> {
        judge::findings(CHECKS, |holds| holds(self))
    }

    /// Returns `true` if events at this instant may be missing from the trace, because the operator
    /// was stopped or the trace ends.
    pub(crate) fn is_after(&self, at: u64) -> bool {
        let is_stopped = self.played.log.stopped.is_some_and(|stopped| stopped <= at);
        is_stopped || (!self.is_whole && self.replay.end <= at)
    }

    /// Returns `true` if the run could continue to its end.
    pub(crate) fn runs_out(&self) -> bool {
        matches!(self.scenario.end, Finish::Input | Finish::Alone)
    }
}

fn queues(scenario: &Scenario) -> QueueConfig {
    let local = &scenario.local;
    QueueConfig {
        commit: scenario.commit,
        at_once: local.at_once,
        waiting: local.waiting.unwrap_or(scenario.window.into()),
        skip_answered: local.skip_answered,
        clouds: scenario.clouds.iter().map(|cloud| (cloud.p, cloud.calls)).collect(),
    }
}

/// Checks that the run ended as planned.
fn ends(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, .. } = facts;
    let is_due = match (&played.ended, scenario.end) {
        (OperatorEnd::Crashed, end) => matches!(end, Finish::Crash(_)),
        (OperatorEnd::Well, end) => !matches!(end, Finish::Crash(_)),
        (OperatorEnd::Early, _) => matches!(scenario.disk, Disk::FullAfter(..)),
        (OperatorEnd::NotStarted(_) | OperatorEnd::Panicked | OperatorEnd::Never, _) => false,
    };
    ensure(is_due, || format!("it ended so: {:?}, and its end is {:?}", played.ended, scenario.end))
}
