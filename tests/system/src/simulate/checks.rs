//! The checks of every run, by name.
//!
//! A [`Check`] sees a run from outside: its trace, items, calls and counts ([`Facts`]), but never the
//! operator's state.

mod account;
mod calls;
mod items;

use std::collections::BTreeMap;
use std::fmt;

use crate::simulate::log::LoggedCall;
use crate::simulate::play::{OperatorEnd, RunResult};
use crate::simulate::replay::Replay;
use crate::simulate::scenario::{Disk, Finish, Scenario};

/// Something that must hold for every run.
#[derive(Clone, Copy)]
pub struct Check {
    /// The check's name, which begins with the promise of SPEC.md that it is about.
    pub name: &'static str,
    /// A sentence that says what it checks.
    pub sentence: &'static str,
    holds: fn(&Facts<'_>) -> Result<(), String>,
}

/// All checks.
pub const CHECKS: &[Check] = &[
    Check {
        name: "d7_no_panic_comes_through",
        sentence: "nothing panics but what the scenario lets panic",
        // A run that panics is found before there are facts.
        holds: |_| Ok(()),
    },
    Check { name: "d8_everything_ends", sentence: "the operator ends, and ends well", holds: ends },
    Check {
        name: "d1_one_item",
        sentence: "each message taken in leaves as one item, as and when the trace says; under progressive its items rise, and \
                   the newest take the place of those that wait",
        holds: items::one_item,
    },
    Check {
        name: "d2_its_own_value",
        sentence: "an item and a hint bear the value that their source made of their message",
        holds: items::its_own_value,
    },
    Check {
        name: "d3_the_rules_decide",
        sentence: "P1 to P12: the strict judge finds nothing, and each cloud is asked about each message",
        holds: calls::the_rules_decide,
    },
    Check {
        name: "d4_true_backlog",
        sentence: "the backlog of an offer is what waits in its queue, and queues are served in order",
        holds: calls::true_backlog,
    },
    Check {
        name: "d5_time_left",
        sentence: "a call is given the time that is left when it begins",
        holds: calls::time_left,
    },
    Check {
        name: "d6_aborted",
        sentence: "a call ends when it is cancelled or due, no sooner, and local never",
        holds: calls::aborted,
    },
    Check {
        name: "d7_failures",
        sentence: "an error or panic fails its own call with its own words, and ends nothing else",
        holds: items::failures,
    },
    Check {
        name: "d8_bounded",
        sentence: "messages, values, calls and tasks are no more than was configured, and none is left",
        holds: calls::bounded,
    },
    Check {
        name: "d9_served_in_time",
        sentence: "timers are served within 1 ms and messages at once, while readers keep up",
        holds: calls::served_in_time,
    },
    Check {
        name: "d10_whole_trace",
        sentence: "the trace ends with a whole input; if it ends early, that is reported",
        holds: account::whole_trace,
    },
    Check {
        name: "d11_one_account",
        sentence: "tally, metrics, items and trace agree",
        holds: account::one_account,
    },
    Check {
        name: "t5_every_end_is_reported",
        sentence: "each call's end is reported to its policy, and when",
        holds: account::every_end_is_reported,
    },
];

/// The facts about one run.
pub(crate) struct Facts<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) played: &'a RunResult,
    pub(crate) replay: Replay,
    /// The calls and local computations, by source and timestamp.
    pub(crate) calls: BTreeMap<(u16, u64), &'a LoggedCall>,
    /// `true` if the trace has everything.
    pub(crate) is_whole: bool,
}

/// A check that does not hold for a run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Finding {
    /// The check's name.
    pub check: &'static str,
    /// A description of what is wrong.
    pub reason: String,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(scenario: &'a Scenario, played: &'a RunResult) -> Self {
        let is_cut = matches!(scenario.disk, Disk::FullAfter(..));
        let is_whole = match played.ended {
            OperatorEnd::Early | OperatorEnd::NotStarted(_) => false,
            OperatorEnd::Well => !is_cut || played.tally.is_some(),
            OperatorEnd::Crashed | OperatorEnd::Panicked | OperatorEnd::Never => !is_cut,
        };
        let replay = Replay::of(scenario, &played.trace);
        let calls = played.log.calls.iter().map(|call| ((call.p, call.t), call)).collect();
        Self { scenario, played, replay, calls, is_whole }
    }

    /// Returns everything that does not hold.
    pub(crate) fn findings(&self) -> Vec<Finding> {
        let found = |check: &Check| {
            let reason = (check.holds)(self).err()?;
            Some(Finding { check: check.name, reason })
        };
        CHECKS.iter().filter_map(found).collect()
    }

    /// Returns `true` if events at this instant may be missing from the trace, because the operator was
    /// stopped or the trace ends.
    pub(crate) fn is_after(&self, at: u64) -> bool {
        let is_stopped = self.played.log.stopped.is_some_and(|stopped| stopped <= at);
        is_stopped || (!self.is_whole && self.replay.end <= at)
    }

    /// Returns `true` if the run could continue to its end.
    pub(crate) fn runs_out(&self) -> bool {
        matches!(self.scenario.end, Finish::Input | Finish::Alone)
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

/// Returns the reason as an error unless `holds` is `true`.
pub(crate) fn ensure(holds: bool, reason: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(reason()) }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.reason)
    }
}
