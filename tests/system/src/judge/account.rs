//! Compares an operator's own counts with the counts that its trace implies (D11).

use std::collections::BTreeMap;

use fuseline_engine::{Reasons, SourceTally, Tally};

use super::ensure;
use super::replay::{AdmittedRequest, Departure, Replay};

/// Checks that a tally has the counts that its trace implies (D11). `sent` returns the number of
/// bytes that were sent to a source.
///
/// # Errors
/// Returns both counts if they differ.
pub fn agrees(replay: &Replay, tally: &Tally, sent: impl Fn(u16) -> u64) -> Result<(), String> {
    let traced = traced(replay, tally, sent);
    ensure(traced == *tally, || format!("the tally is {tally:#?}\nthe trace has {traced:#?}"))
}

/// Returns the tally that the trace implies. Facts that the trace lacks are copied from the tally.
fn traced(replay: &Replay, tally: &Tally, sent: impl Fn(u16) -> u64) -> Tally {
    let mut reported = Tally {
        recording_error: tally.recording_error.clone(),
        late_timers: tally.late_timers,
        greatest_lag: tally.greatest_lag,
        handler_failures: tally.handler_failures,
        ..Tally::default()
    };
    for message in &replay.opened {
        match message.end {
            Some(Departure::Refused(why)) => *reported.refused.entry(why).or_default() += 1,
            Some(Departure::Missed) => reported.missed += 1,
            Some(Departure::Preliminary(_) | Departure::Forwarded(..) | Departure::Final(_))
            | None => {}
        }
    }
    reported.messages = replay.opened.len() as u64 - reported.refused.values().sum::<u64>();
    reported.sources =
        tally.sources.iter().map(|source| source_traced(replay, source, &sent)).collect();
    reported
}

fn source_traced(replay: &Replay, tally: &SourceTally, sent: impl Fn(u16) -> u64) -> SourceTally {
    let p = tally.source.priority;
    let requested: Vec<&AdmittedRequest> =
        replay.requested.iter().filter(|requested| requested.p == p).collect();
    let count = |is: fn(&AdmittedRequest) -> bool| {
        requested.iter().filter(|requested| is(requested)).count() as u64
    };
    let mut reported = SourceTally {
        admitted: requested.len() as u64,
        refused: BTreeMap::new(),
        outputs: BTreeMap::new(),
        finals: 0,
        preliminary: 0,
        held: replay.held.iter().filter(|held| **held == p).count() as u64,
        dropped: BTreeMap::new(),
        failed: 0,
        failures_dropped: BTreeMap::new(),
        timers: count(|requested| requested.fired.is_some()),
        cancelled: count(|requested| requested.cancelled.is_some()),
        sent_bytes: sent(p),
        ..tally.clone()
    };
    for offer in replay.offers.iter().filter(|offer| offer.p == p) {
        if let Some(why) = offer.refusal {
            *reported.refused.entry(why).or_default() += 1;
        }
    }
    for item in &replay.items {
        match item.departure {
            Departure::Preliminary(of) if of == p => reported.preliminary += 1,
            Departure::Forwarded(of, trigger) if of == p => {
                *reported.outputs.entry(trigger).or_default() += 1;
            }
            Departure::Final(of) if of == p => reported.finals += 1,
            Departure::Preliminary(_)
            | Departure::Forwarded(..)
            | Departure::Final(_)
            | Departure::Missed
            | Departure::Refused(_) => {}
        }
    }
    for message in &replay.opened {
        reported.failed += message.failures.iter().filter(|of| **of == p).count() as u64;
    }
    for dropped in replay.dropped.iter().filter(|dropped| dropped.p == p) {
        let counts =
            if dropped.is_result { &mut reported.dropped } else { &mut reported.failures_dropped };
        *counts.entry(dropped.why).or_default() += 1;
    }
    // Every accepted failure has its reason.
    if tally.reasons.iter().map(|(_, count)| count).sum::<u64>() + tally.reasons.others()
        != reported.failed
    {
        reported.reasons = Reasons::default();
    }
    reported
}
