//! The car's planner: an operator without clouds, and a plan that may be cached beside it.

use serde::Serialize;

use crate::approach::{nanos, seconds};
use crate::jaywalking::contingency::{ContingencyCalls, Hypothesis, Plan, PlanReply};
use crate::operator::{ScenarioMessage, ScenarioOperator};

/// The time between two messages to the planner, in ns.
const EVERY: u64 = 100_000_000;
/// The instant at which the person enters the road: messages before it show nobody.
pub(crate) const ENTERS: u64 = 20 * EVERY;
/// The instant of the last message.
const LAST: u64 = 30 * EVERY;
/// The instant of the message that shows that the person might enter.
const FORESEEN: u64 = 5 * EVERY;
/// The time that the side request may take.
const DEADLINE: u64 = 1_000_000_000;
/// The time that it takes, unless it is late.
const TAKES: u64 = 400_000_000;
/// The time that its plan holds, unless it has expired.
const VALIDITY: u64 = 5_000_000_000;
/// The greatest number of side requests at once.
const LIMIT: usize = 1;

/// The outcome of the call for a contingency plan.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PlanCallOutcome {
    /// No cloud is called.
    Unasked,
    /// In time, and the plan holds.
    InTime,
    /// After the deadline, though before the person enters.
    Late,
    /// In time, but the plan holds no longer.
    Expired,
    /// In time, for something else.
    OtherHypothesis,
    /// Never.
    Silent,
}

/// A run of the planner, in s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planning {
    pub(crate) cloud: PlanCallOutcome,
    /// The time for which the planner computes.
    pub(crate) planner: f64,
    /// The time that it takes with a cached plan.
    pub(crate) cached: f64,
}

/// The planner's output.
pub(crate) struct PlannerOutput {
    /// The time from the person's step onto the road until the plan for it was sent, in s.
    pub(crate) response: f64,
    /// `true` if that was the cached plan.
    pub(crate) is_cached: bool,
    pub(crate) trace: Option<Vec<u8>>,
}

impl PlanCallOutcome {
    pub(crate) const ALL: [Self; 6] = [
        Self::Unasked,
        Self::InTime,
        Self::Late,
        Self::Expired,
        Self::OtherHypothesis,
        Self::Silent,
    ];

    pub(crate) const fn word(self) -> &'static str {
        match self {
            Self::Unasked => "unasked",
            Self::InTime => "in-time",
            Self::Late => "late",
            Self::Expired => "expired",
            Self::OtherHypothesis => "other-hypothesis",
            Self::Silent => "silent",
        }
    }

    /// Returns the answer to the call.
    const fn answer(self) -> Option<PlanReply> {
        let person = Plan { hypothesis: Hypothesis::PERSON_ENTERS, validity: VALIDITY };
        let other = Plan { hypothesis: Hypothesis::CAR_PULLS_OUT, validity: VALIDITY };
        match self {
            Self::Unasked | Self::Silent => None,
            Self::InTime => Some(PlanReply { takes: TAKES, plan: person }),
            Self::Late => Some(PlanReply { takes: DEADLINE, plan: person }),
            Self::Expired => {
                let until = ENTERS - FORESEEN - TAKES;
                Some(PlanReply { takes: TAKES, plan: Plan { validity: until, ..person } })
            }
            Self::OtherHypothesis => Some(PlanReply { takes: TAKES, plan: other }),
        }
    }
}

impl Planning {
    pub(crate) fn run(&self, is_traced: bool) -> PlannerOutput {
        let mut operator = ScenarioOperator::new("planner", 31.0, is_traced);
        let mut contingencies = ContingencyCalls::new(LIMIT);
        let mut is_cached = false;
        for at in messages() {
            if at == FORESEEN && self.cloud != PlanCallOutcome::Unasked {
                contingencies.call(at, DEADLINE, self.cloud.answer());
            }
            let has_plan = at >= ENTERS && contingencies.holds(at, Hypothesis::PERSON_ENTERS);
            is_cached |= has_plan;
            self.message(&mut operator, at, has_plan);
        }
        let response = response(&mut operator);
        PlannerOutput { response, is_cached, trace: operator.into_trace() }
    }

    /// Plays the drive with several hypotheses, one of which comes true. Their plans are requested
    /// in their order, `at_once` at a time. Returns the response, and whether the plan was cached.
    pub(crate) fn with_hypotheses(
        &self,
        count: usize,
        at_once: usize,
        true_one: usize,
    ) -> (f64, bool) {
        let mut operator = ScenarioOperator::new("planner", 31.0, false);
        let mut contingencies = ContingencyCalls::new(at_once);
        let (mut requested, mut is_cached) = (0, false);
        for at in messages() {
            while at >= FORESEEN && requested < count {
                let plan = Plan { hypothesis: Hypothesis(requested), validity: VALIDITY };
                if !contingencies.call(at, DEADLINE, Some(PlanReply { takes: TAKES, plan })) {
                    break;
                }
                requested += 1;
            }
            let has_plan = at >= ENTERS && contingencies.holds(at, Hypothesis(true_one));
            is_cached |= has_plan && at == ENTERS;
            self.message(&mut operator, at, has_plan);
        }
        (response(&mut operator), is_cached)
    }

    fn message(&self, operator: &mut ScenarioOperator, at: u64, has_plan: bool) {
        let local = Some(nanos(if has_plan { self.cached } else { self.planner }));
        operator.message(&ScenarioMessage { at, local, request: None });
    }
}

/// Returns the instants of the planner's messages.
fn messages() -> impl Iterator<Item = u64> {
    (0..=LAST).step_by(usize::try_from(EVERY).unwrap_or(usize::MAX))
}

/// Returns the time from the event to the first plan for a message that shows it, in s.
fn response(operator: &mut ScenarioOperator) -> f64 {
    operator.pass(u64::MAX);
    let outputs = operator.take_outputs();
    let first = outputs.iter().find(|output| output.t * EVERY >= ENTERS);
    first.map_or(f64::INFINITY, |output| seconds(output.at - ENTERS))
}

#[cfg(test)]
mod tests {
    use fuseline_traces::judge;

    use super::*;

    fn run(cloud: PlanCallOutcome) -> (f64, bool, Vec<u8>) {
        let PlannerOutput { response, is_cached, trace } =
            Planning { cloud, planner: 0.5, cached: 0.4 }.run(true);
        (response, is_cached, trace.unwrap())
    }

    #[test]
    fn a_plan_that_does_not_serve_leaves_outputs_at_the_instants_of_a_run_without_a_cloud() {
        let (response, is_cached, without) = run(PlanCallOutcome::Unasked);
        assert_eq!((response, is_cached), (0.5, false));
        for cloud in [
            PlanCallOutcome::Late,
            PlanCallOutcome::Expired,
            PlanCallOutcome::OtherHypothesis,
            PlanCallOutcome::Silent,
        ] {
            let (response, is_cached, trace) = run(cloud);
            assert_eq!((response, is_cached), (0.5, false), "{cloud:?}");
            assert!(trace == without, "{cloud:?} changed what the machine saw");
        }
    }

    #[test]
    fn plans_come_in_the_order_of_their_hypotheses_and_some_not_in_time() {
        let planning = Planning { cloud: PlanCallOutcome::InTime, planner: 0.5, cached: 0.4 };
        // The calls run one after the other from 0.5 s on and take 0.4 s each, so three plans are
        // there at 2 s.
        let responses: Vec<_> = (0..4).map(|it| planning.with_hypotheses(4, 1, it)).collect();
        assert_eq!(responses, [(0.4, true), (0.4, true), (0.4, true), (0.5, false)]);
        assert_eq!(planning.with_hypotheses(4, 2, 3), (0.4, true));
        assert_eq!(planning.with_hypotheses(0, 2, 3), (0.5, false));
    }

    #[test]
    fn a_plan_in_time_that_holds_and_matches_is_used_and_no_output_of_its_own() {
        let (response, is_cached, trace) = run(PlanCallOutcome::InTime);
        assert_eq!((response, is_cached), (0.4, true));
        let text = String::from_utf8(trace.clone()).unwrap();
        assert_eq!(text.matches("\"emit\"").count(), 31);
        assert_eq!(text.matches("\"offer\"").count(), 0, "the machine knows of no call aside");
        assert!(judge("planner", &trace[..]).unwrap().violations.is_empty());
    }
}
