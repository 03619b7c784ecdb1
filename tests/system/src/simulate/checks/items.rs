//! Checks of the operator's items, their values and failures, and hints (D1, D2, D7).

use crate::simulate::checks::{Facts, ensure};
use crate::simulate::log::{LoggedOutcome, Read};
use crate::simulate::peers::{name, words};
use crate::simulate::play::RunResult;
use crate::simulate::replay::{Departure, MessageEnd, Replay};
use crate::simulate::scenario::CallResult;
use crate::simulate::value::ValueLabel;

/// Of how many messages the age of a late result is known.
const REMEMBERED: usize = 1024;

/// D1.
pub(crate) fn one_item(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, is_whole, .. } = facts;
    let log = &played.log;
    for (reader, items) in log.items.iter().enumerate() {
        let stays = scenario.readers[reader].leaves_after.is_none();
        // The index where it joined.
        let Some(first) = joined(facts, items) else {
            // What it read came after the end of the trace, or it read nothing.
            let is_empty_right = items.is_empty() && (reader > 0 || replay.ended.is_empty());
            if is_empty_right || !is_whole || !stays || !facts.runs_out() {
                continue;
            }
            return Err(format!("reader {reader} read {items:?}"));
        };
        ensure(reader > 0 || first == 0, || format!("{first} items came before the first"))?;
        let reported = replay.ended.get(first..).unwrap_or_default();
        for (read, index) in items.iter().zip(reported) {
            let opened = &replay.opened[*index];
            let same = opened.t == read.t
                && opened.at == read.opened
                && opened.end.is_some_and(|end| is_same(read, end));
            ensure(same, || {
                format!(
                    "reader {reader} read {read:?}, the trace says {} {:?}",
                    opened.t, opened.end
                )
            })?;
        }
        if !is_whole {
            continue;
        }
        ensure(items.len() <= reported.len(), || {
            format!("reader {reader} read more than there was")
        })?;
        if stays && items.len() < reported.len() {
            // It read to the end: no item that it did not read was handed to anybody.
            ensure(!facts.runs_out() && waits(facts, first + items.len()), || {
                format!("reader {reader} read {} of {} items", items.len(), reported.len())
            })?;
        }
    }
    if facts.runs_out() && scenario.readers[0].leaves_after.is_none() {
        let mut timestamps: Vec<u64> = log.items[0].iter().map(|read| read.t).collect();
        timestamps.sort_unstable();
        let all: Vec<u64> = (0..log.written.len() as u64).collect();
        ensure(timestamps == all, || {
            format!("of {} messages came items {timestamps:?}", log.written.len())
        })?;
    }
    let all = !is_whole || !facts.runs_out() || replay.opened.len() == log.written.len();
    ensure(all, || format!("{} messages of {}", replay.opened.len(), log.written.len()))
}

/// The index in the output from which on a reader read.
fn joined(facts: &Facts<'_>, items: &[Read]) -> Option<usize> {
    let Replay { ended, opened, .. } = &facts.replay;
    let first = items.first()?;
    ended.iter().position(|index| opened[*index].t == first.t)
}

/// Whether the stop found a reader with no room for another item, when so many had been handed out.
fn waits(facts: &Facts<'_>, handed: usize) -> bool {
    let Facts { scenario, played: RunResult { log, .. }, .. } = facts;
    let Some(stopped) = log.stopped else { return false };
    let is_full = |(items, read): (&Vec<Read>, &Option<usize>)| {
        let (Some(first), Some(read)) = (joined(facts, items), read) else { return false };
        first + read + scenario.output_len <= handed
    };
    log.over == Some(stopped) || log.items.iter().zip(&log.read).any(is_full)
}

fn is_same(read: &Read, end: MessageEnd) -> bool {
    let is_same = match (&read.outcome, end.departure) {
        (LoggedOutcome::Forwarded { p, trigger, .. }, departure) => {
            departure == Departure::Forwarded(*p, *trigger)
        }
        (LoggedOutcome::Missed, departure) => departure == Departure::Missed,
        (LoggedOutcome::Refused(why), departure) => departure == Departure::Refused(*why),
    };
    is_same && read.decided == end.at
}

/// D2.
pub(crate) fn its_own_value(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, replay, is_whole, .. } = facts;
    let log = &played.log;
    let is_own = |reported: ValueLabel, p, t: u64, at| {
        let serial = usize::try_from(t).ok().and_then(|t| log.written.get(t)).map(|it| it.0);
        Some(reported) == serial.map(|serial| ValueLabel { p, t, serial, at })
    };
    for read in log.items.iter().flatten() {
        let LoggedOutcome::Forwarded { reported, p, name: named, arrived, .. } = &read.outcome
        else {
            continue;
        };
        ensure(is_own(*reported, *p, read.t, *arrived), || {
            format!("the item of {} from {p}, arrived at {arrived}, bears {reported:?}", read.t)
        })?;
        let its_name = if *p == 0 { "local".to_owned() } else { name(*p) };
        ensure(**named == its_name, || format!("{p} is called {named}"))?;
    }
    for hint in &log.hints {
        ensure(is_own(hint.reported, hint.p, hint.t, hint.at), || format!("a hint is {hint:?}"))?;
        let opened = replay.message(hint.t).map_or(0, |message| message.at);
        let age = u64::try_from(hint.age.as_nanos()).unwrap_or(u64::MAX);
        ensure(!is_whole || age == hint.at - opened, || format!("{hint:?}, opened at {opened}"))?;
    }
    if facts.scenario.hints.is_none() || !is_whole {
        return Ok(());
    }
    let reported = replay.dropped.iter().filter(|dropped| {
        use fuseline_traces::DropReason::{Late, Superseded};
        dropped.is_result && matches!(dropped.why, Late | Superseded)
    });
    let reported: Vec<_> =
        reported.map(|dropped| (dropped.at, dropped.t, dropped.p, dropped.why)).collect();
    let received: Vec<_> =
        log.hints.iter().map(|hint| (hint.at, hint.t, hint.p, hint.why)).collect();
    // Of older messages it is not known when they were opened.
    let mut rest = reported.iter();
    let are_reported = received.iter().all(|hint| rest.any(|reported| reported == hint));
    let are_all = reported.len() == received.len() || replay.opened.len() > REMEMBERED;
    ensure(are_reported && are_all, || format!("hints are {received:?}, dropped were {reported:?}"))
}

/// D7.
pub(crate) fn failures(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, .. } = facts;
    let log = &played.log;
    for read in log.items.iter().flatten() {
        let Some(message) = replay.message(read.t).filter(|message| message.end.is_some()) else {
            continue;
        };
        let reported: Vec<u16> = read.failures.iter().map(|(p, _)| *p).collect();
        let ended = message.end.map_or(u64::MAX, |end| end.at);
        ensure(reported == message.failures, || {
            format!(
                "{} left at {ended} with the failures of {reported:?}, the trace has {:?}",
                read.t, message.failures
            )
        })?;
        for (p, why) in &read.failures {
            let Some(call) = facts.calls.get(&(*p, read.t)) else {
                ensure(*p == 0 && **why == *"too many computations wait", || {
                    format!("{p} fails {} though it was never asked: {why}", read.t)
                })?;
                continue;
            };
            let reported = words(ValueLabel { p: *p, t: read.t, serial: call.serial, at: 0 });
            let act = scenario.act(call.serial, *p);
            let panics = matches!(
                act.map(|act| act.result),
                Some(CallResult::Panics | CallResult::PanicsAtOnce | CallResult::PanickingResponse)
            );
            let reported = if panics { format!("it panicked: {reported}") } else { reported };
            ensure(**why == *reported, || {
                format!("{p} fails {} with {why:?}, not {reported:?}", read.t)
            })?;
        }
    }
    Ok(())
}
