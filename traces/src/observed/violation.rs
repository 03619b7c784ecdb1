//! What to report of a timestamp that has no explanation: the rule or promise that is broken, and what was allowed.

mod progressive;

use self::progressive::{of_disorder, of_progressive};
use super::open::{ObservedOutput, WholeMessageHistory};
use super::slack::SourceSlack;
use super::story::{AllowedOutput, MessageHistory};
use super::verdict::BrokenRule;
use crate::annotations::{Annotations, HeaderAnnotations, allowed_values};
use crate::event::{Commit, Decision, Event};
use crate::rule::Rule;

/// What is wrong, in the words of a verdict.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct UnlocatedViolation {
    /// The line; none for the timestamp's last.
    pub(super) line: Option<u64>,
    pub(super) rule: BrokenRule,
    pub(super) found: String,
    pub(super) expected: String,
    pub(super) late: Option<u64>,
}

/// What comes for a timestamp that was retired before: it must be dropped or refused.
pub(super) fn of_again(t: u64, whole: &WholeMessageHistory) -> Option<UnlocatedViolation> {
    if let Some(line) = whole.line() {
        let found = outputs(t, &whole.story);
        let expected = "nothing more: it was forwarded or missed before".to_owned();
        return Some(UnlocatedViolation::new(Rule::P1, line, found, expected));
    }
    of_open_or_request(t, whole, "it was opened before, and retired")
}

/// What comes for a timestamp of which each open was refused (A42).
pub(super) fn of_refused(t: u64, whole: &WholeMessageHistory) -> Option<UnlocatedViolation> {
    if let Some(line) = whole.line() {
        let found = outputs(t, &whole.story);
        let expected = "nothing: its open was refused".to_owned();
        return Some(UnlocatedViolation::new(Rule::F1, line, found, expected));
    }
    of_open_or_request(t, whole, "its open was refused")
}

/// What no explanation fits.
pub(super) fn of_story(
    t: u64,
    whole: &WholeMessageHistory,
    (commit, annotations): (Commit, &HeaderAnnotations),
    slack: &SourceSlack,
    end: u64,
) -> Option<UnlocatedViolation> {
    if let Some(line) = whole.second_open {
        let found = format!("a second open of timestamp {t}");
        return Some(UnlocatedViolation::new(Rule::F1, line, found, "a refusal: order".to_owned()));
    }
    if let Some((line, p)) = whole.stranger {
        let found = format!("a request to p {p}");
        return Some(UnlocatedViolation::new(
            Rule::F2,
            line,
            found,
            "a refusal: no such cloud".to_owned(),
        ));
    }
    let line = whole.outputs.last().map(|output| output.line);
    let story = &whole.story;
    let is_progressive = commit == Commit::Progressive;
    if is_progressive || whole.outputs.len() == 1 {
        let mut outputs = whole.outputs.iter();
        if let Some(wrong) =
            outputs.find_map(|output| of_value(t, whole, output, annotations, slack))
        {
            return Some(wrong);
        }
    }
    if story.is_explained_within(commit, slack, end) {
        return of_own_deadline(t, whole, slack, end);
    }
    let allowed = story.allowed_within(commit, slack, end);
    let found = outputs(t, story);
    if is_progressive {
        // P1, A54: in whatever order their lines stand.
        if let Some(violation) = of_disorder(t, whole, slack) {
            return Some(violation);
        }
    } else if let Some(last) = whole.finals.first() {
        let expected = format!("no final: the rule is {commit}");
        return Some(UnlocatedViolation::new(Rule::F9, last.line, found, expected));
    } else if story.outputs.len() > 1 {
        let unplaced = UnlocatedViolation::new(Rule::P1, 0, found, reported(t, &allowed));
        return Some(UnlocatedViolation { line, ..unplaced });
    }
    let without = MessageHistory { outputs: Vec::new(), finals: Vec::new(), ..story.clone() };
    if allowed.is_empty() && !without.is_explained_within(commit, slack, end) {
        return Some(of_contradiction(t, story, commit, slack, end));
    }
    if is_progressive && let Some(violation) = of_progressive(t, whole, slack, end) {
        return Some(violation);
    }
    let (rule, late) = match story.outputs.first() {
        Some(output) => of_output(story, commit, *output, &allowed, slack),
        None => of_nothing(story, &allowed, end),
    };
    Some(UnlocatedViolation { line, rule, found, expected: reported(t, &allowed), late })
}

/// D2: whose value it is that was sent.
fn of_value(
    t: u64,
    whole: &WholeMessageHistory,
    output: &ObservedOutput,
    annotations: &HeaderAnnotations,
    slack: &SourceSlack,
) -> Option<UnlocatedViolation> {
    let ObservedOutput { p: Some(p), at, of, line } = *output else { return None };
    // What certainly came later was not sent.
    let by = at.saturating_add(slack.tolerance()).saturating_add(slack.tolerance_of(p));
    let came = whole.values.iter().filter(|(q, came, _)| *q == p && *came <= by);
    // The latest that it can be of, if each result says of which timestamp its value is.
    let values: Option<Vec<u64>> = came.map(|(.., of)| *of).collect();
    let latest = values.unwrap_or_default().into_iter().max();
    let allowed = annotations.values_of(t, p);
    let is_allowed = |of: u64| allowed.0 <= of && of <= allowed.1;
    let expected = match (of, latest) {
        (Some(of), _) if !is_allowed(of) => allowed_values(allowed),
        (Some(of), Some(latest)) if of > latest => {
            format!("of {latest} or less: no result of p {p} had a later value")
        }
        (None, Some(latest)) if !is_allowed(latest) => {
            format!("{}; the result's was of {latest}", allowed_values(allowed))
        }
        _ => return None,
    };
    let emit = Event::Decision(Decision::Emit { at, t, p });
    let found = emit.annotated(&Annotations { of, ..Annotations::NONE });
    Some(UnlocatedViolation::new(Rule::D2, line, found, expected))
}

/// J2: what came out later than the message's own deadline, or nothing by then.
fn of_own_deadline(
    t: u64,
    whole: &WholeMessageHistory,
    slack: &SourceSlack,
    end: u64,
) -> Option<UnlocatedViolation> {
    let by = whole.due?.saturating_add(slack.reach());
    let first = whole.outputs.iter().min_by_key(|output| output.at);
    let late = match first {
        Some(output) => output.at.checked_sub(by).filter(|late| *late > 0)?,
        None => end.checked_sub(by)?,
    };
    Some(UnlocatedViolation {
        line: first.map(|output| output.line),
        rule: BrokenRule::J2,
        found: first.map_or_else(
            || outputs(t, &whole.story),
            |ObservedOutput { p, at, .. }| output(t, *p, *at).to_string(),
        ),
        expected: format!("an output at {by} at the latest: the message's own deadline"),
        late: Some(late),
    })
}

fn of_open_or_request(
    t: u64,
    whole: &WholeMessageHistory,
    why: &str,
) -> Option<UnlocatedViolation> {
    let expected = format!("a refusal: {why}");
    let (rule, found) = if whole.is_opened() {
        (Rule::F1, format!("a second open of timestamp {t}"))
    } else {
        let requested = whole.story.requests.first().map(|(p, ..)| *p);
        let p = requested.or(whole.stranger.map(|(_, p)| p))?;
        (Rule::F2, format!("a request to p {p}"))
    };
    Some(UnlocatedViolation {
        line: None,
        rule: BrokenRule::Rule(rule),
        found,
        expected,
        late: None,
    })
}

/// The lines contradict each other, whatever came out.
fn of_contradiction(
    t: u64,
    story: &MessageHistory,
    commit: Commit,
    slack: &SourceSlack,
    end: u64,
) -> UnlocatedViolation {
    let explains = |story: &MessageHistory| !story.allowed_within(commit, slack, end).is_empty();
    for i in 0..story.requests.len() {
        let mut without = story.clone();
        let (p, at, due) = without.requests.remove(i);
        if explains(&without) {
            let is_second = without.requests.iter().any(|(q, ..)| *q == p);
            let expected = if is_second {
                format!("one request to p {p}: a refusal of the second, duplicate")
            } else {
                format!("a refusal: timestamp {t} cannot be open then")
            };
            let found = Decision::Request { at, t, p, due }.to_string();
            let rule = BrokenRule::Rule(Rule::F2);
            return UnlocatedViolation { line: None, rule, found, expected, late: None };
        }
    }
    let found = outputs(t, story);
    let expected =
        "an open first, and each request before what comes of it; no order of these lines \
                    within the tolerance has that"
            .to_owned();
    UnlocatedViolation { line: None, rule: BrokenRule::Rule(Rule::F1), found, expected, late: None }
}

/// The rule or promise that is broken where nothing came out; and by how much that is too late.
fn of_nothing(
    story: &MessageHistory,
    allowed: &[AllowedOutput],
    end: u64,
) -> (BrokenRule, Option<u64>) {
    let by = allowed.iter().map(|allowed| allowed.to).max().unwrap_or(end);
    let has_local = story.results.iter().any(|(p, _)| *p == 0);
    let rule = match (story.requests.is_empty(), has_local) {
        (true, true) => BrokenRule::P6,
        (false, true) => BrokenRule::P5,
        (_, false) => BrokenRule::P7,
    };
    (rule, Some(end.saturating_sub(by)))
}

/// The rule or promise that an output breaks; and by how much it came too late.
fn of_output(
    story: &MessageHistory,
    commit: Commit,
    (what, at): (Option<u64>, u64),
    allowed: &[AllowedOutput],
    slack: &SourceSlack,
) -> (BrokenRule, Option<u64>) {
    let alone = story.requests.is_empty();
    let same = allowed.iter().find(|allowed| allowed.p == what);
    if let Some(same) = same.filter(|same| at > same.to) {
        let rule = match what {
            None => BrokenRule::P7,
            Some(0) if alone => BrokenRule::P6,
            Some(_) => BrokenRule::P4,
        };
        return (rule, Some(at - same.to));
    }
    let Some(p) = what else { return (BrokenRule::Rule(Rule::F6), None) };
    let own = slack.tolerance_of(p);
    if p == 0 && story.without_local {
        return (BrokenRule::Rule(Rule::F3), None);
    }
    let first = |facts: &[(u64, u64)], p: u64| {
        facts.iter().filter(|(q, _)| *q == p).map(|(_, at)| *at).min()
    };
    let Some(came) = first(&story.results, p) else { return (BrokenRule::P3, None) };
    if came > at.saturating_add(slack.tolerance()).saturating_add(own) {
        return (BrokenRule::P3, None);
    }
    let request = story.requests.iter().find(|(q, ..)| *q == p);
    let due = match request {
        Some((_, _, due)) => Some(*due),
        None => story.open.and_then(|(at, deadline)| Some(at.saturating_add(deadline?))),
    };
    let in_time =
        due.map(|due| due.saturating_add(slack.lateness()).saturating_add(own.saturating_mul(2)));
    if p > 0 && request.is_none() {
        return (BrokenRule::Rule(Rule::F3), None);
    }
    if let Some(by) = in_time.filter(|by| came > *by) {
        return (BrokenRule::P2, Some(came - by));
    }
    if same.is_none() && first(&story.failures, p).is_some_and(|failed| failed < came) {
        return (BrokenRule::Rule(Rule::F4), None);
    }
    let higher = allowed.iter().filter_map(|allowed| allowed.p).filter(|q| *q > p);
    let is_outranked =
        higher.into_iter().any(|q| first(&story.results, q).is_some_and(|came| came <= at));
    let rule = match commit {
        Commit::Progressive => BrokenRule::Rule(Rule::F9),
        Commit::Eager | Commit::Patient if is_outranked => BrokenRule::P3,
        Commit::Eager | Commit::Patient => BrokenRule::Rule(Rule::F3),
    };
    (rule, None)
}

/// What came out, as it stands in the trace.
fn outputs(t: u64, story: &MessageHistory) -> String {
    let outputs = story.outputs.iter().map(|(p, at)| output(t, *p, *at));
    let finals = story.finals.iter().map(|(p, at)| Decision::Final { at: *at, t, p: *p });
    let reported: Vec<String> = outputs.chain(finals).map(|output| output.to_string()).collect();
    if reported.is_empty() { "nothing came out".to_owned() } else { reported.join(" and ") }
}

const fn output(t: u64, p: Option<u64>, at: u64) -> Decision {
    match p {
        Some(p) => Decision::Emit { at, t, p },
        None => Decision::Miss { at, t },
    }
}

/// What is allowed, with its instants.
fn reported(t: u64, allowed: &[AllowedOutput]) -> String {
    reported_as("emit", t, allowed)
}

/// The same, an output of a source being of this kind.
fn reported_as(kind: &str, t: u64, allowed: &[AllowedOutput]) -> String {
    let reported: Vec<String> = allowed
        .iter()
        .map(|AllowedOutput { p, from, to }| {
            let what = p.map_or_else(|| "miss".to_owned(), |p| format!("{kind} p {p}"));
            match *to {
                u64::MAX => format!("{what}, at {from} or later"),
                to => format!("{what}, at {from} to {to}"),
            }
        })
        .collect();
    if reported.is_empty() {
        return format!("nothing yet of timestamp {t}");
    }
    reported.join("; or ")
}

impl UnlocatedViolation {
    fn new(rule: Rule, line: u64, found: String, expected: String) -> Self {
        Self { line: Some(line), rule: BrokenRule::Rule(rule), found, expected, late: None }
    }
}
