//! Writes a trace as OpenTelemetry's spans in OTLP JSON. Each message has a span, with a child for
//! local and one for each request.
//!
//! They are written as text, with the keys in alphabetical order. Building them as values of a JSON
//! library took most of the time.

use std::borrow::Cow;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::{self, Write};

use fuseline_traces::{Annotations, Commit, Decision, Event, Header, Input, ValueKeys};
use ring::digest::{SHA256, digest as digest_of};

use crate::export::viewer::TraceViewer;

/// Writes spans when they end, so the window bounds the number of stored ones.
pub(super) struct SpanWriter<W> {
    out: W,
    commit: Commit,
    operator: String,
    /// The names of the operator, local and the clouds, in JSON.
    operator_name: String,
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
    is_first: bool,
}

const OUTPUT: &str = "outputs beyond the one that a message's span has";
const REQUEST: &str = "requests that repeat one of their message's span";
const OPEN: &str = "opens of messages that have one";
const STRANGER: &str = "lines of messages without an open";
const END: &str = "instants after the last span, at which something open may be overdue";

/// A message that has not ended.
struct MessageSpan {
    trace_id: String,
    span_id: String,
    start: u64,
    attributes: SpanAttributes,
    /// Under progressive, the source of the last output, and the instant at which it was sent.
    by: Option<(u64, u64)>,
    /// The requests, by their priority and attempt.
    asked: BTreeSet<(u64, Option<u8>)>,
    /// Local and the requests that have not ended, by their priority and attempt.
    calls: BTreeMap<(u64, Option<u8>), CallSpan>,
}

struct CallSpan {
    start: u64,
    attributes: SpanAttributes,
}

/// An entry of a span's list of attributes.
#[derive(Default)]
struct SpanAttributes(String);

/// A span that has ended.
struct EndedSpan<'a> {
    trace_id: &'a str,
    span_id: &'a str,
    /// `None` for a message's span.
    parent: Option<&'a str>,
    /// The value in JSON.
    name: &'a str,
    kind: u8,
    start: u64,
    end: u64,
    code: u8,
    attributes: &'a SpanAttributes,
}

/// The end of a span.
#[derive(Clone, Copy)]
enum SpanEnd {
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
        let mut service = SpanAttributes::default();
        service.text("service.name", &operator);
        let SpanAttributes(service) = service;
        write!(out, r#"{{"resourceSpans":[{{"resource":{{"attributes":[{service}]}},"#)?;
        write!(out, r#""scopeSpans":[{{"scope":{{"name":"fuseline"}},"spans":["#)?;
        let clouds = header
            .clouds
            .iter()
            .filter_map(|cloud| Some((u64::from(cloud.p), in_json(cloud.name.as_deref()?))));
        Ok(Self {
            out,
            commit: header.commit,
            operator_name: in_json(&operator),
            operator,
            names: clouds.chain([(0, in_json("local"))]).collect(),
            open: BTreeMap::new(),
            opened: None,
            newest: None,
            pending: None,
            lost: BTreeMap::new(),
            ends: (0, 0),
            is_first: true,
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
        match *input {
            Input::Open { at, t, deadline } => {
                // A refused open leaves the open message unchanged.
                if self.newest.is_some_and(|newest| t <= newest) {
                    self.pending = Some((OPEN, t));
                }
                let before = self.newest;
                self.newest = before.max(Some(t));
                if let Entry::Vacant(place) = self.open.entry(t) {
                    let mut message = MessageSpan::new(&self.operator, at, t, annotations);
                    message.attributes.optional("fuseline.deadline", deadline);
                    place.insert(message);
                    self.opened = Some((t, before));
                }
                Ok(())
            }
            Input::Result { t, .. } | Input::Fail { t, .. }
                if self.newest.is_none_or(|newest| t > newest) =>
            {
                self.pending = Some((STRANGER, t));
                Ok(())
            }
            Input::Result { at, t, p } => {
                self.end_call(at, t, p, annotations.attempt, SpanEnd::Result(annotations.value()))
            }
            Input::Fail { at, t, p } => {
                self.end_call(at, t, p, annotations.attempt, SpanEnd::Failed)
            }
            Input::Offer { .. } | Input::Tick { .. } => Ok(()),
        }
    }

    fn decision(&mut self, decision: &Decision, annotations: &Annotations) -> io::Result<()> {
        match *decision {
            Decision::Request { at, t, p, due } => {
                if let Some(message) = self.open.get_mut(&t) {
                    let attempt = annotations.attempt;
                    let mut attributes = SpanAttributes::default();
                    attributes.number("fuseline.p", p);
                    attributes.number("fuseline.deadline", due - at.min(due));
                    attributes.optional("fuseline.try", attempt.map(u64::from));
                    let call = CallSpan { start: at, attributes };
                    if message.asked.insert((p, attempt)) {
                        message.calls.insert((p, attempt), call);
                    } else {
                        self.loses(REQUEST, t);
                    }
                } else {
                    self.loses_late(REQUEST, t);
                }
                Ok(())
            }
            Decision::Timer { at, t, p } => self.end_calls(at, t, p, SpanEnd::EndedByCaller("due")),
            Decision::Cancel { at, t, p } => {
                self.end_calls(at, t, p, SpanEnd::EndedByCaller("cancelled"))
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

    fn end_calls(&mut self, at: u64, t: u64, p: u64, end: SpanEnd) -> io::Result<()> {
        let Some(message) = self.open.get(&t) else { return Ok(()) };
        let attempts: Vec<_> = message.calls.keys().filter(|(of, _)| *of == p).copied().collect();
        attempts.into_iter().try_for_each(|(p, attempt)| self.end_call(at, t, p, attempt, end))
    }

    fn end_call(
        &mut self,
        at: u64,
        t: u64,
        p: u64,
        attempt: Option<u8>,
        end: SpanEnd,
    ) -> io::Result<()> {
        let Some(message) = self.open.get_mut(&t) else { return Ok(()) };
        let Some(call) = message.calls.remove(&(p, attempt)) else { return Ok(()) };
        let CallSpan { start, mut attributes } = call;
        let (code, end) = match end {
            SpanEnd::Result(value) => {
                attributes.value(value);
                (1, at)
            }
            SpanEnd::Failed => (2, at),
            SpanEnd::EndedByCaller(how) => {
                attributes.text("fuseline.ended", how);
                (0, at)
            }
            SpanEnd::Open => (0, 0),
        };
        let MessageSpan { trace_id, span_id: parent, .. } = &*message;
        let span_id = digest(&format!("{parent}/{p}/{attempt:?}"), 8);
        let unnamed = || in_json(&format!("cloud-{p}"));
        let name = self.names.get(&p).map_or_else(|| Cow::Owned(unnamed()), Cow::from);
        let span = EndedSpan {
            trace_id,
            span_id: &span_id,
            parent: Some(parent),
            name: &name,
            kind: if p == 0 { 1 } else { 3 },
            start,
            end,
            code,
            attributes: &attributes,
        };
        span.write(&mut self.out, &mut self.is_first)
    }

    /// Ends a message at `at`, which is `None` if the trace ends first.
    fn end_message(
        &mut self,
        at: Option<u64>,
        t: u64,
        by: Option<u64>,
        value: ValueKeys,
    ) -> io::Result<()> {
        self.end_open_calls(at, t)?;
        let Some(message) = self.open.remove(&t) else { return Ok(()) };
        let MessageSpan { trace_id, span_id, start, mut attributes, by: sent, .. } = message;
        // Under progressive a message stays open after its output.
        let sent = sent.map(|(_, sent)| sent).filter(|sent| Some(*sent) != at);
        attributes.optional("fuseline.latency", sent.map(|sent| sent.saturating_sub(start)));
        attributes.optional("fuseline.by", by);
        attributes.value(value);
        let span = EndedSpan {
            trace_id: &trace_id,
            span_id: &span_id,
            parent: None,
            name: &self.operator_name,
            kind: 1,
            start,
            end: at.unwrap_or(0),
            code: if by.is_some() || at.is_none() { 1 } else { 2 },
            attributes: &attributes,
        };
        span.write(&mut self.out, &mut self.is_first)
    }

    /// Ends the calls that nothing waits for when their message ends. `at` is `None` if the trace
    /// ends first.
    fn end_open_calls(&mut self, at: Option<u64>, t: u64) -> io::Result<()> {
        let Some(message) = self.open.get(&t) else { return Ok(()) };
        let calls: Vec<_> = message.calls.keys().copied().collect();
        let end = if at.is_none() { SpanEnd::Open } else { SpanEnd::EndedByCaller("retired") };
        let at = at.unwrap_or(0);
        calls.into_iter().try_for_each(|(p, attempt)| self.end_call(at, t, p, attempt, end))
    }
}

impl EndedSpan<'_> {
    fn write(&self, out: &mut impl Write, is_first: &mut bool) -> io::Result<()> {
        let comma = if std::mem::take(is_first) { "" } else { "," };
        let Self { attributes: SpanAttributes(attributes), end, kind, name, .. } = self;
        write!(out, "{comma}\n{{\"attributes\":[{attributes}],\"endTimeUnixNano\":\"{end}\",")?;
        write!(out, "\"kind\":{kind},\"name\":{name},")?;
        if let Some(parent) = self.parent {
            write!(out, "\"parentSpanId\":\"{parent}\",")?;
        }
        let Self { span_id, start, code, trace_id, .. } = self;
        write!(out, "\"spanId\":\"{span_id}\",\"startTimeUnixNano\":\"{start}\",")?;
        write!(out, "\"status\":{{\"code\":{code}}},\"traceId\":\"{trace_id}\"}}")
    }
}

impl SpanAttributes {
    fn number(&mut self, key: &str, value: u64) {
        self.separate();
        // Writing to a string cannot fail.
        let _ = write!(self.0, r#"{{"key":"{key}","value":{{"intValue":"{value}"}}}}"#);
    }

    fn optional(&mut self, key: &str, value: Option<u64>) {
        if let Some(value) = value {
            self.number(key, value);
        }
    }

    /// Writes the keys of a result's or an output's value.
    fn value(&mut self, ValueKeys { of, meant_for }: ValueKeys) {
        self.optional("fuseline.of", of);
        self.optional("fuseline.for", meant_for);
    }

    fn text(&mut self, key: &str, value: &str) {
        self.separate();
        let value = in_json(value);
        let _ = write!(self.0, r#"{{"key":"{key}","value":{{"stringValue":{value}}}}}"#);
    }

    fn separate(&mut self) {
        if !self.0.is_empty() {
            self.0.push(',');
        }
    }
}

impl MessageSpan {
    fn new(operator: &str, at: u64, t: u64, annotations: &Annotations) -> Self {
        let mut attributes = SpanAttributes::default();
        attributes.number("fuseline.t", t);
        let Annotations { within, age, origin, .. } = annotations;
        attributes.optional("fuseline.within", *within);
        attributes.optional("fuseline.age", *age);
        // The spans of a frame in several operators are one trace.
        let own = digest(&format!("{operator}/{t}"), 16);
        let mut span_id = own.clone();
        span_id.truncate(16);
        let mut trace_id = own;
        if let Some(origin) = origin {
            attributes.text("fuseline.origin", &origin.stream);
            if let Some(seq) = origin.seq {
                attributes.number("fuseline.seq", seq);
                trace_id = digest(&format!("{}/{seq}", origin.stream), 16);
            }
        }
        let mut local = CallSpan { start: at, attributes: SpanAttributes::default() };
        local.attributes.number("fuseline.p", 0);
        Self {
            trace_id,
            span_id,
            start: at,
            attributes,
            by: None,
            asked: BTreeSet::new(),
            calls: BTreeMap::from([((0, None), local)]),
        }
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
