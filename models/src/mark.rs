//! What a step can show: the witnesses that the environment reaches every rule, reason and promise.

use fuseline_core::Priority;
use fuseline_kit::History;
use fuseline_traces::{Commit, Decision, DropReason, Input, OfferRefusal, OpenRefusal};

use crate::config::Config;
use crate::machine::{Fired, Reaction};
use crate::operator::Operator;
use crate::property::properties;
use crate::state::State;

properties! {
    /// Something that a step shows. Each is a `sometimes` property: in some state that can be
    /// reached, some input shows it.
    Mark,
    /// A set of marks.
    Marks,
    sometimes: Operator::shows;
    ClockBack = "F0 witness: a clock that goes back stays",
    TimerFirst = "F0 witness: a timer due at a result's instant is served before it",
    OpenLimited = "F1 witness: accepted with a deadline",
    OpenFree = "F1 witness: accepted without a deadline",
    OpenOrder = "F1 witness: refused for order",
    OpenFull = "F1 witness: refused for a full window",
    OpenDeadline = "F1 witness: refused for its deadline",
    OpenRoom = "F1 witness: accepted for the room that a timer makes at its instant",
    OfferAdmitted = "F2 witness: admitted",
    OfferJoins = "F2 witness: admitted above what is held",
    OfferUnknownCloud = "F2 witness: refused for an unknown cloud",
    OfferUnknownTimestamp = "F2 witness: refused for an unknown timestamp",
    OfferClosed = "F2 witness: refused for a closed timestamp",
    OfferDuplicate = "F2 witness: refused as a duplicate",
    OfferOutranked = "F2 witness: refused as outranked",
    OfferDeadline = "F2 witness: refused for its deadline",
    GateShuts = "F2g witness: the gate shuts",
    GateStays = "F2g witness: the shut gate stays shut below its limit",
    GateOpens = "F2g witness: the shut gate opens",
    ResultUnknown = "F3 witness: dropped as unknown",
    ResultSuperseded = "F3 witness: dropped as superseded",
    ResultUnsolicited = "F3 witness: dropped as unsolicited",
    ResultDuplicate = "F3 witness: dropped as a duplicate",
    ResultLate = "F3 witness: dropped as late",
    ResultHeld = "F3 witness: held",
    ResultForwarded = "F3 witness: forwarded over others in hand",
    FailUnknown = "F4 witness: dropped as unknown",
    FailSuperseded = "F4 witness: dropped as superseded",
    FailUnsolicited = "F4 witness: dropped as unsolicited",
    FailDuplicate = "F4 witness: dropped as a duplicate",
    FailLate = "F4 witness: dropped as late",
    FailWaits = "F4 witness: accepted, and others are pending",
    FailForwards = "F4 witness: accepted, and the best in hand goes",
    FailMisses = "F4 witness: accepted, and the timestamp is missed",
    TimersTogether = "F5 witness: several timers of a timestamp fire as one",
    TimestampsTogether = "F5 witness: several timestamps are due at one instant",
    LimitAlone = "F5 witness: local's timer fires alone",
    LimitWithCloud = "F5 witness: local's timer fires with a cloud's timer",
    EagerOverPending = "F6 witness: eager, a timer commits although a better one is pending",
    EagerOwn = "F6 witness: eager, a held result's own timer commits it",
    LimitHolds = "F6 witness: eager, local's timer commits nothing",
    PatientWaits = "F6 witness: patient, a timer commits nothing while a better one is pending",
    TimerForwards = "F6 witness: a timer closes the last that outranked the best in hand",
    TimerWaits = "F6 witness: a timer finds nothing in hand, and others are pending",
    TimerMisses = "F6 witness: a timer finds nothing in hand and nothing pending",
    Cancelled = "F7 witness: a pending call is cancelled",
    LocalPending = "F7 witness: local is pending, and is not cancelled",
    Stranger = "F8 witness: a priority beyond 16 bits gets an answer",
    Once = "P1 witness: a result comes for what its instant forwarded",
    LastInstant = "P2 witness: a result of the last instant before its due one is taken",
    DueInstant = "P2 witness: a result of its due instant is dropped",
    BestOfTwo = "P3 witness: the better of two in hand is forwarded",
    Prompt = "P4 witness: something is held under something pending",
    Floor = "P5 witness: local's held result is forwarded by the latest due instant",
    Free = "P6 witness: local's result is forwarded at once without a request",
    LimitRetires = "P7 witness: a timestamp with a deadline is retired by its latest due instant",
    StaysArmed = "P8 witness: eager, a held result's timer stays live",
    Disarmed = "P8 witness: patient, a held result's timer is disarmed",
    Retired = "P8 witness: a live timer goes with its timestamp",
    WindowFull = "P9 witness: the window is full",
    DuesPassed = "P10 witness: one input passes several due instants",
    Discarded = "P11 witness: a held result is discarded",
}

/// What one step shows.
pub(crate) fn marks(
    config: &Config,
    before: &State,
    input: &Input,
    answer: &Reaction,
    after: &State,
) -> Marks {
    let mut shown = Marks::default();
    if input.at() < before.ledger.now() {
        shown.insert(Mark::ClockBack);
    }
    let instants = answer.fired.windows(2);
    for pair in instants {
        if let [first, second] = pair {
            shown.insert_if(Mark::DuesPassed, first.due != second.due);
            let apart = first.due == second.due && first.t != second.t;
            shown.insert_if(Mark::TimestampsTogether, apart);
        }
    }
    for (place, fired) in answer.fired.iter().enumerate() {
        // An earlier firing of the same timestamp would have changed its history.
        let is_first = answer.fired.iter().take(place).all(|other| other.t != fired.t);
        if let Some(history) = before.ledger.history(fired.t).filter(|_| is_first) {
            of_firing(config, history, fired, &mut shown);
        }
    }
    of_input(config, before, input, answer, after, &mut shown);
    let open = after.ledger.open();
    shown.insert_if(Mark::WindowFull, open.len() == usize::from(config.window));
    shown.insert_if(Mark::Prompt, open.iter().any(|(_, history)| history.best().is_some()));
    shown
}

/// What the first firing of a timestamp shows.
fn of_firing(config: &Config, history: &History, fired: &Fired, shown: &mut Marks) {
    let eager = config.commit == Commit::Eager;
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
    shown.insert_if(Mark::TimersTogether, timers().count() > 1);
    shown.insert_if(Mark::LimitAlone, local && !cloud);
    shown.insert_if(Mark::LimitWithCloud, local && cloud);
    let last = history.timers().all(|(_, due)| due <= fired.due);
    let output = fired
        .decisions
        .iter()
        .find(|decision| matches!(decision, Decision::Emit { .. } | Decision::Miss { .. }));
    match output {
        Some(Decision::Emit { p, .. }) => {
            shown.insert_if(Mark::EagerOverPending, eager && better);
            shown.insert_if(Mark::EagerOwn, eager && timers().any(|timer| timer == *p));
            shown.insert_if(Mark::TimerForwards, !better);
            shown.insert_if(Mark::Floor, *p == 0 && last);
            of_emit(history, None, &fired.decisions, shown);
        }
        Some(_) => shown.insert(Mark::TimerMisses),
        None => {
            let held = history.best().is_some();
            shown.insert_if(Mark::LimitHolds, eager && held && !cloud);
            shown.insert_if(Mark::PatientWaits, !eager && held && cloud);
            shown.insert_if(Mark::TimerWaits, !held);
        }
    }
    let limited = history.due(0).is_some();
    shown.insert_if(Mark::LimitRetires, output.is_some() && limited && last);
}

/// What a forwarding shows; `came` is the result that brought it about.
fn of_emit(history: &History, came: Option<u64>, decisions: &[Decision], shown: &mut Marks) {
    let cancels = decisions.iter().any(|decision| matches!(decision, Decision::Cancel { .. }));
    let fired = |p| decisions.iter().any(|d| matches!(d, Decision::Timer { p: q, .. } if *q == p));
    shown.insert_if(Mark::Cancelled, cancels);
    shown.insert_if(Mark::LocalPending, history.is_pending(0) && came != Some(0) && !fired(0));
    shown.insert_if(Mark::Retired, history.timers().any(|(p, _)| came != Some(p) && !fired(p)));
    let others = usize::from(came.is_none());
    shown.insert_if(Mark::Discarded, history.held().count() > others);
    shown.insert_if(Mark::BestOfTwo, came.is_none() && history.held().count() > 1);
}

/// What the input's own decisions show.
fn of_input(
    config: &Config,
    before: &State,
    input: &Input,
    answer: &Reaction,
    after: &State,
    shown: &mut Marks,
) {
    let decision = answer.own.first();
    match *input {
        Input::Open { deadline, .. } => {
            if let Some(Decision::RefuseOpen { why, .. }) = decision {
                shown.insert(open_refused(*why));
            } else {
                shown.insert(if deadline.is_some() { Mark::OpenLimited } else { Mark::OpenFree });
                let full = before.ledger.open().len() == before.machine.fusion().window();
                shown.insert_if(Mark::OpenRoom, full);
            }
        }
        Input::Offer { t, p, backlog, .. } => {
            let low = config.cloud(p).is_some_and(|cloud| backlog < cloud.limit);
            of_offer(before, (t, p), low, answer, after, shown);
        }
        Input::Result { t, p, .. } => of_result(before, (t, p), answer, after, shown),
        Input::Fail { t, p, .. } => {
            shown.insert_if(Mark::Stranger, p > u64::from(u16::MAX));
            shown.insert(match decision {
                Some(Decision::Drop { why, .. }) => fail_dropped(*why),
                Some(Decision::Miss { .. }) => Mark::FailMisses,
                Some(_) => Mark::FailForwards,
                None => Mark::FailWaits,
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
    answer: &Reaction,
    after: &State,
    shown: &mut Marks,
) {
    let cloud = u16::try_from(p).ok().map(Priority::new);
    let was_shut =
        cloud.and_then(|p| before.machine.fusion().gate(p)).is_some_and(|gate| gate.is_shut());
    if let Some(Decision::RefuseOffer { why, .. }) = answer.own.first() {
        let gate = if was_shut { Mark::GateStays } else { Mark::GateShuts };
        let gate = (below_limit || !was_shut).then_some(gate);
        shown.extend(offer_refused(*why, after.ledger.was_reached(t), gate));
    } else {
        shown.insert(Mark::OfferAdmitted);
        let held = before.ledger.history(t).is_some_and(|history| history.best().is_some());
        shown.insert_if(Mark::OfferJoins, held);
        shown.insert_if(Mark::GateOpens, was_shut);
    }
}

fn of_result(
    before: &State,
    (t, p): (u64, u64),
    answer: &Reaction,
    after: &State,
    shown: &mut Marks,
) {
    let now = after.ledger.now();
    let history = before.ledger.history(t);
    let due = history.and_then(|history| history.due(p));
    let is_taken = !matches!(answer.own.first(), Some(Decision::Drop { .. }));
    shown.insert_if(
        Mark::LastInstant,
        is_taken && due.is_some_and(|due| now.checked_add(1) == Some(due)),
    );
    shown.insert_if(Mark::DueInstant, !is_taken && due == Some(now));
    shown.insert_if(
        Mark::TimerFirst,
        answer.fired.iter().any(|fired| fired.t == t && fired.due == now),
    );
    match answer.own.first() {
        Some(Decision::Drop { why, .. }) => {
            shown.insert(result_dropped(*why));
            let forwarded = answer.fired.iter().flat_map(|fired| &fired.decisions);
            let just = forwarded.filter(|d| matches!(d, Decision::Emit { .. })).any(|d| d.t() == t);
            shown.insert_if(Mark::Once, just);
        }
        Some(Decision::Hold { .. }) => {
            shown.insert(Mark::ResultHeld);
            let live = after.ledger.history(t).is_some_and(|history| history.due(p).is_some());
            shown.insert_if(Mark::StaysArmed, p > 0 && live);
            shown.insert_if(Mark::Disarmed, p > 0 && !live);
        }
        _ => {
            if let Some(history) = history.filter(|_| answer.fired.is_empty()) {
                shown.insert_if(Mark::Free, history.is_local_alone());
                shown.insert_if(Mark::ResultForwarded, history.best().is_some());
                of_emit(history, Some(p), &answer.own, shown);
            }
        }
    }
}

/// The mark of a refused open.
fn open_refused(why: OpenRefusal) -> Mark {
    match why {
        OpenRefusal::Order => Mark::OpenOrder,
        OpenRefusal::Full => Mark::OpenFull,
        OpenRefusal::Deadline => Mark::OpenDeadline,
    }
}

/// The mark of a refused offer; `gate` is that of its gate.
fn offer_refused(why: OfferRefusal, reached: bool, gate: Option<Mark>) -> Option<Mark> {
    match why {
        OfferRefusal::Unknown if reached => Some(Mark::OfferUnknownCloud),
        OfferRefusal::Unknown => Some(Mark::OfferUnknownTimestamp),
        OfferRefusal::Closed => Some(Mark::OfferClosed),
        OfferRefusal::Duplicate => Some(Mark::OfferDuplicate),
        OfferRefusal::Outranked => Some(Mark::OfferOutranked),
        OfferRefusal::Deadline => Some(Mark::OfferDeadline),
        OfferRefusal::Queue => gate,
    }
}

fn result_dropped(why: DropReason) -> Mark {
    match why {
        DropReason::Unknown => Mark::ResultUnknown,
        DropReason::Superseded => Mark::ResultSuperseded,
        DropReason::Unsolicited => Mark::ResultUnsolicited,
        DropReason::Duplicate => Mark::ResultDuplicate,
        DropReason::Late => Mark::ResultLate,
    }
}

fn fail_dropped(why: DropReason) -> Mark {
    match why {
        DropReason::Unknown => Mark::FailUnknown,
        DropReason::Superseded => Mark::FailSuperseded,
        DropReason::Unsolicited => Mark::FailUnsolicited,
        DropReason::Duplicate => Mark::FailDuplicate,
        DropReason::Late => Mark::FailLate,
    }
}
