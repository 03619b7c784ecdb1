//! Checks the operator's items, their values and failures, and hints (D1, D2, D7).

use std::collections::BTreeSet;

use fuseline_traces::nanos;

use crate::judge::ensure;
use crate::judge::replay::Departure;
use crate::simulate::checks::Facts;
use crate::simulate::log::{LoggedOutcome, LoggedResult, Read};
use crate::simulate::peers::{failure_text, name};
use crate::simulate::play::RunResult;
use crate::simulate::scenario::CallResult;
use crate::simulate::value::ValueLabel;

/// The number of messages for which the age of a late result is known.
const REMEMBERED: usize = 1024;

/// Each message has one item (D1).
pub(crate) fn one_item(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, is_whole, .. } = facts;
    let log = &played.log;
    let read =
        log.items.iter().map(|items| indices(facts, items)).collect::<Result<Vec<_>, _>>()?;
    let handed: BTreeSet<usize> = read.iter().flatten().copied().collect();
    let output = ReadItems { read, handed };
    for (reader, (items, indices)) in log.items.iter().zip(&output.read).enumerate() {
        let first = indices.first().copied().unwrap_or(0);
        ensure(reader > 0 || first == 0, || format!("{first} items came before the first"))?;
        for (read, index) in items.iter().zip(indices) {
            ensure(is_same(facts, &output, (read, *index), first), || {
                format!("reader {reader} read {read:?}, the trace has {:?}", replay.items[*index])
            })?;
        }
        skips(facts, &output, indices)?;
        // A reader that read nothing may have joined after the last item.
        let is_there = reader == 0 || !indices.is_empty();
        let next = indices.last().map_or(0, |last| last + 1);
        let stays = scenario.readers[reader].leaves_after.is_none();
        if *is_whole && stays && is_there && next < replay.items.len() {
            // It read to the end, and no item that it missed was given to anybody.
            ensure(!facts.runs_out() && waits(facts, &output, next), || {
                format!("reader {reader} read {next} of {} items", replay.items.len())
            })?;
        }
    }
    if facts.runs_out() && scenario.readers[0].leaves_after.is_none() {
        let last = log.items[0].iter().filter(|read| read.is_last);
        let mut timestamps: Vec<u64> = last.map(|read| read.t).collect();
        timestamps.sort_unstable();
        let all: Vec<u64> = (0..log.written.len() as u64).collect();
        ensure(timestamps == all, || {
            format!("of {} messages came last items {timestamps:?}", log.written.len())
        })?;
    }
    let all = !is_whole || !facts.runs_out() || replay.opened.len() == log.written.len();
    ensure(all, || format!("{} messages of {}", replay.opened.len(), log.written.len()))
}

/// The output as it was read, by the items' indices in the trace.
struct ReadItems {
    /// The items of each reader.
    read: Vec<Vec<usize>>,
    /// The items that were given to any reader.
    handed: BTreeSet<usize>,
}

/// Returns the indices in the trace of a reader's items, in its order, without what it read after
/// the trace's end.
fn indices(facts: &Facts<'_>, items: &[Read]) -> Result<Vec<usize>, String> {
    let mut indices = Vec::with_capacity(items.len());
    for read in items {
        let Some(index) = facts.replay.item(read.t, read.revision) else {
            ensure(!facts.is_whole, || format!("{read:?} is not in the trace"))?;
            break;
        };
        ensure(indices.last().is_none_or(|last| *last < index), || {
            format!("{read:?} is read after what was decided later")
        })?;
        indices.push(index);
    }
    Ok(indices)
}

/// Checks that only preliminary items are left out, and only while some reader has no room.
fn skips(facts: &Facts<'_>, output: &ReadItems, indices: &[usize]) -> Result<(), String> {
    let Facts { scenario, played: RunResult { log, .. }, replay, .. } = facts;
    // It is not known when a reader left, nor in which order things happened at the instant of a
    // stall.
    let is_known = scenario.stalls.is_empty() && !log.has_left.contains(&true);
    for pair in indices.windows(2) {
        for skipped in pair[0] + 1..pair[1] {
            let item = &replay.items[skipped];
            let lags = |(indices, items): (&Vec<usize>, &Vec<Read>)| {
                // An item that another reader got since this one joined was given to this one too.
                // After a crash it may never read it.
                let Some(first) = indices.first() else { return false };
                let handed = output.handed.range(*first..skipped.max(*first)).count();
                handed >= items.partition_point(|read| read.at < item.at) + scenario.output_len
            };
            let is_preliminary = matches!(item.departure, Departure::Preliminary(_));
            let is_due = !is_known || output.read.iter().zip(&log.items).any(lags);
            ensure(is_preliminary && is_due, || format!("{item:?} was left out"))?;
        }
    }
    Ok(())
}

/// Returns `true` if the operator was stopped while a reader had no room for another item and
/// everything before this one had been given out.
fn waits(facts: &Facts<'_>, output: &ReadItems, next: usize) -> bool {
    let Facts { scenario, played: RunResult { log, .. }, .. } = facts;
    let Some(stopped) = log.stopped else { return false };
    let is_full = |(indices, read): (&Vec<usize>, &Option<usize>)| {
        let (Some(first), Some(read)) = (indices.first(), read) else { return false };
        read + scenario.output_len <= output.handed.range(*first..next.max(*first)).count()
    };
    log.over == Some(stopped) || output.read.iter().zip(&log.read).any(is_full)
}

/// Returns `true` if an item is the trace's item for a reader whose first item is `first`.
fn is_same(
    facts: &Facts<'_>,
    output: &ReadItems,
    (read, index): (&Read, usize),
    first: usize,
) -> bool {
    let item = &facts.replay.items[index];
    let message = &facts.replay.opened[item.message];
    let earlier = message.items.iter().rev().find(|earlier| **earlier < index);
    // This is not known of an item that nobody read before this reader joined.
    let was_handed = earlier.is_some_and(|earlier| output.handed.contains(earlier));
    let may_be_handed = was_handed || earlier.is_some_and(|earlier| *earlier < first);
    let is_same = match (&read.outcome, item.departure) {
        (LoggedOutcome::Preliminary(it), departure) => departure == Departure::Preliminary(it.p),
        // Nobody was given the result before (F9).
        (LoggedOutcome::Forwarded(it), Departure::Final(p)) => !was_handed && it.p == p,
        (LoggedOutcome::Forwarded(it), departure) => {
            departure == Departure::Forwarded(it.p, it.trigger)
        }
        (LoggedOutcome::Final(p), departure) => may_be_handed && departure == Departure::Final(*p),
        (LoggedOutcome::Missed, departure) => departure == Departure::Missed,
        (LoggedOutcome::Refused(why), departure) => departure == Departure::Refused(*why),
    };
    is_same && (read.opened, read.decided) == (message.at, item.at)
}

/// Each value is its message's own (D2).
pub(crate) fn its_own_value(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, replay, is_whole, .. } = facts;
    let log = &played.log;
    let is_own = |reported: ValueLabel, p, t: u64, at| {
        let serial = usize::try_from(t).ok().and_then(|t| log.written.get(t)).map(|it| it.0);
        Some(reported) == serial.map(|serial| ValueLabel { p, t, serial, at })
    };
    for read in log.items.iter().flatten() {
        let Some(LoggedResult { reported, p, name: named, arrived, .. }) = read.outcome.result()
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
        let age = nanos(hint.age);
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
    // It is not known when older messages were opened.
    let mut rest = reported.iter();
    let are_reported = received.iter().all(|hint| rest.any(|reported| reported == hint));
    let are_all = reported.len() == received.len() || replay.opened.len() > REMEMBERED;
    ensure(are_reported && are_all, || format!("hints are {received:?}, dropped were {reported:?}"))
}

/// An error or a panic fails only its own call (D7).
pub(crate) fn failures(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, .. } = facts;
    let log = &played.log;
    for read in log.items.iter().flatten() {
        let Some(index) = replay.item(read.t, read.revision) else { continue };
        let item = &replay.items[index];
        let failures = &replay.opened[item.message].failures[..item.failures];
        let reported: Vec<u16> = read.failures.iter().map(|(p, _)| *p).collect();
        ensure(reported == failures, || {
            format!(
                "{} left at {} with the failures of {reported:?}, the trace has {failures:?}",
                read.t, item.at
            )
        })?;
        for (p, why) in &read.failures {
            let Some(call) = facts.calls.get(&(*p, read.t)) else {
                ensure(*p == 0 && **why == *"too many computations wait", || {
                    format!("{p} fails {} though it was never asked: {why}", read.t)
                })?;
                continue;
            };
            let reported =
                failure_text(ValueLabel { p: *p, t: read.t, serial: call.serial, at: 0 });
            let act = scenario.act(call.serial, *p);
            let panics = matches!(
                act.map(|act| act.result),
                Some(CallResult::Panics | CallResult::PanicsAtOnce | CallResult::PanickingResponse)
            ) && !call.has_no_room;
            let reported = if panics { format!("it panicked: {reported}") } else { reported };
            ensure(**why == *reported, || {
                format!("{p} fails {} with {why:?}, not {reported:?}", read.t)
            })?;
        }
    }
    Ok(())
}
