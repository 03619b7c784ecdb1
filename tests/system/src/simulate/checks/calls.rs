//! Checks calls: what is requested of sources, when it begins and when it ends (D3 to D9).

use fuseline_traces::nanos;

use crate::judge::ensure;
use crate::judge::replay::{AdmittedRequest, Departure};
use crate::simulate::checks::Facts;
use crate::simulate::log::{CallStop, LoggedCall};
use crate::simulate::scenario::{CallResult, Finish, OfferAction, ScenarioLink};

/// tokio's timers tick once in a millisecond.
const TICK: u64 = 1_000_000;

/// The rules decide (D3, P1 to P12).
pub(crate) fn the_rules_decide(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, is_whole, .. } = facts;
    if let Some(verdict) = &replay.verdict {
        ensure(verdict.violations.is_empty(), || verdict.to_string())?;
    }
    if !is_whole {
        return Ok(());
    }
    let accepted =
        replay.opened.iter().filter(|message| !matches!(message.end, Some(Departure::Refused(_))));
    let mut handlers = Vec::new();
    let mut offers = Vec::new();
    for message in accepted {
        let serial = serial(facts, message.t);
        for (cloud, offer) in scenario.clouds.iter().zip(&scenario.frames[serial].offers) {
            handlers.push((cloud.p, message.t));
            // A policy that sometimes panics makes no request when it does.
            let panics = cloud.policy.is_some_and(|deadline| deadline.is_zero());
            if matches!(offer, OfferAction::Offers(..)) && !panics {
                offers.push((message.t, cloud.p));
            }
        }
    }
    ensure(handlers == played.log.requested, || {
        format!("clouds asked are {:?}, to be asked {handlers:?}", played.log.requested)
    })?;
    let steady = |p| {
        scenario
            .clouds
            .iter()
            .any(|cloud| cloud.p == p && !cloud.policy.is_some_and(|deadline| deadline.is_zero()))
    };
    let reported = replay.offers.iter().filter(|offer| steady(offer.p));
    let reported: Vec<_> = reported.map(|offer| (offer.t, offer.p)).collect();
    ensure(reported == offers, || format!("offers are {reported:?}, not {offers:?}"))
}

/// Backlogs are the true length of the queue (D4).
pub(crate) fn true_backlog(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, replay, .. } = facts;
    let wrong = replay.wrong_backlogs.first().or(replay.wrong_room.first());
    ensure(wrong.is_none(), || wrong.cloned().unwrap_or_default())?;
    let locals = played.log.calls.iter().filter(|call| call.p == 0);
    let in_order = locals.map(|call| call.t).is_sorted_by(|one, next| one < next);
    ensure(in_order, || "local computes messages out of their order".to_owned())?;
    for requested in &replay.requested {
        let Some(started) = requested.started else { continue };
        if facts.calls.contains_key(&(requested.p, requested.t)) {
            continue;
        }
        // It may be closed, or the operator ended, before it had its first turn.
        let had_no_turn = requested.closed() == Some(started) || facts.is_after(started);
        ensure(had_no_turn, || {
            format!("{} has room for {} at {started}, and is not asked", requested.p, requested.t)
        })?;
    }
    Ok(())
}

/// A call gets the time that is left when it begins (D5).
pub(crate) fn time_left(facts: &Facts<'_>) -> Result<(), String> {
    for (requested, call) in pairs(facts)? {
        if facts.is_after(call.begun) {
            continue;
        }
        let Some(started) = requested.started else {
            return Err(format!("{} was asked about {} without room", requested.p, requested.t));
        };
        let stalled = facts.played.log.stalled(started, call.begun);
        ensure(call.begun == started + stalled, || {
            format!(
                "{} has room for {} at {started} and begins at {}",
                requested.p, requested.t, call.begun
            )
        })?;
        let cloud = facts.scenario.clouds.iter().find(|cloud| cloud.p == requested.p);
        let (Some(time_left), Some(cloud), Some(due)) = (call.time_left, cloud, requested.due)
        else {
            continue;
        };
        let until = due.saturating_add(nanos(cloud.linger));
        ensure(nanos(time_left) == until - started, || {
            format!(
                "{} is given {time_left:?} for {}, due at {until} from {started}",
                requested.p, requested.t
            )
        })?;
    }
    Ok(())
}

/// Calls are aborted in time, and local never is (D6, F7).
pub(crate) fn aborted(facts: &Facts<'_>) -> Result<(), String> {
    let log = &facts.played.log;
    for (requested, call) in pairs(facts)? {
        let description = || {
            format!(
                "{} begun at {} ended {:?}, due {:?}, fired {:?}, cancelled {:?}",
                format_args!("{} of {}", requested.t, requested.p),
                call.begun,
                call.end,
                requested.due,
                requested.fired,
                requested.cancelled
            )
        };
        let Some((ended, stop)) = call.end else {
            return Err(format!("it was never dropped: {}", description()));
        };
        let is_over = log.over.is_some_and(|over| over <= ended);
        if requested.p == 0 {
            ensure(stop != CallStop::DroppedResult || is_over, || {
                format!("local was aborted: {}", description())
            })?;
        } else {
            cloud_ends(facts, requested, (ended, stop))
                .map_err(|why| format!("{why}: {}", description()))?;
        }
        // Its end is an input of the trace at the same instant, unless the operator has ended.
        if stop != CallStop::DroppedResult
            && !facts.is_after(ended)
            && (requested.p == 0 || call.begun < ended)
        {
            let reported = requested.ended;
            let is_reported = reported == Some((ended, stop == CallStop::Answered));
            let is_done = requested.p == 0 && log.over.is_some();
            ensure(is_reported || is_done && reported.is_none(), || {
                format!("its word came {reported:?}: {}", description())
            })?;
        }
    }
    Ok(())
}

/// Returns when a cloud's call may end.
fn cloud_ends(
    facts: &Facts<'_>,
    requested: &AdmittedRequest,
    (ended, stop): (u64, CallStop),
) -> Result<(), String> {
    let Facts { scenario, played, .. } = facts;
    let log = &played.log;
    let cloud = scenario.clouds.iter().find(|cloud| cloud.p == requested.p);
    let linger = cloud.map_or(0, |cloud| nanos(cloud.linger));
    let stopped = facts.is_after(ended) || log.over.is_some_and(|over| over <= ended);
    let Some(closed) = requested.closed() else {
        // Once every message has its output, only calls that linger are under way.
        return ensure(stop != CallStop::DroppedResult || stopped, || {
            "it was dropped while wanted".into()
        });
    };
    if linger == 0 {
        ensure(ended <= closed, || "it went on after its abort".into())?;
    } else {
        let until = requested.due.unwrap_or(u64::MAX).saturating_add(linger);
        let most = until.saturating_add(TICK + log.stalled(until, ended));
        ensure(ended <= most, || "it lingered too long".into())?;
    }
    ensure(stop != CallStop::DroppedResult || ended >= closed, || {
        "it was dropped while wanted".into()
    })
}

/// Everything is bounded (D8).
pub(crate) fn bounded(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, .. } = facts;
    let log = &played.log;
    let at_once = scenario.local.at_once.max(1);
    let clouds = scenario.clouds.iter().map(|cloud| {
        let lingers = if cloud.linger.is_zero() { 1 } else { 2 };
        (cloud.p, cloud.calls.max(1) * lingers)
    });
    for (p, bound) in [(0, at_once)].into_iter().chain(clouds) {
        let most = most_at_once(log.calls.iter().filter(|call| call.p == p));
        ensure(most <= bound, || format!("{most} calls of {p} were under way, {bound} may be"))?;
    }
    if let Some((_, calls)) = scenario.side {
        let most = log.sides[2];
        ensure(most <= calls, || format!("{most} side requests were under way, {calls} may be"))?;
    }
    link_is_shared(facts)?;
    let window = usize::from(scenario.window);
    let waiting = scenario.local.waiting.unwrap_or(window);
    let frames = scenario.input_len + waiting + at_once + 3;
    let readers = scenario.readers.len();
    let values = 2 * window + readers * (scenario.output_len + 1) + 2;
    for (description, most, bound) in
        [("messages", played.most[0], frames), ("values", played.most[1], values)]
    {
        ensure(most <= bound, || format!("{most} {description} were held, {bound} may be"))?;
    }
    let [tasks, frames, values] = played.remaining;
    ensure(frames == 0 && values == 0, || format!("{frames} messages, {values} values are left"))?;
    let hung = |call: &&LoggedCall| {
        let act = scenario.act(call.serial, 0).map(|act| act.result);
        call.p == 0 && matches!(act, Some(CallResult::Hangs | CallResult::HangsAndPanics))
    };
    let hung = log.calls.iter().filter(hung).count();
    let is_over = !matches!(scenario.end, Finish::Crash(_));
    ensure(!is_over || tasks <= hung, || {
        format!("{tasks} tasks are left, {hung} computations hang")
    })
}

/// Checks the link by a second model of its queue: each direction sends in order, no sooner than it
/// can carry all bytes before, and refuses what finds no room.
fn link_is_shared(facts: &Facts<'_>) -> Result<(), String> {
    let Some(ScenarioLink { rates, queue_bytes, bytes }) = facts.scenario.link else {
        return Ok(());
    };
    // In billionths of bits: what each direction carries until it is free.
    let mut busy = [0_u128; 2];
    let share = |bytes| u128::from(bytes) * 8_000_000_000;
    for sent in &facts.played.log.link {
        let way = sent.direction as usize;
        let (rate, len) = (u128::from(rates[way]), share(bytes[way] as u64));
        let passed = u128::from(sent.at) * rate;
        let waiting = busy[way].saturating_sub(passed);
        let has_room = waiting == 0 || waiting + len <= share(queue_bytes);
        let through = if has_room {
            busy[way] = busy[way].max(passed) + len;
            u64::try_from(busy[way].div_ceil(rate)).unwrap_or(u64::MAX)
        } else {
            sent.at
        };
        let Some(end) = sent.end else { continue };
        let latest = through + TICK + facts.played.log.stalled(through, end.0);
        let is_due = (through..=latest).contains(&end.0);
        ensure(end.1 == has_room && is_due, || {
            format!("the link ended {sent:?}, which is through at {through}: {has_room}")
        })?;
    }
    Ok(())
}

/// Timers are served in time (D9).
pub(crate) fn served_in_time(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, .. } = facts;
    let log = &played.log;
    for requested in &replay.requested {
        let (Some(fired), Some(due)) = (requested.fired, requested.due) else { continue };
        let most = due + TICK + log.stalled(due, fired);
        ensure(fired <= most, || {
            format!(
                "the timer of {} at {}, due at {due}, fired at {fired}",
                requested.t, requested.p
            )
        })?;
    }
    let keeps_up = |reader: &crate::simulate::scenario::ReaderPlan| {
        reader.pace.is_zero() && reader.lag.is_none()
    };
    if !scenario.readers.iter().all(keeps_up) {
        return Ok(());
    }
    for message in &replay.opened {
        let t = usize::try_from(message.t).unwrap_or(usize::MAX);
        let Some((_, written)) = log.written.get(t).copied() else {
            return Err(format!("{} was opened and never written", message.t));
        };
        ensure(message.at == written + log.stalled(written, message.at), || {
            format!("{} was written at {written} and taken in at {}", message.t, message.at)
        })?;
    }
    Ok(())
}

/// Returns the greatest number of them that were under way at once.
fn most_at_once<'a>(calls: impl Iterator<Item = &'a LoggedCall>) -> usize {
    let mut steps = Vec::new();
    for call in calls {
        let ended = call.end.map(|(ended, _)| ended);
        // A call that begins and ends at one instant does not count.
        if ended != Some(call.begun) {
            steps.push((call.begun, 1));
            steps.extend(ended.map(|ended| (ended, 0)));
        }
    }
    steps.sort_unstable();
    let (mut now, mut most) = (0_usize, 0);
    for (_, begins) in steps {
        now = if begins == 1 { now + 1 } else { now.saturating_sub(1) };
        most = most.max(now);
    }
    most
}

/// Returns each call that was seen, with its request in the trace.
fn pairs<'a>(facts: &'a Facts<'_>) -> Result<Vec<(&'a AdmittedRequest, &'a LoggedCall)>, String> {
    let calls = &facts.calls;
    ensure(calls.len() == facts.played.log.calls.len(), || "a source was asked twice".into())?;
    let mut pairs = Vec::new();
    for requested in &facts.replay.requested {
        pairs.extend(calls.get(&(requested.p, requested.t)).map(|call| (requested, *call)));
    }
    ensure(!facts.is_whole || pairs.len() == calls.len(), || {
        let unknown = facts.played.log.calls.iter().find(|call| {
            !facts
                .replay
                .requested
                .iter()
                .any(|requested| (requested.p, requested.t) == (call.p, call.t))
        });
        format!("it was asked without a decision: {unknown:?}")
    })?;
    Ok(pairs)
}

fn serial(facts: &Facts<'_>, t: u64) -> usize {
    let t = usize::try_from(t).unwrap_or(usize::MAX);
    facts.played.log.written.get(t).map_or(0, |(serial, _)| *serial)
}
