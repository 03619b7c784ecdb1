//! Checks the tally, the metrics and the trace (D10, D11), and the reports to policies (T5).

use std::collections::BTreeMap;
use std::time::Duration;

use fuseline_engine::{Tally, Trigger};
use fuseline_tokio::deadline::End;
use metrics_util::debugging::DebugValue;

use crate::judge::replay::{AdmittedRequest, Departure};
use crate::judge::{account, ensure};
use crate::simulate::checks::Facts;
use crate::simulate::play::OperatorEnd;
use crate::simulate::scenario::{Disk, OfferAction};

/// The labels of failures of the side requests' message handler.
const SIDE_HANDLER: [(&str, &str); 2] = [("source", "side-1"), ("handler", "message")];

/// The trace is whole (D10).
pub(crate) fn whole_trace(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, .. } = facts;
    if let Some(defect) = &replay.defect {
        return Err(defect.clone());
    }
    if let Some(tally) = &played.tally {
        let is_reported = tally.recording_error.is_some() == (played.ended == OperatorEnd::Early);
        ensure(is_reported, || {
            format!("it ended {:?}, recording_error {:?}", played.ended, tally.recording_error)
        })?;
    }
    if let (Disk::FullAfter(parts, bytes), OperatorEnd::Early) = (scenario.disk, &played.ended) {
        let header = played.trace.iter().position(|byte| *byte == b'\n').unwrap_or(0) as u64 + 1;
        let least = parts * bytes.saturating_sub(header);
        let len = played.trace.len() as u64;
        ensure(len >= least, || format!("{len} bytes are written, there was room for {least}"))?;
    }
    Ok(())
}

/// All counts agree (D11).
pub(crate) fn one_account(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, .. } = facts;
    let metrics = metrics(facts);
    if let Some(tally) = &played.tally {
        if facts.is_whole {
            let calls =
                |p| facts.played.log.calls.iter().filter(|call| call.p == p && p > 0).count();
            account::agrees(&facts.replay, tally, |p| calls(p) as u64)?;
        }
        let metered = if facts.scenario.metered { metered(tally) } else { BTreeMap::new() };
        for (name, count) in &metered {
            let other = metrics.get(name).copied().unwrap_or(0);
            ensure(other == *count, || format!("{name} is {other}, the tally has {count}"))?;
        }
        let of_sides = named("handler_failures", SIDE_HANDLER.into_iter());
        let all =
            metrics.iter().filter(|(name, _)| !name.starts_with("side_") && **name != of_sides);
        let unknown = all.filter(|(name, _)| !name.starts_with("deadlines "));
        let unknown: Vec<_> =
            unknown.filter(|(name, count)| **count > 0 && !metered.contains_key(*name)).collect();
        ensure(unknown.is_empty(), || format!("the tally does not have {unknown:?}"))?;
    }
    sides(facts, &metrics)
}

/// Returns the metrics that a tally implies.
fn metered(tally: &Tally) -> BTreeMap<String, u64> {
    let mut all = BTreeMap::new();
    let mut put = |name: &str, labels: &[(&str, &str)], count| {
        all.insert(named(name, labels.iter().copied()), count);
    };
    put("messages", &[], tally.messages);
    put("missed_messages", &[], tally.missed);
    let of_operator = [("source", "operator"), ("handler", "message")];
    put("handler_failures", &of_operator, tally.handler_failures);
    for (why, count) in &tally.refused {
        put("refused_messages", &[("why", why.as_str())], *count);
    }
    for source in &tally.sources {
        let name = &*source.source.name;
        let mut by = |metric: &str, outcome: &str, count| {
            put(metric, &[("source", name), ("outcome", outcome)], count);
        };
        by("requests", "admitted", source.admitted);
        source.refused.iter().for_each(|(why, count)| by("requests", why.as_str(), *count));
        source.outputs.iter().for_each(|(why, count)| by("outputs", why.as_str(), *count));
        let at_once = source.outputs.get(&Trigger::Arrival).copied().unwrap_or(0);
        by("outputs", "final", source.finals);
        by("results", "forwarded", at_once);
        by("results", "preliminary", source.preliminary);
        by("results", "held", source.held);
        source.dropped.iter().for_each(|(why, count)| by("results", why.as_str(), *count));
        by("failures", "accepted", source.failed);
        source
            .failures_dropped
            .iter()
            .for_each(|(why, count)| by("failures", why.as_str(), *count));
        for (metric, count) in [
            ("lost", source.lost),
            ("held_up", source.held_up),
            ("timers", source.timers),
            ("cancelled", source.cancelled),
            ("sent_bytes", source.sent_bytes),
        ] {
            put(metric, &[("source", name)], count);
        }
        for (handler, count) in
            [("message", source.handler_failures), ("policy", source.policy_failures)]
        {
            put("handler_failures", &[("source", name), ("handler", handler)], count);
        }
    }
    all
}

/// Returns the counters that were metered.
fn metrics(facts: &Facts<'_>) -> BTreeMap<String, u64> {
    let mut all = BTreeMap::new();
    for (key, value) in &facts.played.metrics {
        let DebugValue::Counter(count) = value else { continue };
        let key = key.key();
        let name = key.name().trim_start_matches("fuseline_").trim_end_matches("_total");
        let labels = key.labels().map(|label| (label.key(), label.value()));
        all.insert(named(name, labels.filter(|(key, _)| *key != "operator")), *count);
    }
    all
}

fn named<'a>(name: &str, labels: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut labels: Vec<_> = labels.map(|(key, value)| format!("{key}={value}")).collect();
    labels.sort_unstable();
    format!("{name} {}", labels.join(" "))
}

/// Checks that each side request is made or refused, and that one that was made ends at most once.
fn sides(facts: &Facts<'_>, metrics: &BTreeMap<String, u64>) -> Result<(), String> {
    if facts.scenario.side.is_none() || !facts.is_whole || !facts.scenario.metered {
        return Ok(());
    }
    let count = |outcome| {
        let labels = [("side", "side-1"), ("outcome", outcome)];
        metrics.get(&named("side_requests", labels.into_iter())).copied().unwrap_or(0)
    };
    let [requested, refused] = ["requested", "refused"].map(count);
    let ended: u64 = ["answered", "failed", "expired"].map(count).into_iter().sum();
    let log = &facts.played.log;
    let handled = |is: fn(&OfferAction) -> bool| {
        let handled = facts.replay.opened.iter().filter(|message| {
            let t = usize::try_from(message.t).unwrap_or(usize::MAX);
            let is_refused = matches!(message.end, Some(Departure::Refused(_)));
            let frame = log.written.get(t).map(|(serial, _)| &facts.scenario.frames[*serial]);
            !is_refused && frame.is_some_and(|frame| is(&frame.side))
        });
        handled.count() as u64
    };
    let panicked = handled(|action| matches!(action, OfferAction::Panics));
    let counted = metrics.get(&named("handler_failures", SIDE_HANDLER.into_iter())).copied();
    ensure(counted.unwrap_or(0) == panicked, || {
        format!("the side requests' message handler panicked {panicked} times, {counted:?} counted")
    })?;
    let wanted = handled(|action| matches!(action, OfferAction::Offers(..)));
    ensure(requested + refused == wanted && ended <= requested, || {
        format!(
            "of {wanted} side requests {requested} were requested, {refused} refused, {ended} ended"
        )
    })?;
    let answers = log.sides[3] as u64;
    ensure(count("answered") <= answers && answers <= ended, || {
        format!("{answers} answers came to the response handler, {} counted", count("answered"))
    })
}

/// Checks that a policy gets each end once (T5, D3).
pub(crate) fn every_end_is_reported(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { scenario, played, replay, is_whole, .. } = facts;
    if !is_whole || !facts.runs_out() {
        return Ok(());
    }
    for cloud in scenario.clouds.iter().filter(|cloud| cloud.policy.is_some()) {
        let of_it = replay.requested.iter().filter(|requested| requested.p == cloud.p);
        let requested: Vec<&AdmittedRequest> = of_it.collect();
        let reported = played.log.ends.iter().filter(|(p, _)| *p == cloud.p);
        let reported: Vec<End> = reported.map(|(_, end)| *end).collect();
        if !cloud.linger.is_zero() {
            let least = requested.len().saturating_sub(cloud.calls.max(1));
            let holds = reported.len() <= requested.len() && least <= reported.len();
            ensure(holds, || {
                format!("{} ends of {} were reported", reported.len(), requested.len())
            })?;
            continue;
        }
        let key = |end: &End| match end {
            End::Answered(age) => (0, *age),
            End::Failed(age) => (1, *age),
            End::Censored(age) => (2, *age),
        };
        let mut reported: Vec<_> = reported.iter().map(key).collect();
        let mut due: Vec<_> =
            requested.iter().map(|requested| end(requested)).map(|end| key(&end)).collect();
        reported.sort_unstable();
        due.sort_unstable();
        ensure(reported == due, || format!("{} got {reported:?}, not {due:?}", cloud.p))?;
    }
    Ok(())
}

/// Returns how a request ended for its policy: by its own result or failure, unless it was closed
/// before.
fn end(requested: &AdmittedRequest) -> End {
    let age = |at: u64| Duration::from_nanos(at - requested.at);
    match (requested.ended, requested.closed()) {
        (Some((at, true)), closed) if closed.is_none_or(|closed| at <= closed) => {
            End::Answered(age(at))
        }
        (Some((at, false)), closed) if closed.is_none_or(|closed| at <= closed) => {
            End::Failed(age(at))
        }
        (_, Some(closed)) => End::Censored(age(closed)),
        (_, None) => End::Censored(Duration::MAX),
    }
}
