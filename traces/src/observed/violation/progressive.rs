//! Decides what to report for a timestamp that has no explanation under the progressive rule (F9).
//! It is the first output that does not fit, an output that is missing, or the final.

use super::super::open::{ObservedOutput, WholeMessageHistory};
use super::super::progressive::{ALWAYS, OutputTime, ProgressiveFacts, span};
use super::super::slack::SourceSlack;
use super::super::story::{AllowedOutput, MessageHistory, produced};
use super::{UnlocatedViolation, of_output, output, outputs, reported, reported_as};
use crate::event::{Commit, Decision};
use crate::rule::Rule;

/// Reports the first output that fits in no order with those before it (P1).
pub(super) fn of_disorder(
    t: u64,
    whole: &WholeMessageHistory,
    slack: &SourceSlack,
) -> Option<UnlocatedViolation> {
    let until = |line: u64| {
        let is_before = |output: &&ObservedOutput| output.line <= line;
        let outputs = whole.outputs.iter().filter(is_before).map(|output| (output.p, output.at));
        let finals = whole.finals.iter().filter(is_before);
        MessageHistory {
            outputs: outputs.collect(),
            finals: finals.filter_map(|last| Some((last.p?, last.at))).collect(),
            ..MessageHistory::default()
        }
    };
    let lines = whole.outputs.iter().chain(whole.finals).map(|output| output.line);
    let line = lines.filter(|line| !until(*line).rises(slack)).min()?;
    let expected = "outputs that rise in priority, and a final after them; or one miss alone";
    let found = outputs(t, &until(line));
    Some(UnlocatedViolation::new(Rule::P1, line, found, expected.to_owned()))
}

/// Reports the first output without an explanation, if the facts alone have one and the outputs
/// have one order. Returns `None` if there is no output, or only a miss.
pub(super) fn of_progressive(
    t: u64,
    whole: &WholeMessageHistory,
    slack: &SourceSlack,
    end: u64,
) -> Option<UnlocatedViolation> {
    let without = |story: &MessageHistory| MessageHistory {
        outputs: Vec::new(),
        finals: Vec::new(),
        ..story.clone()
    };
    let (mut unseen, priorities) = without(&whole.story).progressive(slack, end)?;
    let any = ProgressiveFacts::free(&unseen.facts);
    let index = |p: u64| priorities.iter().position(|q| *q == p);
    let mut free = any.clone();
    let mut emits: Vec<(u64, &ObservedOutput)> =
        whole.outputs.iter().filter_map(|output| Some((output.p?, output))).collect();
    emits.sort_unstable_by_key(|(p, _)| *p);
    for (p, output) in &emits {
        let (q, when) = (index(*p), produced(output.at, slack));
        let next = q.map(|q| (q, free.with(q, when))).filter(|(_, next)| next.is_explained());
        let Some((q, next)) = next else {
            let when = q.and_then(|q| free.span(q).or_else(|| any.span(q)));
            let when = when.map(|when| AllowedOutput::produced(Some(*p), when, slack));
            return Some(of_emit(t, whole, output, when, slack));
        };
        free = next;
        unseen.outputs[q] = OutputTime::Within(when);
    }
    if emits.is_empty() && whole.finals.is_empty() {
        return None;
    }
    if !unseen.is_explained() {
        return Some(of_missing(t, whole, (&unseen, &free), &priorities, slack, end));
    }
    let last = whole.finals.first()?;
    Some(of_final(t, last, &unseen, &priorities, slack))
}

/// Reports an output that has no explanation at its instant, beside those that it outranks (F9).
fn of_emit(
    t: u64,
    whole: &WholeMessageHistory,
    emit: &ObservedOutput,
    allowed: Option<AllowedOutput>,
    slack: &SourceSlack,
) -> UnlocatedViolation {
    let ObservedOutput { p, at, line, .. } = *emit;
    let allowed: Vec<_> = allowed.into_iter().collect();
    let fault = of_output(&whole.story, Commit::Progressive, (p, at), &allowed, slack);
    let expected = match (&allowed[..], p) {
        ([], Some(p)) => format!("no output of p {p}"),
        _ => reported(t, &allowed),
    };
    let found = output(t, p, at).to_string();
    fault.violation(Some(line), found, ((p, at), slack), expected, &allowed)
}

/// Reports an accepted result that was not sent (P3 to P5). `free` has the observed outputs and
/// allows any others.
fn of_missing(
    t: u64,
    whole: &WholeMessageHistory,
    (unseen, free): (&ProgressiveFacts, &ProgressiveFacts),
    priorities: &[u64],
    slack: &SourceSlack,
    end: u64,
) -> UnlocatedViolation {
    let is_missing = |q: &usize| !unseen.outputs[*q].is_observed();
    let alone = (0..priorities.len()).filter(is_missing).find_map(|q| {
        let mut with = unseen.clone();
        with.outputs[q] = OutputTime::Within(ALWAYS);
        Some((q, with.span(q)?))
    });
    let missing: Vec<_> = match alone {
        Some(one) => vec![one],
        // Several results are missing.
        None => (0..priorities.len())
            .filter(is_missing)
            .filter_map(|q| Some((q, free.span(q)?)))
            .collect(),
    };
    let allowed: Vec<_> = missing
        .iter()
        .map(|(q, when)| AllowedOutput::produced(priorities.get(*q).copied(), *when, slack))
        .collect();
    let sent = unseen.outputs.iter().rposition(|output| output.is_observed());
    let rule = match alone {
        Some((0, _)) => Rule::P5,
        Some((q, _)) if Some(q) > sent => Rule::P3,
        Some(_) | None => Rule::P4,
    };
    let late = alone.and(allowed.first()).map(|allowed| end.saturating_sub(allowed.to));
    let (found, expected) = (outputs(t, &whole.story), reported(t, &allowed));
    UnlocatedViolation { line: None, rule, found, expected, late, suspicion: None }
}

/// Reports a final that has no explanation at its instant (F9).
fn of_final(
    t: u64,
    last: &ObservedOutput,
    facts: &ProgressiveFacts,
    priorities: &[u64],
    slack: &SourceSlack,
) -> UnlocatedViolation {
    let ObservedOutput { p, at, line, .. } = *last;
    let ends = (0..priorities.len()).rev().filter_map(|q| {
        let when = span(|when| facts.ends(q, when))?;
        Some(AllowedOutput::produced(priorities.get(q).copied(), when, slack))
    });
    let allowed: Vec<_> = ends.collect();
    let same = allowed.iter().find(|allowed| allowed.p == p);
    let late = same.and_then(|same| at.checked_sub(same.to)).filter(|late| *late > 0);
    let found = Decision::Final { at, t, p: p.unwrap_or_default() }.to_string();
    let expected = reported_as("final", t, &allowed);
    let rule = Rule::F9;
    UnlocatedViolation { line: Some(line), rule, found, expected, late, suspicion: None }
}
