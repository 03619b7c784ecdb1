//! Decides what to report for a timestamp that has no explanation: the rule or promise that is
//! broken, and the outputs that were allowed.

mod progressive;

use self::progressive::{of_disorder, of_progressive};
use super::causes::Suspicion;
use super::doubts::nanos;
use super::open::{ObservedOutput, WholeMessageHistory};
use super::slack::SourceSlack;
use super::story::{AllowedOutput, MessageHistory};
use crate::annotations::{HeaderAnnotations, ValueKeys, allowed_values, meant_value};
use crate::event::{Commit, Decision, Event};
use crate::rule::Rule;

/// A violation with the texts of a verdict.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct UnlocatedViolation {
    /// The line, or `None` for the timestamp's last line.
    pub(super) line: Option<u64>,
    pub(super) rule: Rule,
    pub(super) found: String,
    pub(super) expected: String,
    pub(super) late: Option<u64>,
    /// The possible cause, if it is not the operator.
    pub(super) suspicion: Option<Suspicion>,
}

/// Reports lines for a timestamp that was retired before, if they were not dropped or refused.
pub(super) fn of_again(t: u64, whole: &WholeMessageHistory) -> Option<UnlocatedViolation> {
    if let Some(line) = whole.line() {
        let found = outputs(t, &whole.story);
        let expected = "nothing more: it was forwarded or missed before".to_owned();
        let violation = UnlocatedViolation::new(Rule::P1, line, found, expected);
        let again = whole.is_opened().then_some(Suspicion::OpenedAgain);
        return Some(UnlocatedViolation { suspicion: again, ..violation });
    }
    of_open_or_request(t, whole, "it was opened before, and retired")
}

/// Reports an open that is recorded after an output of its timestamp.
pub(super) fn of_late_open(t: u64, whole: &WholeMessageHistory, by: u64) -> UnlocatedViolation {
    let line = whole.first_open.unwrap_or_default();
    let found = format!("an open of timestamp {t} {} after its first output", nanos(by));
    let expected = "the open before the output".to_owned();
    UnlocatedViolation::new(Rule::F1, line, found, expected)
}

/// Reports lines for a timestamp whose opens were all refused (A42).
pub(super) fn of_refused(t: u64, whole: &WholeMessageHistory) -> Option<UnlocatedViolation> {
    if let Some(line) = whole.line() {
        let found = outputs(t, &whole.story);
        let expected = "nothing: its open was refused".to_owned();
        return Some(UnlocatedViolation::new(Rule::F1, line, found, expected));
    }
    of_open_or_request(t, whole, "its open was refused")
}

/// Reports a timestamp that has no explanation.
pub(super) fn of_story(
    t: u64,
    whole: &WholeMessageHistory,
    (commit, annotations): (Commit, &HeaderAnnotations),
    slack: &SourceSlack,
    end: u64,
) -> Option<UnlocatedViolation> {
    if let Some((line, is_copy)) = whole.second_open {
        let first = whole.first_open.unwrap_or_default();
        let found = format!("a second open of timestamp {t}; the first is line {first}");
        let expected = "a refusal: order".to_owned();
        let suspicion =
            if is_copy { Suspicion::Repeated(Some(line)) } else { Suspicion::OpenedAgain };
        return Some(
            UnlocatedViolation::new(Rule::F1, line, found, expected).suspecting(suspicion),
        );
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
        // The order of the lines does not matter here (P1, A54).
        if let Some(violation) = of_disorder(t, whole, slack) {
            return Some(violation);
        }
    } else if let Some(last) = whole.finals.first() {
        let expected = format!("no final: the rule is {commit}");
        return Some(UnlocatedViolation::new(Rule::F9, last.line, found, expected));
    } else if let [first, second, ..] = &story.outputs[..] {
        let copy = (first == second).then_some(Suspicion::Repeated(line));
        let expected = format!("one output: {}", reported(t, &allowed));
        let unplaced = UnlocatedViolation::new(Rule::P1, 0, found, expected);
        return Some(UnlocatedViolation { line, suspicion: copy, ..unplaced });
    }
    let without = MessageHistory { outputs: Vec::new(), finals: Vec::new(), ..story.clone() };
    if allowed.is_empty() && !without.is_explained_within(commit, slack, end) {
        return Some(of_contradiction(t, story, commit, slack, end));
    }
    if is_progressive && let Some(violation) = of_progressive(t, whole, slack, end) {
        return Some(violation);
    }
    Some(if let Some(output) = story.outputs.first() {
        let fault = of_output(story, commit, *output, &allowed, slack);
        fault.violation(line, found, (*output, slack), reported(t, &allowed), &allowed)
    } else {
        let (rule, late) = of_nothing(story, &allowed, end);
        let expected = reported(t, &allowed);
        UnlocatedViolation { line, rule, found, expected, late, suspicion: None }
    })
}

/// Reports an output whose value is of a message that is not allowed, or is meant for another
/// message (D2, D18).
fn of_value(
    t: u64,
    whole: &WholeMessageHistory,
    output: &ObservedOutput,
    annotations: &HeaderAnnotations,
    slack: &SourceSlack,
) -> Option<UnlocatedViolation> {
    let ObservedOutput { p: Some(p), at, value, line } = *output else { return None };
    let ValueKeys { of, meant_for } = value;
    // A result that certainly came later was not sent.
    let by = at.saturating_add(slack.tolerance()).saturating_add(slack.tolerance_of(p));
    let came = whole.values.iter().filter(|result| result.p == p && result.at <= by);
    // The latest timestamp that the value can be of, if each result has `of`.
    let values: Option<Vec<u64>> = came.clone().map(|result| result.of).collect();
    let latest = values.unwrap_or_default().into_iter().max();
    let allowed = annotations.values_of(t, p);
    let is_allowed = |of: u64| allowed.0 <= of && of <= allowed.1;
    // `true` if each of them is meant for another timestamp.
    let mut meant = came.map(|result| result.is_meant == Some(false)).peekable();
    let is_astray = meant.peek().is_some() && meant.all(|is_other| is_other);
    let (rule, expected) = match (of, latest) {
        (Some(of), _) if !is_allowed(of) => (Rule::D2, allowed_values(allowed)),
        (Some(of), Some(latest)) if of > latest => {
            (Rule::D2, format!("of {latest} or less: no result of p {p} had a later value"))
        }
        (None, Some(latest)) if !is_allowed(latest) => {
            (Rule::D2, format!("{}; the result had a value of {latest}", allowed_values(allowed)))
        }
        _ if meant_for.is_some_and(|it| it != t) => (Rule::D18, meant_value(t)),
        _ if is_astray => (Rule::D18, format!("{}; no result of p {p} had one", meant_value(t))),
        _ => return None,
    };
    let emit = Event::Decision(Decision::Emit { at, t, p });
    let found = emit.annotated(&value.into());
    Some(UnlocatedViolation::new(rule, line, found, expected))
}

/// Reports an output that came after the message's own deadline, or that did not come by then (J2).
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
        rule: Rule::J2,
        found: first.map_or_else(
            || outputs(t, &whole.story),
            |ObservedOutput { p, at, .. }| output(t, *p, *at).to_string(),
        ),
        expected: format!("an output at {by} at the latest: the message's own deadline"),
        late: Some(late),
        suspicion: None,
    })
}

fn of_open_or_request(
    t: u64,
    whole: &WholeMessageHistory,
    why: &str,
) -> Option<UnlocatedViolation> {
    let expected = format!("a refusal: {why}");
    let (rule, found, suspicion) = if whole.is_opened() {
        (Rule::F1, format!("a second open of timestamp {t}"), Some(Suspicion::OpenedAgain))
    } else {
        let requested = whole.story.requests.first().map(|(p, ..)| *p);
        let p = requested.or(whole.stranger.map(|(_, p)| p))?;
        (Rule::F2, format!("a request to p {p}"), None)
    };
    Some(UnlocatedViolation { line: None, rule, found, expected, late: None, suspicion })
}

/// Reports lines that contradict each other, whatever the outputs are.
fn of_contradiction(
    t: u64,
    story: &MessageHistory,
    commit: Commit,
    slack: &SourceSlack,
    end: u64,
) -> UnlocatedViolation {
    let explains = |story: &MessageHistory| !story.allowed_within(commit, slack, end).is_empty();
    if let Some(violation) = of_early_result(story, slack) {
        return violation;
    }
    for i in 0..story.requests.len() {
        let mut without = story.clone();
        let (p, at, due) = without.requests.remove(i);
        if explains(&without) {
            let other = without.requests.iter().find(|(q, ..)| *q == p);
            let expected = if other.is_some() {
                format!("one request to p {p}: a refusal of the second, duplicate")
            } else {
                format!("a refusal: timestamp {t} cannot be open then")
            };
            let is_copy = other == Some(&(p, at, due));
            let suspicion = is_copy.then_some(Suspicion::Repeated(None));
            let found = Decision::Request { at, t, p, due }.to_string();
            let rule = Rule::F2;
            return UnlocatedViolation { line: None, rule, found, expected, late: None, suspicion };
        }
    }
    let found = outputs(t, story);
    let expected =
        "an open first, and each request before its result or failure; no order of these lines \
         within the tolerance allows that"
            .to_owned();
    let rule = Rule::F1;
    UnlocatedViolation { line: None, rule, found, expected, late: None, suspicion: None }
}

/// Reports a result that certainly came before its request, or local's before the open.
fn of_early_result(story: &MessageHistory, slack: &SourceSlack) -> Option<UnlocatedViolation> {
    let opened = story.open.map(|(at, _)| (0, at, slack.tolerance()));
    let asked = |(p, at, _): &(u64, u64, u64)| (*p, *at, slack.tolerance_of(*p));
    let mut begun = opened.into_iter().chain(story.requests.iter().map(asked));
    let early = |(p, asked, tolerance): (u64, u64, u64)| {
        let came = story.results.iter().filter(|(q, _)| *q == p).map(|(_, at)| *at).min()?;
        let both = tolerance.saturating_add(slack.tolerance_of(p));
        (came.saturating_add(both) < asked).then_some((p, came, asked))
    };
    let (p, came, asked) = begun.find_map(early)?;
    let by = asked - came;
    let (what, rule) = if p == 0 { ("the open", Rule::F1) } else { ("its request", Rule::F2) };
    let found = format!("a result of p {p} at {came}, {} before {what} at {asked}", nanos(by));
    Some(UnlocatedViolation {
        line: None,
        rule,
        found,
        expected: format!("a result after {what}"),
        late: None,
        suspicion: Some(Suspicion::ResultBeforeRequest { p, by }),
    })
}

/// Returns the rule or promise that a missing output breaks, and the time by which it is too late.
fn of_nothing(story: &MessageHistory, allowed: &[AllowedOutput], end: u64) -> (Rule, Option<u64>) {
    let by = allowed.iter().map(|allowed| allowed.to).max().unwrap_or(end);
    let has_local = story.results.iter().any(|(p, _)| *p == 0);
    let rule = match (story.requests.is_empty(), has_local) {
        (true, true) => Rule::P6,
        (false, true) => Rule::P5,
        (_, false) => Rule::P7,
    };
    (rule, Some(end.saturating_sub(by)))
}

/// The fault of an output.
#[derive(Clone, Copy, Debug)]
struct OutputFault {
    rule: Rule,
    late: Option<u64>,
    /// The instant of its result, if that is the fault.
    came: Option<u64>,
    /// The due instant of that result.
    due: Option<u64>,
    suspicion: Option<Suspicion>,
}

/// Returns the fault of an output: the rule or promise that it breaks, and the time by which it is
/// too late.
fn of_output(
    story: &MessageHistory,
    commit: Commit,
    (what, at): (Option<u64>, u64),
    allowed: &[AllowedOutput],
    slack: &SourceSlack,
) -> OutputFault {
    let alone = story.requests.is_empty();
    let same = allowed.iter().find(|allowed| allowed.p == what);
    if let Some(same) = same.filter(|same| at > same.to) {
        let rule = match what {
            None => Rule::P7,
            Some(0) if alone => Rule::P6,
            Some(_) => Rule::P4,
        };
        return OutputFault { late: Some(at - same.to), ..OutputFault::of(rule) };
    }
    let Some(p) = what else { return OutputFault::of(Rule::F6) };
    let own = slack.tolerance_of(p);
    if p == 0 && story.without_local {
        return OutputFault::of(Rule::F3);
    }
    let first = |facts: &[(u64, u64)], p: u64| {
        facts.iter().filter(|(q, _)| *q == p).map(|(_, at)| *at).min()
    };
    let fault = OutputFault::of(Rule::P3);
    let Some(came) = first(&story.results, p) else {
        return OutputFault { suspicion: Some(Suspicion::ResultMissing { p, at }), ..fault };
    };
    if came > at.saturating_add(slack.tolerance()).saturating_add(own) {
        let suspicion = Some(Suspicion::ResultAfterOutput { p, by: came - at });
        return OutputFault { came: Some(came), suspicion, ..fault };
    }
    let request = story.requests.iter().find(|(q, ..)| *q == p);
    let due = match request {
        Some((_, _, due)) => Some(*due),
        None => story.open.and_then(|(at, deadline)| Some(at.saturating_add(deadline?))),
    };
    if p > 0 && request.is_none() {
        return OutputFault::of(Rule::F3);
    }
    if let Some(due) = due.filter(|due| came > due.saturating_add(slack.unnoticed(p))) {
        let fault = OutputFault::of(Rule::P2);
        return OutputFault { late: Some(came - due), came: Some(came), due: Some(due), ..fault };
    }
    if same.is_none() && first(&story.failures, p).is_some_and(|failed| failed < came) {
        return OutputFault::of(Rule::F4);
    }
    let higher = allowed.iter().filter_map(|allowed| allowed.p).filter(|q| *q > p);
    let is_outranked =
        higher.into_iter().any(|q| first(&story.results, q).is_some_and(|came| came <= at));
    OutputFault::of(match commit {
        Commit::Progressive => Rule::F9,
        Commit::Eager | Commit::Patient if is_outranked => Rule::P3,
        Commit::Eager | Commit::Patient => Rule::F3,
    })
}

impl OutputFault {
    const fn of(rule: Rule) -> Self {
        Self { rule, late: None, came: None, due: None, suspicion: None }
    }

    /// Describes the violation.
    fn violation(
        self,
        line: Option<u64>,
        found: String,
        ((what, at), slack): ((Option<u64>, u64), &SourceSlack),
        expected: String,
        allowed: &[AllowedOutput],
    ) -> UnlocatedViolation {
        let Self { rule, late, came, due, suspicion } = self;
        let p = what.unwrap_or_default();
        let (found, expected) = match (came, due, suspicion) {
            (Some(came), Some(due), _) => {
                let may_pass = match slack.unnoticed(p) {
                    0 => String::new(),
                    late => format!(", and one up to {} late may pass", nanos(late)),
                };
                let expected =
                    format!("{}: its result was due at {due}{may_pass}", of_what(p, allowed));
                (format!("{found}, of a result that came at {came}"), expected)
            }
            (Some(came), ..) => {
                let by = nanos(came.saturating_sub(at));
                (format!("{found}, whose result came {by} later, at {came}"), expected)
            }
            (_, _, Some(Suspicion::ResultMissing { p, .. })) => {
                (format!("{found}, and no result of p {p} by then"), expected)
            }
            _ => (found, expected),
        };
        UnlocatedViolation { line, rule, found, expected, late, suspicion }
    }
}

/// Describes the allowed outputs without their instants.
fn of_what(p: u64, allowed: &[AllowedOutput]) -> String {
    let kinds = allowed.iter().map(|allowed| match allowed.p {
        Some(p) => format!("emit p {p}"),
        None => "miss".to_owned(),
    });
    let kinds: Vec<_> = kinds.collect();
    if kinds.is_empty() { format!("no output of p {p}") } else { kinds.join(" or ") }
}

/// Describes the outputs as they are in the trace.
fn outputs(t: u64, story: &MessageHistory) -> String {
    let outputs = story.outputs.iter().map(|(p, at)| output(t, *p, *at));
    let finals = story.finals.iter().map(|(p, at)| Decision::Final { at: *at, t, p: *p });
    let reported: Vec<String> = outputs.chain(finals).map(|output| output.to_string()).collect();
    if reported.is_empty() { "no output".to_owned() } else { reported.join(" and ") }
}

const fn output(t: u64, p: Option<u64>, at: u64) -> Decision {
    match p {
        Some(p) => Decision::Emit { at, t, p },
        None => Decision::Miss { at, t },
    }
}

/// Describes the allowed outputs with their instants.
fn reported(t: u64, allowed: &[AllowedOutput]) -> String {
    reported_as("emit", t, allowed)
}

/// Returns the same description, with another word for the output of a source.
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
        Self { line: Some(line), rule, found, expected, late: None, suspicion: None }
    }

    /// Adds a possible cause.
    fn suspecting(self, suspicion: Suspicion) -> Self {
        Self { suspicion: Some(suspicion), ..self }
    }
}
