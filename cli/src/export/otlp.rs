//! Writes a trace as OpenTelemetry's spans in OTLP JSON. Each message has a span, with a child for
//! local and one for each request.
//!
//! They are written as text, with the keys in alphabetical order. Building them as values of a JSON
//! library took most of the time.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::{self, Write};
use std::mem;

use fuseline_traces::{Annotations, Commit, Decision, Event, Header, Input, ValueKeys};
use ring::digest::{SHA256, digest as digest_of};

use crate::export::viewer::TraceViewer;

/// Writes spans when they end, so the window bounds the number of stored ones.
pub(super) struct SpanWriter<W> {
    out: W,
    commit: Commit,
    operator: String,
    /// The names of local and the clouds, in JSON.
    names: BTreeMap<u64, String>,
    open: BTreeMap<u64, MessageSpan>,
    /// The timestamp that was opened last and may still be refused, and the newest one before it.
    opened: Option<(u64, Option<u64>)>,
    /// The greatest timestamp opened.
    newest: Option<u64>,
    /// The facts about a message that spans cannot express, unless it is refused or dropped next.
    pending: Option<(&'static str, u64)>,
    /// For each kind of fact that spans cannot express, the number of facts and their first
    /// message.
    lost: BTreeMap<&'static str, (u64, u64)>,
    /// The instant of the last line, and of the last line that is in a span.
    ends: (u64, u64),
    /// The text before the next span.
    separator: &'static str,
}

const OUTPUT: &str = "outputs beyond the one that a message's span has";
const REQUEST: &str = "requests that repeat one of their message's span";
const OPEN: &str = "opens of messages that have one";
const STRANGER: &str = "lines of messages without an open";
const END: &str = "instants after the last span, at which something open may be overdue";

/// A message that has not ended.
struct MessageSpan {
    span: Span,
    /// Under progressive, the source of the last output, and the instant at which it was sent.
    by: Option<(u64, u64)>,
    asked: BTreeSet<CallKey>,
    /// Local and the requests that have not ended.
    calls: BTreeMap<CallKey, Span>,
}

/// A span that has not ended.
struct Span {
    trace: String,
    id: String,
    /// `None` for a message's span.
    parent: Option<String>,
    /// The name in JSON.
    name: String,
    kind: u8,
    start: u64,
    /// The list of attributes in JSON.
    attributes: String,
}

/// The priority and the attempt of a request.
type CallKey = (u64, Option<u8>);

/// The end of a call.
#[derive(Clone, Copy)]
enum CallEnd {
    Result(ValueKeys),
    Failed,
    /// A timer or a cancellation ended it.
    EndedByCaller(&'static str),
    /// The trace ends before it.
    Open,
}

impl<W: Write> SpanWriter<W> {
    pub(super) fn new(mut out: W, header: &Header) -> io::Result<Self> {
        let operator = header.operator.clone().unwrap_or_else(|| "operator".to_owned());
        let mut service = String::new();
        attribute(&mut service, "service.name", "stringValue", &in_json(&operator));
        write!(out, r#"{{"resourceSpans":[{{"resource":{{"attributes":[{service}]}},"#)?;
        write!(out, r#""scopeSpans":[{{"scope":{{"name":"fuseline"}},"spans":["#)?;
        let clouds = header
            .clouds
            .iter()
            .filter_map(|cloud| Some((u64::from(cloud.p), in_json(cloud.name.as_deref()?))));
        Ok(Self {
            out,
            commit: header.commit,
            operator,
            names: clouds.chain([(0, in_json("local"))]).collect(),
            open: BTreeMap::new(),
            opened: None,
            newest: None,
            pending: None,
            lost: BTreeMap::new(),
            ends: (0, 0),
            separator: "",
        })
    }

    fn loses(&mut self, what: &'static str, t: u64) {
        self.lost.entry(what).or_insert((0, t)).0 += 1;
    }

    /// Notes a line of a message that has no open span. The span has ended, or the message was
    /// never opened.
    fn loses_late(&mut self, what: &'static str, t: u64) {
        let is_known = self.newest.is_some_and(|newest| t <= newest);
        self.loses(if is_known { what } else { STRANGER }, t);
    }

    fn input(&mut self, input: &Input, annotations: &Annotations) -> io::Result<()> {
        self.opened = None;
        let (at, t, p, end) = match *input {
            Input::Open { at, t, deadline } => {
                // A refused open leaves the open message unchanged.
                if self.newest.is_some_and(|newest| t <= newest) {
                    self.pending = Some((OPEN, t));
                }
                let before = self.newest;
                self.newest = before.max(Some(t));
                if let Entry::Vacant(place) = self.open.entry(t) {
                    let mut message = MessageSpan::new(&self.operator, at, t, annotations);
                    note(&mut message.span, [("fuseline.deadline", deadline)]);
                    place.insert(message);
                    self.opened = Some((t, before));
                }
                return Ok(());
            }
            Input::Result { t, .. } | Input::Fail { t, .. }
                if self.newest.is_none_or(|newest| t > newest) =>
            {
                self.pending = Some((STRANGER, t));
                return Ok(());
            }
            Input::Result { at, t, p } => (at, t, p, CallEnd::Result(annotations.value())),
            Input::Fail { at, t, p } => (at, t, p, CallEnd::Failed),
            Input::Offer { .. } | Input::Tick { .. } => return Ok(()),
        };
        self.end_calls(at, t, |call| call == (p, annotations.attempt), end)
    }

    fn decision(&mut self, decision: &Decision, annotations: &Annotations) -> io::Result<()> {
        match *decision {
            Decision::Request { at, t, p, due } => {
                let call = (p, annotations.attempt);
                let name =
                    self.names.get(&p).cloned().unwrap_or_else(|| in_json(&format!("cloud-{p}")));
                let asked = self.open.get_mut(&t).map(|message| {
                    let is_first = message.asked.insert(call);
                    if is_first {
                        let span = message.call(call, name, at, Some(due - at.min(due)));
                        message.calls.insert(call, span);
                    }
                    is_first
                });
                match asked {
                    None => self.loses_late(REQUEST, t),
                    Some(false) => self.loses(REQUEST, t),
                    Some(true) => {}
                }
                Ok(())
            }
            Decision::Timer { at, t, p } => {
                self.end_calls(at, t, |(of, _)| of == p, CallEnd::EndedByCaller("due"))
            }
            Decision::Cancel { at, t, p } => {
                self.end_calls(at, t, |(of, _)| of == p, CallEnd::EndedByCaller("cancelled"))
            }
            Decision::Emit { at, t, p } if self.commit == Commit::Progressive => {
                match self.open.get_mut(&t).map(|message| message.by.replace((p, at))) {
                    None => self.loses_late(OUTPUT, t),
                    Some(Some(_)) => self.loses(OUTPUT, t),
                    Some(None) => {}
                }
                Ok(())
            }
            Decision::Emit { t, .. } | Decision::Final { t, .. } | Decision::Miss { t, .. }
                if !self.open.contains_key(&t) =>
            {
                self.loses_late(OUTPUT, t);
                Ok(())
            }
            Decision::Emit { at, t, p } => {
                self.end_message(Some(at), t, Some(p), annotations.value())
            }
            Decision::Final { at, t, p } => {
                self.end_message(Some(at), t, Some(p), ValueKeys::default())
            }
            Decision::Miss { at, t } => self.end_message(Some(at), t, None, ValueKeys::default()),
            Decision::RefuseOpen { t, .. } => {
                self.pending.take_if(|(_, pending)| *pending == t);
                if let Some((_, before)) = self.opened.take_if(|(opened, _)| *opened == t) {
                    self.open.remove(&t);
                    self.newest = before;
                }
                Ok(())
            }
            Decision::Drop { t, .. } => {
                self.pending.take_if(|(_, pending)| *pending == t);
                Ok(())
            }
            Decision::RefuseOffer { .. } | Decision::Hold { .. } => Ok(()),
        }
    }

    /// Ends the calls of a message that `is_meant` selects.
    fn end_calls(
        &mut self,
        at: u64,
        t: u64,
        is_meant: impl Fn(CallKey) -> bool,
        end: CallEnd,
    ) -> io::Result<()> {
        let Some(message) = self.open.get_mut(&t) else { return Ok(()) };
        let ended: Vec<_> = message.calls.keys().copied().filter(|call| is_meant(*call)).collect();
        let ended: Vec<_> = ended.iter().filter_map(|call| message.calls.remove(call)).collect();
        for mut span in ended {
            let (code, at) = match end {
                CallEnd::Result(value) => {
                    note(&mut span, keys(value));
                    (1, at)
                }
                CallEnd::Failed => (2, at),
                CallEnd::EndedByCaller(how) => {
                    note_text(&mut span, "fuseline.ended", how);
                    (0, at)
                }
                CallEnd::Open => (0, 0),
            };
            self.write(&span, at, code)?;
        }
        Ok(())
    }

    /// Ends a message, and the calls that nothing waits for any more, at `at`, which is `None` if
    /// the trace ends first.
    fn end_message(
        &mut self,
        at: Option<u64>,
        t: u64,
        by: Option<u64>,
        value: ValueKeys,
    ) -> io::Result<()> {
        let end = if at.is_none() { CallEnd::Open } else { CallEnd::EndedByCaller("retired") };
        self.end_calls(at.unwrap_or(0), t, |_| true, end)?;
        let Some(MessageSpan { mut span, by: sent, .. }) = self.open.remove(&t) else {
            return Ok(());
        };
        // Under progressive a message stays open after its output.
        let sent = sent.map(|(_, sent)| sent).filter(|sent| Some(*sent) != at);
        let latency = sent.map(|sent| sent.saturating_sub(span.start));
        note(&mut span, [("fuseline.latency", latency), ("fuseline.by", by)]);
        note(&mut span, keys(value));
        let code = if by.is_some() || at.is_none() { 1 } else { 2 };
        self.write(&span, at.unwrap_or(0), code)
    }

    fn write(&mut self, span: &Span, end: u64, code: u8) -> io::Result<()> {
        let Span { trace: trace_id, id: span_id, parent, name, kind, start, attributes } = span;
        let comma = mem::replace(&mut self.separator, ",");
        let out = &mut self.out;
        write!(out, "{comma}\n{{\"attributes\":[{attributes}],\"endTimeUnixNano\":\"{end}\",")?;
        write!(out, "\"kind\":{kind},\"name\":{name},")?;
        if let Some(parent) = parent {
            write!(out, "\"parentSpanId\":\"{parent}\",")?;
        }
        write!(out, "\"spanId\":\"{span_id}\",\"startTimeUnixNano\":\"{start}\",")?;
        write!(out, "\"status\":{{\"code\":{code}}},\"traceId\":\"{trace_id}\"}}")
    }
}

/// Adds the numbers that are there to a span's attributes.
fn note<const N: usize>(span: &mut Span, numbers: [(&str, Option<u64>); N]) {
    for (key, number) in numbers {
        if let Some(number) = number {
            attribute(&mut span.attributes, key, "intValue", &format!("\"{number}\""));
        }
    }
}

fn note_text(span: &mut Span, key: &str, text: &str) {
    attribute(&mut span.attributes, key, "stringValue", &in_json(text));
}

/// Adds an attribute, whose value is in JSON, to a list in JSON.
fn attribute(list: &mut String, key: &str, kind: &str, value: &str) {
    let comma = if list.is_empty() { "" } else { "," };
    // Writing to a string cannot fail.
    let _ = write!(list, r#"{comma}{{"key":"{key}","value":{{"{kind}":{value}}}}}"#);
}

/// Returns the keys of a result's or an output's value.
const fn keys(ValueKeys { of, meant_for }: ValueKeys) -> [(&'static str, Option<u64>); 2] {
    [("fuseline.of", of), ("fuseline.for", meant_for)]
}

impl MessageSpan {
    fn new(operator: &str, at: u64, t: u64, annotations: &Annotations) -> Self {
        let own = digest(&format!("{operator}/{t}"), 16);
        let mut span = Span {
            id: own[..16].to_owned(),
            trace: own,
            parent: None,
            name: in_json(operator),
            kind: 1,
            start: at,
            attributes: String::new(),
        };
        let Annotations { within, age, origin, .. } = annotations;
        note(&mut span, [("fuseline.t", Some(t)), ("fuseline.within", *within)]);
        note(&mut span, [("fuseline.age", *age)]);
        if let Some(origin) = origin {
            note_text(&mut span, "fuseline.origin", &origin.stream);
            note(&mut span, [("fuseline.seq", origin.seq)]);
            // The spans of a frame in several operators are one trace.
            if let Some(seq) = origin.seq {
                span.trace = digest(&format!("{}/{seq}", origin.stream), 16);
            }
        }
        let mut message = Self { span, by: None, asked: BTreeSet::new(), calls: BTreeMap::new() };
        let local = message.call((0, None), in_json("local"), at, None);
        message.calls.insert((0, None), local);
        message
    }

    /// Returns the span of a call that begins.
    fn call(&self, call: CallKey, name: String, start: u64, deadline: Option<u64>) -> Span {
        let (p, attempt) = call;
        let Span { trace, id: parent, .. } = &self.span;
        let mut span = Span {
            trace: trace.clone(),
            id: digest(&format!("{parent}/{p}/{attempt:?}"), 8),
            parent: Some(parent.clone()),
            name,
            kind: if p == 0 { 1 } else { 3 },
            start,
            attributes: String::new(),
        };
        let attempt = attempt.map(u64::from);
        note(&mut span, [("fuseline.p", Some(p)), ("fuseline.deadline", deadline)]);
        note(&mut span, [("fuseline.try", attempt)]);
        span
    }
}

impl<W: Write> TraceViewer for SpanWriter<W> {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()> {
        self.ends.0 = self.ends.0.max(event.at());
        if !matches!(event, Event::Input(Input::Tick { .. })) {
            self.ends.1 = self.ends.1.max(event.at());
        }
        // Timers that are due come before the refusal.
        if matches!(event, Event::Input(_))
            && let Some((what, t)) = self.pending.take()
        {
            self.loses(what, t);
        }
        match event {
            Event::Input(input) => self.input(input, annotations),
            Event::Decision(decision) => self.decision(decision, annotations),
        }
    }

    fn left_out(&self) -> Vec<String> {
        let mut lost = self.lost.clone();
        if let Some((what, t)) = self.pending {
            lost.entry(what).or_insert((0, t)).0 += 1;
        }
        if let Some((t, _)) = self.open.first_key_value().filter(|_| self.ends.0 > self.ends.1) {
            lost.insert(END, (1, *t));
        }
        lost.iter()
            .map(|(what, (count, t))| format!("{count} {what} (timestamp {t} first)"))
            .collect()
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let open: Vec<u64> = self.open.keys().copied().collect();
        for t in open {
            let by = self.open.get(&t).and_then(|message| message.by).map(|(p, _)| p);
            self.end_message(None, t, by, ValueKeys::default())?;
        }
        self.out.write_all(b"\n]}]}]}\n")?;
        self.out.flush()
    }
}

/// Returns this many bytes of a text's digest, in hexadecimal.
fn digest(text: &str, bytes: usize) -> String {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    let digest = digest_of(&SHA256, text.as_bytes());
    let digits = digest.as_ref().iter().take(bytes).flat_map(|byte| [byte >> 4, byte & 15]);
    digits.map(|digit| char::from(DIGITS[usize::from(digit)])).collect()
}

/// Returns a text as a JSON string, in quotes.
fn in_json(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
