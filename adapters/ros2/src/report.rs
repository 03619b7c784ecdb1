//! Reports the node's state: `/diagnostics` once a period, and a status for each message (D15).

use std::time::Duration;

use fuseline_engine::{Ending, Forwarded, Item, Source, SourceTally, Tally, Trigger};
use serde::Serialize;

use crate::key::Stamp;
use crate::middleware::Endpoint;
use crate::raw::Payload;
use crate::source::{NodeSource, UnmatchedResults};
use crate::stamps::ANSWERED;

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct DiagnosticArray {
    pub(crate) header: RosHeader,
    pub(crate) status: Vec<DiagnosticStatus>,
}

/// `std_msgs/msg/RosHeader`.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RosHeader {
    pub(crate) stamp: RosTime,
    pub(crate) frame_id: String,
}

/// `builtin_interfaces/msg/RosTime`.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct RosTime {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

impl RosTime {
    /// Converts nanoseconds after the epoch, or before it.
    pub(crate) fn of_nanos(nanos: i64) -> Self {
        Self {
            sec: i32::try_from(nanos.div_euclid(1_000_000_000)).unwrap_or(i32::MAX),
            nanosec: u32::try_from(nanos.rem_euclid(1_000_000_000)).unwrap_or(0),
        }
    }
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct DiagnosticStatus {
    /// 0 if all is well, 1 for a warning, 2 for an error.
    pub level: u8,
    /// The node's name, and the part of the node that this describes.
    pub name: String,
    /// The state in words.
    pub message: String,
    /// Always empty.
    pub hardware_id: String,
    /// The state in figures.
    pub values: Vec<KeyValue>,
}

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct KeyValue {
    /// The name of the value.
    pub key: String,
    /// The value as text.
    pub value: String,
}

/// The levels of a `DiagnosticStatus`.
const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;

/// Counts since the node's start that the operator does not have.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct NodeCounts {
    /// Inputs too short for their key.
    pub(crate) short: u64,
    /// Inputs whose stamp is no time.
    pub(crate) nanosec: u64,
    /// Inputs that are not plain CDR.
    pub(crate) encoding: u64,
    /// Inputs with the stamp of a message that is open or was answered recently.
    pub(crate) duplicate_stamp: u64,
    /// The inputs among `duplicate_stamp` whose header has the stamp 0.
    pub(crate) stamp_zero: u64,
    /// Accepted messages whose stamp is not greater than all before.
    pub(crate) stamp_backwards: u64,
    /// Outputs not sent because a reliable subscriber was too far behind.
    pub(crate) unsent: u64,
}

/// Reports each period by its difference from the one before.
pub(crate) struct Reporter {
    node: String,
    reported: Tally,
    intake: NodeCounts,
    unmatched: Vec<UnmatchedResults>,
}

impl Reporter {
    /// Returns the reporter of a node that has counted nothing yet.
    pub(crate) fn new(node: &str, tally: Tally) -> Self {
        let unmatched = vec![UnmatchedResults::default(); tally.sources.len()];
        Self { node: node.into(), reported: tally, intake: NodeCounts::default(), unmatched }
    }

    /// Returns the state of the node, of local and of each cloud in the period that ends now.
    /// Counts are since the start; `blind` says that policies know no speed.
    pub(crate) fn period(
        &mut self,
        tally: Tally,
        intake: NodeCounts,
        sources: &[NodeSource],
        ends: &[&Endpoint],
        blind: Option<String>,
    ) -> Vec<DiagnosticStatus> {
        let mut statuses = vec![self.fusion(&tally, intake, ends, blind)];
        for (i, source) in sources.iter().enumerate() {
            if let (Some(now), Some(before)) = (tally.sources.get(i), self.reported.sources.get(i))
            {
                let stray = self.unmatched.get(i).copied().unwrap_or_default();
                statuses.push(self.source(source, now, before, stray));
            }
        }
        self.reported = tally;
        self.intake = intake;
        self.unmatched = sources.iter().map(|source| source.unmatched).collect();
        statuses
    }

    fn fusion(
        &self,
        tally: &Tally,
        intake: NodeCounts,
        ends: &[&Endpoint],
        blind: Option<String>,
    ) -> DiagnosticStatus {
        let missed = tally.missed - self.reported.missed;
        let refused = total(&tally.refused) - total(&self.reported.refused);
        let unsent = intake.unsent - self.intake.unsent;
        let unfit = ends.iter().find_map(|end| unfit(end));
        let silent = ends.iter().find_map(|end| silent(end));
        let rival = ends.iter().find_map(|end| rival(end));
        let nobody = ends.iter().find(|end| end.matched() == 0);
        let (level, message) = if missed > 0 {
            (ERROR, format!("{missed} messages missed"))
        } else if unsent > 0 {
            (ERROR, format!("{unsent} outputs not published: a subscriber is too far behind"))
        } else if let Some(why) = &tally.recording_error {
            (ERROR, format!("the recording has ended: {why}"))
        } else if refused > 0 {
            (WARN, format!("{refused} messages refused"))
        } else if let Some(unread) = self.unread(intake) {
            (WARN, unread)
        } else if let Some(rival) = rival {
            (WARN, rival)
        } else if let Some(unfit) = unfit {
            (WARN, unfit)
        } else if let Some(silent) = silent {
            (WARN, silent)
        } else if let Some(blind) = blind {
            (WARN, blind)
        } else if let Some(end) = nobody {
            (OK, format!("no node on {}", end.topic))
        } else {
            (OK, "each message has its output".to_owned())
        };
        let mut values = vec![
            value("messages", &tally.messages),
            value("forwarded", &tally.forwarded()),
            value("missed", &tally.missed),
        ];
        values.extend(tally.refused.iter().map(|(why, n)| value(&format!("refused {why}"), &n)));
        values.extend(intake.values());
        values.extend(ends.iter().flat_map(|end| end_values(end)));
        self.status("fusion", level, message, values)
    }

    /// Says why inputs of the present period were not taken in, if there are any.
    pub(crate) fn unread(&self, now: NodeCounts) -> Option<String> {
        let before = self.intake;
        let keyless = now.keyless() - before.keyless();
        let repeated = now.duplicate_stamp - before.duplicate_stamp;
        let zero = now.stamp_zero - before.stamp_zero;
        let mut why = Vec::new();
        if keyless > 0 {
            why.push(format!(
                "{keyless} inputs not accepted: too short for their key, an invalid stamp, or not plain CDR"
            ));
        }
        if zero > 0 {
            why.push(format!(
                "{zero} inputs not accepted: header.stamp is 0, as in an earlier message; let the publisher set it, \
                 or give input.key"
            ));
        }
        if repeated > zero {
            why.push(format!(
                "{} inputs not accepted: one of the last {ANSWERED} messages has the same stamp, as when a bag is \
                 played in a loop or two publishers send the same",
                repeated - zero
            ));
        }
        (!why.is_empty()).then(|| why.join("; "))
    }

    fn source(
        &self,
        source: &NodeSource,
        now: &SourceTally,
        before: &SourceTally,
        stray: UnmatchedResults,
    ) -> DiagnosticStatus {
        let requested = now.admitted - before.admitted;
        let without = (now.timers + now.failed) - (before.timers + before.failed);
        let refused = total(&now.refused) - total(&before.refused);
        let lost = now.lost - before.lost;
        let strange = source.unmatched.since(stray);
        let received = received(now) - received(before);
        let unfit = source.ends().find_map(unfit);
        let (level, message) = if !source.enabled {
            (OK, "not enabled".to_owned())
        } else if let Some(who) = source.missing() {
            let unfit = unfit.map(|unfit| format!(" ({unfit})")).unwrap_or_default();
            (ERROR, format!("missing: {who}{unfit}"))
        } else if requested > 0 && without >= requested && received == 0 {
            (ERROR, and(format!("missing: no result to {without} requests"), strange.as_deref()))
        } else if lost > 0 && received == 0 {
            (ERROR, and(format!("missing: no result from {lost} computations"), strange.as_deref()))
        } else if without > 0 {
            (WARN, format!("falling back: {without} requests without a result in time"))
        } else if lost > 0 {
            (WARN, format!("no result from {lost} computations"))
        } else if refused > 0 {
            (WARN, format!("falling back: {refused} requests refused"))
        } else if let Some(strange) = strange {
            (WARN, strange)
        } else if let Some(unfit) = unfit {
            (WARN, unfit)
        } else if let Some(rival) = source.ends().find_map(rival) {
            (WARN, rival)
        } else {
            (OK, "in time".to_owned())
        };
        let mut values = vec![
            value("priority", &source.priority),
            value("requests", &now.admitted),
            value("forwarded", &now.forwarded()),
            value("preliminary", &now.preliminary),
            value("held", &now.held),
            value("timers", &now.timers),
            value("failed", &now.failed),
            value("reasons", &now.reasons),
            value("lost", &now.lost),
            value("cancelled", &now.cancelled),
            value("unknown_stamp", &source.unmatched.unknown_stamp),
            value("malformed", &source.unmatched.malformed),
            value("sent_bytes", &now.sent_bytes),
        ];
        if let Some(in_force) = &now.in_force {
            values.push(seconds("deadline_s", in_force.deadline));
            values.push(value("deadline_why", &in_force.why()));
        }
        values.extend(now.refused.iter().map(|(why, n)| value(&format!("refused {why}"), &n)));
        values.extend(now.dropped.iter().map(|(why, n)| value(&format!("dropped {why}"), &n)));
        values.extend(source.ends().flat_map(end_values));
        self.status(&source.name, level, message, values)
    }

    fn status(
        &self,
        part: &str,
        level: u8,
        message: String,
        values: Vec<KeyValue>,
    ) -> DiagnosticStatus {
        let name = format!("{}: {part}", self.node);
        DiagnosticStatus { level, name, message, hardware_id: String::new(), values }
    }
}

impl NodeCounts {
    const fn keyless(&self) -> u64 {
        self.short + self.nanosec + self.encoding
    }

    fn values(&self) -> [KeyValue; 7] {
        [
            value("malformed short", &self.short),
            value("malformed nanosec", &self.nanosec),
            value("malformed encoding", &self.encoding),
            value("duplicate_stamp", &self.duplicate_stamp),
            value("stamp_zero", &self.stamp_zero),
            value("stamp_backwards", &self.stamp_backwards),
            value("unsent", &self.unsent),
        ]
    }
}

impl UnmatchedResults {
    /// Says what came since then that is no message's result, if anything did.
    fn since(&self, before: Self) -> Option<String> {
        let unknown = self.unknown_stamp - before.unknown_stamp;
        let malformed = self.malformed - before.malformed;
        let zero = self.stamp_zero - before.stamp_zero;
        let remedy = match (zero, malformed) {
            (0, 0) => "",
            (0, _) => ": too short for their key, an invalid stamp, or not plain CDR",
            _ => ": header.stamp is 0; copy the input's header",
        };
        let all = unknown + malformed;
        (all > 0).then(|| format!("{all} results that match no message{remedy}"))
    }
}

/// Returns a state in words, and what else happened.
fn and(state: String, more: Option<&str>) -> String {
    match more {
        Some(more) => format!("{state}; {more}"),
        None => state,
    }
}

/// Returns the status of a message.
pub(crate) fn of_item(node: &str, key: Option<Stamp>, item: &Item<Payload>) -> DiagnosticStatus {
    let mut values = vec![value("timestamp", &item.timestamp), value("revision", &item.revision)];
    values.extend(key.map(|key| value("key", &key)));
    let mut from = |source: &Source, rule: &str| {
        values.push(value("source", source));
        values.push(value("rule", &rule));
    };
    let (level, message) = match &item.ending {
        Ending::Preliminary(Forwarded { source, .. }) => {
            from(source, "F9");
            (OK, format!("{source}, preliminary"))
        }
        Ending::Forwarded(Forwarded { source, trigger, .. }) => {
            from(source, trigger.id());
            (OK, format!("{source} by {trigger}"))
        }
        Ending::Final(source) => {
            from(source, "F9");
            (OK, format!("{source}, final"))
        }
        Ending::Missed => (WARN, "missed".to_owned()),
        Ending::Refused(why) => (WARN, format!("refused: {why}")),
    };
    if let Some(forwarded) = item.forwarded() {
        values.push(seconds("arrived_s", forwarded.arrived.saturating_sub(item.opened)));
    }
    values.push(seconds("decided_s", item.latency()));
    let name = format!("{node}: output");
    DiagnosticStatus { level, name, message, hardware_id: String::new(), values }
}

/// Returns the number of results that came, in time or late.
fn received(tally: &SourceTally) -> u64 {
    let at_once = tally.outputs.get(&Trigger::Arrival).copied().unwrap_or_default();
    at_once + tally.preliminary + tally.held + total(&tally.dropped)
}

/// Describes a mismatch of a topic's peer, if there is one.
fn unfit(end: &Endpoint) -> Option<String> {
    let topic = &end.topic;
    let quality =
        end.incompatible().map(|unfit| format!("incompatible {} on {topic}", unfit.policy));
    quality.or_else(|| Some(format!("a peer on {topic} has another type: {}", end.other_type()?)))
}

/// Describes other publishers of a topic on which the node publishes, if there are any.
fn rival(end: &Endpoint) -> Option<String> {
    let (topic, others) = (&end.topic, end.rivals());
    (others > 0).then(|| {
        format!(
            "others also publish on {topic} ({others}), so a message may have two results; does a \
             second node have this name, or is a node not remapped?"
        )
    })
}

/// Describes a topic's silence, if messages have stopped or never came.
fn silent(end: &Endpoint) -> Option<String> {
    let (topic, matched) = (&end.topic, end.matched());
    let words = |what, silence: Duration| {
        let silence = silence.as_secs_f64();
        format!("{what} on {topic} for {silence:.1} s; matched publishers: {matched}")
    };
    let absent = end.absence().map(|absence| words("no message yet", absence));
    absent.or_else(|| Some(words("nothing came", end.silence()?)))
}

fn end_values(end: &Endpoint) -> Vec<KeyValue> {
    let mut values = vec![value(&format!("matched {}", end.topic), &end.matched())];
    if let Some(unfit) = end.incompatible() {
        let reported_lines = format!("{} peers, {}", unfit.count, unfit.policy);
        values.push(value(&format!("incompatible {}", end.topic), &reported_lines));
    }
    if end.rivals() > 0 {
        values.push(value(&format!("others on {}", end.topic), &end.rivals()));
    }
    values
}

fn total<K: Ord>(counts: &std::collections::BTreeMap<K, u64>) -> u64 {
    counts.values().sum()
}

fn value(key: &str, value: &dyn ToString) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

fn seconds(key: &str, duration: Duration) -> KeyValue {
    value(key, &format!("{:.6}", duration.as_secs_f64()))
}

#[cfg(test)]
mod tests;
