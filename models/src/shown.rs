//! Finds the sightings that a step shows.

use fuseline_core::Priority;
use fuseline_testkit::History;
use fuseline_traces::{Commit, Decision, DropReason, Input, OfferRefusal, OpenRefusal};

use crate::machine::{FiredTimers, InputResponse};
use crate::sighting::{Sighting, Sightings};
use crate::state::State;
use crate::world::World;

/// Returns the sightings of one step.
pub(crate) fn sightings(
    config: &World,
    before: &State,
    input: &Input,
    answer: &InputResponse,
    after: &State,
) -> Sightings {
    let mut shown = Sightings::default();
    if input.at() < before.ledger.now() {
        shown.insert(Sighting::ClockBack);
    }
    let instants = answer.fired.windows(2);
    for pair in instants {
        if let [first, second] = pair {
            shown.insert_if(Sighting::DuesPassed, first.due != second.due);
            let apart = first.due == second.due && first.t != second.t;
            shown.insert_if(Sighting::TimestampsTogether, apart);
        }
    }
    for (index, fired) in answer.fired.iter().enumerate() {
        // An earlier firing of the same timestamp would have changed its history.
        let is_first = answer.fired.iter().take(index).all(|other| other.t != fired.t);
        if let Some(history) = before.ledger.history(fired.t).filter(|_| is_first) {
            of_firing(config, history, fired, &mut shown);
        }
    }
    of_input(config, before, input, answer, after, &mut shown);
    let open = after.ledger.open();
    shown.insert_if(Sighting::WindowFull, open.len() == usize::from(config.window));
    let holds = config.commit != Commit::Progressive;
    let is_held = || open.iter().any(|(_, history)| history.best().is_some());
    shown.insert_if(Sighting::Prompt, holds && is_held());
    shown
}

/// Adds the sightings of the first firing of a timestamp.
fn of_firing(config: &World, history: &History, fired: &FiredTimers, shown: &mut Sightings) {
    let eager = config.commit == Commit::Eager;
    let patient = config.commit == Commit::Patient;
    let timers = || {
        fired.decisions.iter().filter_map(|decision| match decision {
            Decision::Timer { p, .. } => Some(*p),
            _ => None,
        })
    };
    let local = timers().any(|p| p == 0);
    let cloud = timers().any(|p| p > 0);
    let better = history.best().is_some_and(|best| {
        history.pending().any(|p| p > best && timers().all(|timer| timer != p))
    });
    shown.insert_if(Sighting::TimersTogether, timers().count() > 1);
    shown.insert_if(Sighting::LimitAlone, local && !cloud);
    shown.insert_if(Sighting::LimitWithCloud, local && cloud);
    let last = history.timers().all(|(_, due)| due <= fired.due);
    let output = fired.decisions.iter().find(|decision| {
        matches!(decision, Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. })
    });
    match output {
        Some(Decision::Final { .. }) => shown.insert(Sighting::FinalByTimer),
        Some(Decision::Emit { p, .. }) => {
            shown.insert_if(Sighting::EagerOverPending, eager && better);
            shown.insert_if(Sighting::EagerOwn, eager && timers().any(|timer| timer == *p));
            shown.insert_if(Sighting::TimerForwards, !better);
            shown.insert_if(Sighting::Floor, *p == 0 && last);
            of_emit(history, None, &fired.decisions, shown);
        }
        Some(_) => shown.insert(Sighting::TimerMisses),
        None => {
            let held = history.best().is_some();
            shown.insert_if(Sighting::LimitHolds, eager && held && !cloud);
            shown.insert_if(Sighting::PatientWaits, patient && held && cloud);
            shown.insert_if(Sighting::TimerWaits, !held);
        }
    }
    let waits = history.is_held(0) && !history.are_requests_over(fired.due.saturating_sub(1));
    let over = history.are_requests_over(fired.due);
    shown.insert_if(Sighting::LastRequest, output.is_some() && waits && over);
    let limited = history.due(0).is_some();
    shown.insert_if(Sighting::LimitRetires, output.is_some() && limited && last);
}

/// Adds the sightings of a forwarding. `arrived` is the result that caused it.
fn of_emit(history: &History, arrived: Option<u64>, decisions: &[Decision], shown: &mut Sightings) {
    let cancels = decisions.iter().any(|decision| matches!(decision, Decision::Cancel { .. }));
    let fired = |p| decisions.iter().any(|d| matches!(d, Decision::Timer { p: q, .. } if *q == p));
    shown.insert_if(Sighting::Cancelled, cancels);
    shown.insert_if(
        Sighting::LocalPending,
        history.is_pending(0) && arrived != Some(0) && !fired(0),
    );
    shown.insert_if(
        Sighting::Retired,
        history.timers().any(|(p, _)| arrived != Some(p) && !fired(p)),
    );
    let others = usize::from(arrived.is_none());
    shown.insert_if(Sighting::Discarded, history.held().count() > others);
    shown.insert_if(Sighting::BestOfTwo, arrived.is_none() && history.held().count() > 1);
}

/// Adds the sightings of the input's own decisions.
fn of_input(
    config: &World,
    before: &State,
    input: &Input,
    answer: &InputResponse,
    after: &State,
    shown: &mut Sightings,
) {
    let decision = answer.own.first();
    if let Input::Result { t, p: 0, .. } | Input::Fail { t, p: 0, .. } = *input {
        let now = after.ledger.now();
        let waited =
            |history: &History| !history.is_local_alone() && history.are_requests_over(now);
        let ends = |decision: &Decision| match decision {
            Decision::Emit { .. } => config.commit != Commit::Progressive,
            _ => matches!(decision, Decision::Final { .. } | Decision::Miss { .. }),
        };
        let is_last = answer.own.iter().any(ends) && before.ledger.history(t).is_some_and(waited);
        shown.insert_if(Sighting::LastLocal, is_last);
    }
    match *input {
        Input::Open { deadline, .. } => {
            if let Some(Decision::RefuseOpen { why, .. }) = decision {
                shown.insert(open_refused(*why));
            } else {
                shown.insert(if deadline.is_some() {
                    Sighting::OpenLimited
                } else {
                    Sighting::OpenFree
                });
                let full = before.ledger.open().len() == before.machine.fusion().window();
                shown.insert_if(Sighting::OpenRoom, full);
            }
        }
        Input::Offer { t, p, backlog, .. } => {
            let low = config.cloud(p).is_some_and(|cloud| backlog < cloud.limit);
            of_offer(before, (t, p), low, answer, after, shown);
        }
        Input::Result { t, p, .. } if config.commit == Commit::Progressive => {
            of_result(before, (t, p), answer, after, shown, of_output);
        }
        Input::Result { t, p, .. } => {
            of_result(before, (t, p), answer, after, shown, |history, p, decisions, shown| {
                of_emit(history, Some(p), decisions, shown);
            });
        }
        Input::Fail { t, p, .. } => {
            shown.insert_if(Sighting::Stranger, p > u64::from(u16::MAX));
            shown.insert(match decision {
                Some(Decision::Drop { why, .. }) => FAIL_DROPPED[why.index()],
                Some(Decision::Miss { .. }) => Sighting::FailMisses,
                Some(Decision::Final { .. }) => Sighting::FinalByFailure,
                Some(_) => Sighting::FailForwards,
                None => Sighting::FailWaits,
            });
            if let (Some(history), Some(Decision::Emit { .. })) =
                (before.ledger.history(t).filter(|_| answer.fired.is_empty()), decision)
            {
                of_emit(history, None, &answer.own, shown);
            }
        }
        Input::Tick { .. } => {}
    }
}

fn of_offer(
    before: &State,
    (t, p): (u64, u64),
    below_limit: bool,
    answer: &InputResponse,
    after: &State,
    shown: &mut Sightings,
) {
    let cloud = u16::try_from(p).ok().map(Priority::new);
    let was_shut =
        cloud.and_then(|p| before.machine.fusion().gate(p)).is_some_and(|gate| gate.is_shut());
    if let Some(Decision::RefuseOffer { why, .. }) = answer.own.first() {
        let gate = if was_shut { Sighting::GateStays } else { Sighting::GateShuts };
        let gate = (below_limit || !was_shut).then_some(gate);
        shown.extend(offer_refused(*why, after.ledger.was_reached(t), gate));
    } else {
        shown.insert(Sighting::OfferAdmitted);
        let held = before.ledger.history(t).is_some_and(|history| history.best().is_some());
        shown.insert_if(Sighting::OfferJoins, held);
        shown.insert_if(Sighting::GateOpens, was_shut);
    }
}

fn of_result(
    before: &State,
    (t, p): (u64, u64),
    answer: &InputResponse,
    after: &State,
    shown: &mut Sightings,
    of_emit: impl Fn(&History, u64, &[Decision], &mut Sightings),
) {
    let now = after.ledger.now();
    let history = before.ledger.history(t);
    let due = history.and_then(|history| history.due(p));
    let is_taken = !matches!(answer.own.first(), Some(Decision::Drop { .. }));
    shown.insert_if(
        Sighting::LastInstant,
        is_taken && due.is_some_and(|due| now.checked_add(1) == Some(due)),
    );
    shown.insert_if(Sighting::DueInstant, !is_taken && due == Some(now));
    shown.insert_if(
        Sighting::TimerFirst,
        answer.fired.iter().any(|fired| fired.t == t && fired.due == now),
    );
    match answer.own.first() {
        Some(Decision::Drop { why, .. }) => {
            shown.insert(RESULT_DROPPED[why.index()]);
            let is_open = history.is_some_and(|_| answer.fired.is_empty());
            let is_outranked = is_open && *why == DropReason::Superseded;
            shown.insert_if(Sighting::OutrankedDropped, is_outranked);
            let forwarded = answer.fired.iter().flat_map(|fired| &fired.decisions);
            let just = forwarded.filter(|d| matches!(d, Decision::Emit { .. })).any(|d| d.t() == t);
            shown.insert_if(Sighting::Once, just);
        }
        Some(Decision::Hold { .. }) => {
            shown.insert(Sighting::ResultHeld);
            let live = after.ledger.history(t).is_some_and(|history| history.due(p).is_some());
            shown.insert_if(Sighting::StaysArmed, p > 0 && live);
            shown.insert_if(Sighting::Disarmed, p > 0 && !live);
        }
        _ => {
            if let Some(history) = history.filter(|_| answer.fired.is_empty()) {
                shown.insert_if(Sighting::Free, history.is_local_alone());
                shown.insert_if(Sighting::ResultForwarded, history.best().is_some());
                of_emit(history, p, &answer.own, shown);
            }
        }
    }
}

/// Adds the sightings of an output (F9).
fn of_output(history: &History, p: u64, decisions: &[Decision], shown: &mut Sightings) {
    let is_final = decisions.iter().any(|decision| matches!(decision, Decision::Final { .. }));
    let cancels = decisions.iter().any(|decision| matches!(decision, Decision::Cancel { .. }));
    shown.insert_if(Sighting::Improved, !is_final);
    shown.insert_if(Sighting::ImprovedAgain, history.best().is_some());
    shown.insert_if(Sighting::Outranked, cancels && !is_final);
    shown.insert_if(Sighting::Cancelled, cancels && is_final);
    shown.insert_if(Sighting::LocalPending, history.is_pending(0) && p > 0);
    shown.insert_if(Sighting::Retired, is_final && history.timers().any(|(q, _)| q != p));
}

/// Returns the sighting of a refused open.
fn open_refused(why: OpenRefusal) -> Sighting {
    match why {
        OpenRefusal::Order => Sighting::OpenOrder,
        OpenRefusal::Full => Sighting::OpenFull,
        OpenRefusal::Deadline => Sighting::OpenDeadline,
    }
}

/// Returns the sighting of a refused offer. `gate` is the sighting of its gate.
fn offer_refused(why: OfferRefusal, reached: bool, gate: Option<Sighting>) -> Option<Sighting> {
    match why {
        OfferRefusal::Unknown if reached => Some(Sighting::OfferUnknownCloud),
        OfferRefusal::Unknown => Some(Sighting::OfferUnknownTimestamp),
        OfferRefusal::Closed => Some(Sighting::OfferClosed),
        OfferRefusal::Duplicate => Some(Sighting::OfferDuplicate),
        OfferRefusal::Outranked => Some(Sighting::OfferOutranked),
        OfferRefusal::Deadline => Some(Sighting::OfferDeadline),
        OfferRefusal::Queue => gate,
    }
}

/// The sightings of a dropped result, in the order of the reasons.
const RESULT_DROPPED: [Sighting; DropReason::ALL.len()] = [
    Sighting::ResultUnknown,
    Sighting::ResultSuperseded,
    Sighting::ResultUnsolicited,
    Sighting::ResultDuplicate,
    Sighting::ResultLate,
];

/// The sightings of a dropped failure, in the order of the reasons.
const FAIL_DROPPED: [Sighting; DropReason::ALL.len()] = [
    Sighting::FailUnknown,
    Sighting::FailSuperseded,
    Sighting::FailUnsolicited,
    Sighting::FailDuplicate,
    Sighting::FailLate,
];

#[cfg(test)]
mod tests {
    use super::{FAIL_DROPPED, RESULT_DROPPED};
    use fuseline_traces::DropReason;

    #[test]
    fn what_is_dropped_is_seen_for_its_reason() {
        for (why, (result, fail)) in
            DropReason::ALL.iter().zip(RESULT_DROPPED.iter().zip(&FAIL_DROPPED))
        {
            assert!(result.name().ends_with(why.as_str()), "{} for {why}", result.name());
            assert!(fail.name().ends_with(why.as_str()), "{} for {why}", fail.name());
        }
    }
}
