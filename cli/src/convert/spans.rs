//! Spans as events: a message's span opens and ends it, client spans below it are its requests.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;
use std::time::Duration;

use fuseline_traces::{Annotations, Decision, Event, Input};

use crate::convert::at;
use crate::convert::otlp::{AttributeValue, SpanRecord};
use crate::convert::recorded::{AnnotatedEvent, AnnotatedHeader, ConvertError, Recorded};
use crate::fault::Fault;

#[derive(clap::Args)]
#[command(next_help_heading = "Spans")]
pub(super) struct SpanOptions {
    /// The name of the spans that are messages, or local's computations; by default messages are spans without a parent,
    /// and there is no local [possible roles: message, local].
    #[arg(long, value_name = "ROLE=NAME", value_delimiter = ',', value_parser = role)]
    span: Vec<(SpanRole, String)>,
    /// Where an attribute of a span stands, such as t=frame.id; by default `t` is fuseline.t, and so on. t, within, by
    /// (whose result was sent), took (ns from its start to its output, if the span ends otherwise) and deadline (local's) are a
    /// message's, p, deadline, of and try a request's.
    #[arg(long, value_name = "KEY=NAME", value_delimiter = ',', value_parser = attribute)]
    attribute: Vec<(&'static str, String)>,
    /// How long a request may take whose span does not say so, such as 40ms.
    #[arg(long, value_name = "TIME", value_parser = deadline)]
    deadline: Option<Duration>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum SpanRole {
    Message,
    Local,
    Request,
}

const KEYS: [&str; 8] = ["t", "within", "by", "took", "p", "deadline", "of", "try"];
/// How long after its message's end a result may seem to come: some clocks of spans have whole milliseconds.
const CLOCK_STEP: u64 = 1_000_000;
/// How many parents, or links of attempts, are followed.
const DEPTH: usize = 64;

/// Whose priorities names are.
pub(super) enum SpanSources {
    Known(BTreeMap<String, u64>),
    /// Any name is one, and is gathered here.
    Gathered(Rc<RefCell<Vec<String>>>),
}

/// The events of spans, by their instants.
pub(super) struct SpanEvents {
    events: std::vec::IntoIter<AnnotatedEvent>,
}

/// A file's spans on their way to events.
struct SpanReader<'a> {
    file: &'a str,
    options: &'a SpanOptions,
    sources: SpanSources,
    spans: &'a [SpanRecord],
    by_id: HashMap<&'a str, &'a SpanRecord>,
    events: Vec<AnnotatedEvent>,
}

/// What a span is to a message.
struct SpanOfMessage<'a> {
    t: u64,
    p: u64,
    role: SpanRole,
    span: &'a SpanRecord,
}

impl SpanEvents {
    /// The events of a file's spans.
    pub(super) fn new(
        file: &str,
        spans: &[SpanRecord],
        options: &SpanOptions,
        sources: SpanSources,
    ) -> Result<Self, ConvertError> {
        let by_id = spans.iter().map(|span| (span.span_id.as_str(), span)).collect();
        SpanReader { file, options, sources, spans, by_id, events: Vec::new() }.read()
    }
}

impl Recorded for SpanEvents {
    fn header(&mut self) -> Result<Option<AnnotatedHeader>, Fault> {
        Ok(None)
    }

    fn next_event(&mut self) -> Result<Option<AnnotatedEvent>, Fault> {
        Ok(self.events.next())
    }
}

impl SpanOptions {
    /// What a span is by its name and kind; none is neither.
    fn role(&self, span: &SpanRecord) -> Option<SpanRole> {
        if let Some((role, _)) = self.span.iter().find(|(_, name)| *name == span.name) {
            return Some(*role);
        }
        if self.number(span, "p") == Some(0) {
            return Some(SpanRole::Local);
        }
        let is_named = self.span.iter().any(|(role, _)| *role == SpanRole::Message);
        match span {
            _ if !is_named && span.parent_span_id.is_empty() => Some(SpanRole::Message),
            _ if span.is_client => Some(SpanRole::Request),
            _ => None,
        }
    }

    fn value<'a>(&self, span: &'a SpanRecord, key: &str) -> Option<&'a AttributeValue> {
        let named = self.attribute.iter().find(|(known, _)| *known == key);
        match named {
            Some((_, name)) => span.attributes.get(name),
            None => span.attributes.get(&format!("fuseline.{key}")),
        }
    }

    fn number(&self, span: &SpanRecord, key: &str) -> Option<u64> {
        match self.value(span, key)? {
            AttributeValue::Number(number) => Some(*number),
            AttributeValue::Text(text) => text.parse().ok(),
        }
    }
}

impl<'a> SpanReader<'a> {
    fn read(mut self) -> Result<SpanEvents, ConvertError> {
        let messages = self.messages();
        if messages.is_empty() {
            return Err(self.fault("no span is a message; name them with --span message=NAME"));
        }
        let timestamps: HashMap<&str, u64> =
            messages.iter().map(|(t, span)| (span.span_id.as_str(), *t)).collect();
        let calls = self.calls(&timestamps)?;
        for (t, span) in &messages {
            self.message(*t, span, &calls)?;
        }
        let mut attempts: BTreeMap<(u64, u64), Vec<&SpanOfMessage<'_>>> = BTreeMap::new();
        for call in &calls {
            attempts.entry((call.t, call.p)).or_default().push(call);
        }
        for calls in attempts.values_mut() {
            calls.sort_by_key(|call| call.span.start_time_unix_nano);
            let is_one = calls.len() == 1;
            for (place, call) in calls.iter().enumerate() {
                self.call(call, (!is_one).then_some(place))?;
            }
        }
        self.events.sort_by_key(|(event, _)| at(event));
        Ok(SpanEvents { events: self.events.into_iter() })
    }

    /// The messages by their start, with their timestamps: their own where all have one, else ordinals.
    fn messages(&self) -> Vec<(u64, &'a SpanRecord)> {
        let is_message = |span: &&SpanRecord| self.options.role(span) == Some(SpanRole::Message);
        let mut spans: Vec<_> = self.spans.iter().filter(is_message).collect();
        spans.sort_by_key(|span| span.start_time_unix_nano);
        let own: Option<Vec<u64>> =
            spans.iter().map(|span| self.options.number(span, "t")).collect();
        own.unwrap_or_else(|| (0..spans.len() as u64).collect()).into_iter().zip(spans).collect()
    }

    /// The requests and local's computations of messages.
    fn calls(
        &self,
        timestamps: &HashMap<&str, u64>,
    ) -> Result<Vec<SpanOfMessage<'a>>, ConvertError> {
        let mut calls = Vec::new();
        for span in self.spans {
            let role = match self.options.role(span) {
                Some(role @ (SpanRole::Request | SpanRole::Local)) => role,
                Some(SpanRole::Message) | None => continue,
            };
            let Some(t) = self.message_of(span, timestamps) else { continue };
            let p = if role == SpanRole::Local { 0 } else { self.source(span)? };
            calls.push(SpanOfMessage { t, p, role, span });
        }
        Ok(calls)
    }

    /// The message above a span, or above the attempt that it links to.
    fn message_of(&self, span: &'a SpanRecord, timestamps: &HashMap<&str, u64>) -> Option<u64> {
        let mut here = span;
        for _ in 0..DEPTH {
            if let Some(t) = timestamps.get(here.span_id.as_str()) {
                return Some(*t);
            }
            let parent = self.by_id.get(here.parent_span_id.as_str()).copied();
            // What a client span has below it belongs to its own call.
            if parent.is_some_and(|parent| self.options.role(parent) == Some(SpanRole::Request)) {
                return None;
            }
            let linked =
                || here.links.iter().find_map(|link| self.by_id.get(link.span_id.as_str()));
            here = parent.or_else(|| linked().copied())?;
        }
        None
    }

    fn source(&self, span: &SpanRecord) -> Result<u64, ConvertError> {
        let name = match self.options.value(span, "p") {
            Some(AttributeValue::Number(p)) => p.to_string(),
            Some(AttributeValue::Text(name)) => name.clone(),
            None => span.name.clone(),
        };
        self.priority(&name, span)
    }

    fn priority(&self, name: &str, span: &SpanRecord) -> Result<u64, ConvertError> {
        match &self.sources {
            SpanSources::Gathered(names) => {
                if name != "local" && name != "0" && !names.borrow().iter().any(|it| it == name) {
                    names.borrow_mut().push(name.to_owned());
                }
                Ok(0)
            }
            SpanSources::Known(sources) => {
                let known = sources.get(name).copied().or_else(|| name.parse().ok());
                let message = || format!("{name:?} is no source of the header: {}", this(span));
                known.ok_or_else(|| self.fault(&message()))
            }
        }
    }

    /// A message's open and its end.
    fn message(
        &mut self,
        t: u64,
        span: &SpanRecord,
        calls: &[SpanOfMessage<'_>],
    ) -> Result<(), ConvertError> {
        let at = span.start_time_unix_nano;
        let within = self.options.number(span, "within");
        let deadline = self.options.number(span, "deadline");
        let open = Event::Input(Input::Open { at, t, deadline });
        self.events.push((open, Annotations { within, ..Annotations::NONE }));
        let at = span.end_time_unix_nano;
        if at == 0 || span.attributes.contains_key("fuseline.ended") {
            return Ok(()); // it has not ended, or the run ended before it
        }
        let took = self.options.number(span, "took");
        let at = took.map_or(at, |took| span.start_time_unix_nano.saturating_add(took));
        let used = match self.options.value(span, "by") {
            Some(AttributeValue::Number(p)) => Some(self.priority(&p.to_string(), span)?),
            Some(AttributeValue::Text(name)) => Some(self.priority(name, span)?),
            None if span.has_failed() => None,
            None => {
                let calls = calls.iter().filter(|call| call.t == t);
                last_result(calls, at.saturating_add(CLOCK_STEP))
            }
        };
        let end = match used {
            Some(p) => Decision::Emit { at, t, p },
            None => Decision::Miss { at, t },
        };
        let of = used.and_then(|_| self.options.number(span, "of"));
        self.events.push((Event::Decision(end), Annotations { of, ..Annotations::NONE }));
        Ok(())
    }

    /// A call's request, and its result or failure; `place` is which of several attempts it is.
    fn call(&mut self, call: &SpanOfMessage<'_>, place: Option<usize>) -> Result<(), ConvertError> {
        let SpanOfMessage { t, p, role, span } = *call;
        let attempt = self.options.number(span, "try").or(place.map(|place| place as u64));
        let attempt = attempt.filter(|_| role == SpanRole::Request).map(u8::try_from).transpose();
        let attempt =
            attempt.map_err(|_| self.fault(&format!("more than 256 attempts: {}", this(span))))?;
        let of = self.options.number(span, "of");
        let annotations = Annotations { of: None, attempt, ..Annotations::NONE };
        if role == SpanRole::Request {
            let at = span.start_time_unix_nano;
            let due = at.saturating_add(self.deadline(span)?);
            let request = Event::Decision(Decision::Request { at, t, p, due });
            self.events.push((request, annotations.clone()));
        }
        let at = span.end_time_unix_nano;
        if at == 0 || span.was_ended_by_caller() {
            return Ok(());
        }
        let end = if span.has_failed() {
            (Event::Input(Input::Fail { at, t, p }), annotations)
        } else {
            (Event::Input(Input::Result { at, t, p }), Annotations { of, ..annotations })
        };
        self.events.push(end);
        Ok(())
    }

    fn deadline(&self, span: &SpanRecord) -> Result<u64, ConvertError> {
        let text = match self.options.value(span, "deadline") {
            Some(AttributeValue::Number(nanoseconds)) => return Ok(*nanoseconds),
            Some(AttributeValue::Text(text)) => text,
            None if matches!(self.sources, SpanSources::Gathered(_)) => return Ok(0),
            None => {
                let given = self.options.deadline.map(nanoseconds);
                let message = || format!("no deadline: {}; give --deadline TIME", this(span));
                return given.ok_or_else(|| self.fault(&message()));
            }
        };
        let given = humantime::parse_duration(text).map(nanoseconds);
        given.map_err(|_| self.fault(&format!("{text:?} is no deadline: {}", this(span))))
    }

    fn fault(&self, message: &str) -> ConvertError {
        ConvertError::File { file: self.file.to_owned(), message: message.to_owned() }
    }
}

/// The source of the result that came last before an instant.
fn last_result<'a>(calls: impl Iterator<Item = &'a SpanOfMessage<'a>>, before: u64) -> Option<u64> {
    let ended = |call: &&SpanOfMessage<'_>| {
        let is_result = !call.span.has_failed() && !call.span.was_ended_by_caller();
        is_result && (1..=before).contains(&call.span.end_time_unix_nano)
    };
    let last = calls.filter(ended).max_by_key(|call| (call.span.end_time_unix_nano, call.p));
    last.map(|call| call.p)
}

/// Which span it is, for errors.
fn this(span: &SpanRecord) -> String {
    format!("the span {:?} with the id {}", span.name, span.span_id)
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

fn deadline(text: &str) -> Result<Duration, &'static str> {
    humantime::parse_duration(text).map_err(|_| "it must be a time with a unit, such as 40ms")
}

fn role(text: &str) -> Result<(SpanRole, String), &'static str> {
    match text.split_once('=') {
        Some(("message", name)) => Ok((SpanRole::Message, name.to_owned())),
        Some(("local", name)) => Ok((SpanRole::Local, name.to_owned())),
        _ => Err("it must be message=NAME or local=NAME"),
    }
}

fn attribute(text: &str) -> Result<(&'static str, String), String> {
    let split = text.split_once('=');
    let known = split.and_then(|(key, name)| Some((*KEYS.iter().find(|it| **it == key)?, name)));
    let known = known.map(|(key, name)| (key, name.to_owned()));
    known.ok_or_else(|| format!("it must be KEY=NAME, with a key of {}", KEYS.join(", ")))
}
