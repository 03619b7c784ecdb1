//! Spans as events: a message's span opens and ends it, client spans below it are its requests.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::convert::deadline::Deadlines;
use crate::convert::entry::{Entry, Sources};
use crate::convert::log::CLOCK_STEP;
use crate::convert::otlp::{SpanId, SpanRecord};
use crate::convert::recorded::ConvertError;
use crate::convert::role::{SpanOptions, SpanRole};
use crate::convert::row::{Names, Notes, Place, Spot};
use crate::convert::value::{self, Id, Unit, listed};

/// How many parents, or links of attempts, are followed.
const DEPTH: usize = 64;

const TWICE: &str = "spans exported twice; each was taken once";
const ORPHANS: &str =
    "client spans left out, since no message is above them (its span may not be in the file)";
const BACKWARDS: &str = "messages left out, since a span of theirs ends before it begins";
const ENDLESS: &str = "spans that have not ended, read as still going on";
const NAMELESS: &str = "messages left out, since they have no id";
const AT_ONCE: &str = "failed client spans that ended with their message and before their deadline, read as failures of the cloud";

/// What is read of spans into events.
pub(super) struct SpanReader<'a> {
    /// The first file of the log.
    pub(super) file: Arc<str>,
    pub(super) options: &'a SpanOptions,
    pub(super) deadlines: &'a Deadlines,
    pub(super) sources: &'a mut Sources,
    pub(super) names: &'a mut Names,
    pub(super) notes: &'a mut Notes,
    /// Whether a message that cannot be read is left out.
    pub(super) skips_bad: bool,
    pub(super) entries: Vec<Entry>,
    pub(super) has_ids: bool,
}

/// A message with its spans.
struct SpanMessage<'s> {
    t: Id,
    span: &'s SpanRecord,
    calls: Vec<SpanCall<'s>>,
}

/// What a span is to its message.
#[derive(Clone)]
struct SpanCall<'s> {
    p: u64,
    role: SpanRole,
    span: &'s SpanRecord,
}

type SpansById<'s> = HashMap<&'s SpanId, &'s SpanRecord>;

impl SpanReader<'_> {
    /// Reads the spans of all files: those of one message may stand in several.
    ///
    /// # Errors
    /// If a name that was given occurs nowhere, or a span does not say what it must.
    pub(super) fn read(&mut self, spans: &[SpanRecord]) -> Result<(), ConvertError> {
        for span in spans {
            self.names.add(&span.name.as_str().into());
            span.attributes.keys().for_each(|key| self.names.add(&key.as_str().into()));
        }
        self.options.refuse_mistyped(&self.file, spans)?;
        let spans = self.unique(spans);
        let by_id: SpansById<'_> = spans.iter().map(|span| (&span.id, *span)).collect();
        let mut messages = self.messages(&spans)?;
        if messages.is_empty() {
            let all = Self::names_of(&spans);
            let message = if spans.is_empty() {
                "no whole span in the file".to_owned()
            } else {
                format!("no span is a message; name them with --span message=NAME{all}")
            };
            return Err(ConvertError::file(&self.file, &message));
        }
        self.calls(&spans, &by_id, &mut messages)?;
        messages.retain(|message| {
            let mut all = [message.span].into_iter().chain(message.calls.iter().map(|it| it.span));
            let Some(wrong) = all.find(|span| span.end != 0 && span.end < span.start) else {
                return true;
            };
            let early = i128::from(wrong.start - wrong.end);
            let detail = || format!("by {}", value::shown(early));
            self.notes.add(BACKWARDS, &place(wrong), detail);
            false
        });
        for (number, message) in (0..).zip(&messages) {
            self.note_endless(message);
            self.message(number, message)?;
        }
        self.entries.sort_by_key(|entry| entry.at);
        Ok(())
    }

    /// Notes spans without an end: a clean export has none.
    fn note_endless(&mut self, message: &SpanMessage<'_>) {
        let all = [message.span].into_iter().chain(message.calls.iter().map(|call| call.span));
        // An operator of fuseline ends its spans, or means it.
        let is_own =
            |span: &SpanRecord| span.attributes.keys().any(|key| key.starts_with("fuseline."));
        for span in all.filter(|span| span.end == 0 && !is_own(span)) {
            self.notes.add(ENDLESS, &place(span), String::new);
        }
    }

    fn names_of(spans: &[&SpanRecord]) -> String {
        let mut all: Vec<&str> = spans.iter().map(|span| &*span.name).collect();
        all.sort_unstable();
        all.dedup();
        if all.is_empty() {
            String::new()
        } else {
            format!("; the file has {}", listed("", all.into_iter()))
        }
    }

    /// Each span once: an exporter that tries again delivers some twice. A copy that has ended says more.
    fn unique<'s>(&mut self, spans: &'s [SpanRecord]) -> Vec<&'s SpanRecord> {
        let mut places: HashMap<&SpanId, usize> = HashMap::new();
        let mut unique: Vec<&SpanRecord> = Vec::new();
        for span in spans {
            if let Some(index) = places.get(&span.id) {
                self.notes.add(TWICE, &place(span), String::new);
                if unique[*index].end < span.end {
                    unique[*index] = span;
                }
            } else {
                places.insert(&span.id, unique.len());
                unique.push(span);
            }
        }
        unique
    }

    /// The messages by their start: with ids of their own, or numbered if no id is named and none has one.
    fn messages<'s>(
        &mut self,
        spans: &[&'s SpanRecord],
    ) -> Result<Vec<SpanMessage<'s>>, ConvertError> {
        let is_message = |span: &&&SpanRecord| self.options.role(span) == Some(SpanRole::Message);
        let mut found: Vec<&SpanRecord> = spans.iter().filter(is_message).copied().collect();
        found.sort_by_key(|span| span.start);
        let has_id = |span: &&SpanRecord| self.options.value(span, "t").is_some();
        self.has_ids = self.options.name("t").is_some() || found.iter().any(has_id);
        let mut messages = Vec::new();
        for (number, span) in (0..).zip(found) {
            let t = match self.options.value(span, "t") {
                Some(text) => value::id(text)
                    .map_err(|why| fault(span, &format!("its id {text:?} is {why}")))?,
                None if !self.has_ids => Id::Number(number),
                None if self.skips_bad => {
                    self.notes.add(NAMELESS, &place(span), String::new);
                    continue;
                }
                None => {
                    let name = self.options.name("t").unwrap_or("fuseline.t");
                    let message = format!(
                        "the message has no attribute {name:?}, its id; --skip-bad leaves such messages out"
                    );
                    return Err(fault(span, &message));
                }
            };
            messages.push(SpanMessage { t, span, calls: Vec::new() });
        }
        Ok(messages)
    }

    /// Gives messages their requests and local's computations.
    fn calls<'s>(
        &mut self,
        spans: &[&'s SpanRecord],
        by_id: &SpansById<'s>,
        messages: &mut [SpanMessage<'s>],
    ) -> Result<(), ConvertError> {
        let places: HashMap<&SpanId, usize> =
            messages.iter().enumerate().map(|(place, message)| (&message.span.id, place)).collect();
        for span in spans {
            let role = match self.options.role(span) {
                Some(role @ (SpanRole::Request | SpanRole::Local)) => role,
                Some(SpanRole::Message) | None => continue,
            };
            let message = match self.message_above(span, by_id, &places) {
                Above::Message(message) => message,
                Above::Call => continue,
                Above::Nothing => {
                    self.notes.add(ORPHANS, &place(span), String::new);
                    continue;
                }
            };
            let p = if role == SpanRole::Local {
                0
            } else {
                let name = self.options.value(span, "p").unwrap_or(&span.name);
                self.priority(name, span)?
            };
            messages[message].calls.push(SpanCall { p, role, span });
        }
        Ok(())
    }

    /// The message above a span, or above the attempt that it links to.
    fn message_above(
        &self,
        span: &SpanRecord,
        by_id: &SpansById<'_>,
        messages: &HashMap<&SpanId, usize>,
    ) -> Above {
        let mut here = span;
        for _ in 0..DEPTH {
            if let Some(message) = messages.get(&here.id) {
                return Above::Message(*message);
            }
            let parent = here.parent.as_ref().and_then(|parent| by_id.get(parent)).copied();
            // What a client span has below it belongs to its own call.
            if parent.is_some_and(|parent| self.options.role(parent) == Some(SpanRole::Request)) {
                return Above::Call;
            }
            let linked = || here.links.iter().find_map(|link| by_id.get(link)).copied();
            match parent.or_else(linked) {
                Some(above) => here = above,
                None => return Above::Nothing,
            }
        }
        Above::Nothing
    }

    fn priority(&mut self, name: &str, span: &SpanRecord) -> Result<u64, ConvertError> {
        let known = self.sources.priority(name);
        known.map_err(|why| fault(span, &format!("{name:?} is {why}")))
    }

    /// A message's open, its end, and its calls.
    fn message(&mut self, number: u64, message: &SpanMessage<'_>) -> Result<(), ConvertError> {
        let SpanMessage { t, span, calls } = message;
        let mut more = Vec::new();
        for key in ["deadline", "within"] {
            if let Some(time) = self.duration(span, key)? {
                more.push((key, time.to_string()));
            }
        }
        let entry = |span: &SpanRecord, ev, at: u64, p| Entry {
            place: place(span),
            row: number,
            ev,
            at: at.into(),
            t: Some(t.clone()),
            p,
            due: None,
            of: None,
            more: Vec::new(),
        };
        let open = Entry { more, ..entry(span, "open", span.start, None) };
        let is_open = span.end == 0 || span.attributes.contains_key("fuseline.ended");
        let took = self.duration(span, "took")?;
        let at = took.map_or(span.end, |took| span.start.saturating_add(took));
        let by = self.options.value(span, "by");
        let mut end = entry(span, "emit", at, None);
        if by.is_none() && span.has_failed {
            end.ev = "miss";
        }
        let of = self.options.value(span, "of");
        let of = of.map(value::id).transpose().map_err(|why| fault(span, &why))?;
        if let Some(name) = by {
            end.p = Some(self.priority(name, span)?);
        }
        end.of = of.filter(|_| end.ev == "emit");
        self.entries.push(open);
        if !is_open || took.is_some() {
            self.entries.push(end);
        }
        let mut attempts: BTreeMap<u64, Vec<&SpanCall<'_>>> = BTreeMap::new();
        for call in calls {
            attempts.entry(call.p).or_default().push(call);
        }
        for calls in attempts.values_mut() {
            calls.sort_by_key(|call| call.span.start);
            let is_one = calls.len() == 1;
            for (place, call) in calls.iter().enumerate() {
                self.call(number, message, call, (!is_one).then_some(place))?;
            }
        }
        Ok(())
    }

    /// A call's request, and its result or failure; `attempt` is which of several attempts it is.
    fn call(
        &mut self,
        number: u64,
        message: &SpanMessage<'_>,
        call: &SpanCall<'_>,
        attempt: Option<usize>,
    ) -> Result<(), ConvertError> {
        let SpanCall { p, role, span } = *call;
        let place = place(span);
        let own = self.options.value(span, "try");
        let own = own.map(value::number).transpose().map_err(|why| fault(span, &why))?;
        let attempt = own.or(attempt.map(|place| place as u64));
        let attempt = attempt.filter(|_| role == SpanRole::Request);
        if attempt.is_some_and(|attempt| attempt > 255) {
            return Err(fault(span, "more than 256 attempts"));
        }
        let more: Vec<_> =
            attempt.map(|attempt| ("try", attempt.to_string())).into_iter().collect();
        let t = Some(message.t.clone());
        let at = span.start.into();
        let request = Entry {
            place,
            row: number,
            ev: "request",
            at,
            t,
            p: Some(p),
            due: None,
            of: None,
            more,
        };
        let due = if role == SpanRole::Request { self.due(span, p)? } else { None };
        let at = span.end;
        let has_ended = at != 0 && !span.was_ended_by_caller(self.options.cancelled());
        let mut end = Entry { ev: "result", at: at.into(), ..request.clone() };
        if role == SpanRole::Request {
            self.entries.push(Entry { due, ..request });
        }
        if !has_ended {
            return Ok(());
        }
        if span.has_failed {
            end.ev = "fail";
            self.note_at_once(message, span, due);
        } else {
            let of = self.options.value(span, "of");
            end.of = of.map(value::id).transpose().map_err(|why| fault(span, &why))?;
        }
        self.entries.push(end);
        Ok(())
    }

    /// Notes a call that failed as its message ended: the caller may have ended it.
    fn note_at_once(&mut self, message: &SpanMessage<'_>, span: &SpanRecord, due: Option<i128>) {
        let apart = i128::from(message.span.end) - i128::from(span.end);
        let is_early = due.is_some_and(|due| i128::from(span.end) < due);
        // An operator of fuseline says so itself.
        let is_own = span.attributes.keys().any(|key| key.starts_with("fuseline."));
        if !is_early || !(0..=CLOCK_STEP).contains(&apart) || span.has_status_code() || is_own {
            return;
        }
        let shown = span.attributes.get_key_value("error.type");
        let shown = shown.or_else(|| span.attributes.first_key_value());
        let remedy = shown.map_or_else(
            || "if the caller ended them, give --cancelled ATTRIBUTE=VALUE".to_owned(),
            |(key, value)| format!("if the caller ended them, give --cancelled {key}={value}"),
        );
        self.notes.add_with(AT_ONCE, &place(span), String::new, || remedy);
    }

    /// When a request is due.
    fn due(&mut self, span: &SpanRecord, p: u64) -> Result<Option<i128>, ConvertError> {
        let source = self.sources.name(p);
        let deadline = self.duration(span, "deadline")?.or_else(|| self.deadlines.of(&source));
        if deadline.is_none() && !self.sources.are_gathered() {
            let message = "no deadline; give --deadline TIME";
            return Err(fault(span, message));
        }
        Ok(deadline.map(|deadline| i128::from(span.start.saturating_add(deadline))))
    }

    /// A duration in nanoseconds, or with its unit.
    fn duration(&self, span: &SpanRecord, key: &str) -> Result<Option<u64>, ConvertError> {
        let Some(text) = self.options.value(span, key) else { return Ok(None) };
        let time = value::duration(text, Unit::Ns);
        let time = time.map_err(|why| fault(span, &format!("{key} {text:?} is {why}")))?;
        Ok(u64::try_from(time.nanos).ok())
    }
}

/// What is found above a span.
enum Above {
    Message(usize),
    /// The client span of a call, which it is a part of.
    Call,
    Nothing,
}

fn place(span: &SpanRecord) -> Place {
    Place { file: Arc::clone(&span.file), spot: Spot::Span(span.called().into()) }
}

fn fault(span: &SpanRecord, message: &str) -> ConvertError {
    ConvertError::at(&place(span), message)
}
