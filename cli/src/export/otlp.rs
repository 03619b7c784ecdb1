//! A trace as OpenTelemetry's spans, in OTLP JSON: a message's span, below it one for local and one for each request.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::Write as _;
use std::io::{self, Write};

use fuseline_traces::{Annotations, Commit, Decision, Event, Header, Input};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::export::viewer::TraceViewer;

/// Spans are written when they end, so what is held is bounded by the window.
pub(super) struct SpanWriter<W> {
    out: W,
    header: Header,
    operator: String,
    open: BTreeMap<u64, MessageSpan>,
    /// Opened last, and perhaps refused.
    opened: Option<u64>,
    is_first: bool,
}

/// A message that has not ended.
struct MessageSpan {
    trace_id: String,
    span_id: String,
    start: u64,
    attributes: Vec<Value>,
    /// Of the last output under progressive.
    by: Option<u64>,
    /// Local and the requests that have not ended, by their priority and attempt.
    calls: BTreeMap<(u64, Option<u8>), CallSpan>,
}

struct CallSpan {
    start: u64,
    attributes: Vec<Value>,
}

/// How a span ended.
#[derive(Clone, Copy)]
enum SpanEnd {
    Result(Option<u64>),
    Failed,
    /// By a timer or a cancellation.
    EndedByCaller(&'static str),
    /// The trace ends before it.
    Open,
}

impl<W: Write> SpanWriter<W> {
    pub(super) fn new(mut out: W, header: &Header) -> io::Result<Self> {
        let operator = header.operator.clone().unwrap_or_else(|| "operator".to_owned());
        let resource = json!({"attributes": [text("service.name", &operator)]});
        write!(out, r#"{{"resourceSpans":[{{"resource":{resource},"scopeSpans":[{{"#)?;
        write!(out, r#""scope":{{"name":"fuseline"}},"spans":["#)?;
        let open = BTreeMap::new();
        Ok(Self { out, header: header.clone(), operator, open, opened: None, is_first: true })
    }

    fn input(&mut self, input: &Input, annotations: &Annotations) -> io::Result<()> {
        self.opened = None;
        match *input {
            Input::Open { at, t, deadline } => {
                // One that is refused leaves the message that is open as it is.
                if let Entry::Vacant(place) = self.open.entry(t) {
                    let mut message = MessageSpan::new(&self.operator, at, t, annotations);
                    message.attributes.extend(deadline.map(|it| number("fuseline.deadline", it)));
                    place.insert(message);
                    self.opened = Some(t);
                }
                Ok(())
            }
            Input::Result { at, t, p } => {
                self.end_call(at, t, p, annotations.attempt, SpanEnd::Result(annotations.of))
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
                    let mut attributes = vec![
                        number("fuseline.p", p),
                        number("fuseline.deadline", due - at.min(due)),
                    ];
                    let attempt = annotations.attempt;
                    attributes.extend(attempt.map(|it| number("fuseline.try", it.into())));
                    message.calls.insert((p, attempt), CallSpan { start: at, attributes });
                }
                Ok(())
            }
            Decision::Timer { at, t, p } => self.end_calls(at, t, p, SpanEnd::EndedByCaller("due")),
            Decision::Cancel { at, t, p } => {
                self.end_calls(at, t, p, SpanEnd::EndedByCaller("cancelled"))
            }
            Decision::Emit { t, p, .. } if self.header.commit == Commit::Progressive => {
                if let Some(message) = self.open.get_mut(&t) {
                    message.by = Some(p);
                }
                Ok(())
            }
            Decision::Emit { at, t, p } => self.end_message(at, t, Some(p), annotations.of),
            Decision::Final { at, t, p } => self.end_message(at, t, Some(p), None),
            Decision::Miss { at, t } => self.end_message(at, t, None, None),
            Decision::RefuseOpen { t, .. } => {
                if self.opened.take() == Some(t) {
                    self.open.remove(&t);
                }
                Ok(())
            }
            Decision::RefuseOffer { .. } | Decision::Hold { .. } | Decision::Drop { .. } => Ok(()),
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
        let (trace_id, parent) = (message.trace_id.clone(), message.span_id.clone());
        let CallSpan { start, mut attributes } = call;
        let (code, at) = match end {
            SpanEnd::Result(of) => {
                attributes.extend(of.map(|of| number("fuseline.of", of)));
                (1, at)
            }
            SpanEnd::Failed => (2, at),
            SpanEnd::EndedByCaller(how) => {
                attributes.push(text("fuseline.ended", how));
                (0, at)
            }
            SpanEnd::Open => (0, 0),
        };
        let span_id = digest(&format!("{parent}/{p}/{attempt:?}"), 8);
        let named = self.header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
        let name = match named.and_then(|cloud| cloud.name.clone()) {
            _ if p == 0 => "local".to_owned(),
            Some(name) => name,
            None => format!("cloud-{p}"),
        };
        self.span(&json!({
            "traceId": trace_id, "spanId": span_id, "parentSpanId": parent, "name": name,
            "kind": if p == 0 { 1 } else { 3 }, "startTimeUnixNano": start.to_string(),
            "endTimeUnixNano": at.to_string(), "attributes": attributes, "status": {"code": code},
        }))
    }

    fn end_message(&mut self, at: u64, t: u64, by: Option<u64>, of: Option<u64>) -> io::Result<()> {
        self.end_open_calls(at, t)?;
        let Some(message) = self.open.remove(&t) else { return Ok(()) };
        let MessageSpan { trace_id, span_id, start, mut attributes, .. } = message;
        attributes.extend(by.map(|by| number("fuseline.by", by)));
        attributes.extend(of.map(|of| number("fuseline.of", of)));
        let code = if by.is_some() || at == 0 { 1 } else { 2 };
        let name = self.operator.clone();
        self.span(&json!({
            "traceId": trace_id, "spanId": span_id, "name": name, "kind": 1,
            "startTimeUnixNano": start.to_string(), "endTimeUnixNano": at.to_string(),
            "attributes": attributes, "status": {"code": code},
        }))
    }

    /// What is not awaited any more when its message ends; at 0 the trace ends first.
    fn end_open_calls(&mut self, at: u64, t: u64) -> io::Result<()> {
        let Some(message) = self.open.get(&t) else { return Ok(()) };
        let calls: Vec<_> = message.calls.keys().copied().collect();
        let end = if at == 0 { SpanEnd::Open } else { SpanEnd::EndedByCaller("retired") };
        calls.into_iter().try_for_each(|(p, attempt)| self.end_call(at, t, p, attempt, end))
    }

    fn span(&mut self, span: &Value) -> io::Result<()> {
        let comma = if std::mem::take(&mut self.is_first) { "" } else { "," };
        write!(self.out, "{comma}\n{span}")
    }
}

impl MessageSpan {
    fn new(operator: &str, at: u64, t: u64, annotations: &Annotations) -> Self {
        let mut attributes = vec![number("fuseline.t", t)];
        let Annotations { within, age, origin, .. } = annotations;
        attributes.extend(within.map(|within| number("fuseline.within", within)));
        attributes.extend(age.map(|age| number("fuseline.age", age)));
        // The spans of a frame in several operators are one trace.
        let mut frame = format!("{operator}/{t}");
        if let Some(origin) = origin {
            attributes.push(text("fuseline.origin", &origin.stream));
            if let Some(seq) = origin.seq {
                attributes.push(number("fuseline.seq", seq));
                frame = format!("{}/{seq}", origin.stream);
            }
        }
        let local = CallSpan { start: at, attributes: vec![number("fuseline.p", 0)] };
        Self {
            trace_id: digest(&frame, 16),
            span_id: digest(&format!("{operator}/{t}"), 8),
            start: at,
            attributes,
            by: None,
            calls: BTreeMap::from([((0, None), local)]),
        }
    }
}

impl<W: Write> TraceViewer for SpanWriter<W> {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()> {
        match event {
            Event::Input(input) => self.input(input, annotations),
            Event::Decision(decision) => self.decision(decision, annotations),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let open: Vec<u64> = self.open.keys().copied().collect();
        for t in open {
            let by = self.open.get(&t).and_then(|message| message.by);
            self.end_message(0, t, by, None)?;
        }
        self.out.write_all(b"\n]}]}]}\n")?;
        self.out.flush()
    }
}

/// So many bytes of a text's digest, in hexadecimal.
fn digest(text: &str, bytes: usize) -> String {
    Sha256::digest(text.as_bytes()).iter().take(bytes).fold(String::new(), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

fn number(key: &str, value: u64) -> Value {
    json!({"key": key, "value": {"intValue": value.to_string()}})
}

fn text(key: &str, value: &str) -> Value {
    json!({"key": key, "value": {"stringValue": value}})
}
