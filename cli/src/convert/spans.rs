//! Spans as events: a message's span opens and ends it, client spans below it are its requests.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::convert::entry::Entry;
use crate::convert::log::CLOCK_STEP;
use crate::convert::mapping::Mapping;
use crate::convert::notes::listed;
use crate::convert::otlp::{SpanId, SpanRecord};
use crate::convert::role::{SpanOptions, SpanRole, has_status_code};
use crate::convert::row::Problem;
use crate::convert::time::duration;
use crate::duration::in_words;

/// At most this many parents, or links of attempts, are followed.
const DEPTH: usize = 64;

const TWICE: &str = "spans exported twice; each was used once";
const NUMBERED: &str = "messages numbered in the order of their starts";
const ORPHANS: &str =
    "client spans skipped, because no message is above them (its span may not be in the file)";
const BACKWARDS: &str = "messages skipped, because one of their spans ends before it begins";
const ENDLESS: &str = "spans that have not ended, read as unfinished";
const AT_ONCE: &str = "failed client spans that ended with their message and before their deadline, read as failures of the cloud";

/// Reads events from spans.
pub(super) struct SpanReader<'a, 'm> {
    pub(super) options: &'a SpanOptions,
    pub(super) mapping: &'a mut Mapping<'m>,
    /// The note about a message that cannot be read; `None` if that is an error.
    pub(super) skipped: Option<&'static str>,
    pub(super) entries: Vec<Entry>,
    pub(super) has_ids: bool,
}

/// A message with its spans.
struct SpanMessage<'s> {
    number: u64,
    span: &'s SpanRecord,
    calls: Vec<SpanCall<'s>>,
}

/// The role of a span in its message.
#[derive(Clone, Copy)]
struct SpanCall<'s> {
    source: &'s str,
    role: SpanRole,
    span: &'s SpanRecord,
}

type SpansById<'s> = HashMap<&'s SpanId, &'s SpanRecord>;

/// The ancestor of a span.
enum Above {
    Message(usize),
    /// The client span of a call, which it is a part of.
    Call,
    Nothing,
}

impl SpanReader<'_, '_> {
    /// Reads the spans of all files: those of one message may stand in several.
    pub(super) fn read(&mut self, file: &Arc<str>, spans: &[SpanRecord]) -> Result<(), Problem> {
        for span in spans {
            self.mapping.names.add(&span.name);
            span.row.cells.iter().for_each(|(key, _)| self.mapping.names.add(key));
        }
        if spans.is_empty() {
            return Err(Problem::of_file(file, "the file has no complete span"));
        }
        self.options.refuse_mistyped(file, spans)?;
        let spans = self.unique(spans);
        let mut messages = self.messages(&spans);
        if messages.is_empty() {
            let all = listed("", spans.iter().map(|span| &*span.name));
            let message = format!(
                "no span is a message; name the spans that are messages with --span message=NAME; \
                 the file has {all}"
            );
            return Err(Problem::of_file(file, message));
        }
        self.calls(&spans, &mut messages);
        for message in &messages {
            let all = [message.span].into_iter().chain(message.calls.iter().map(|it| it.span));
            if let Some(wrong) = all.clone().find(|span| span.end != 0 && span.end < span.start) {
                let early = i128::from(wrong.start - wrong.end);
                let detail = || format!("by {}", in_words(early));
                self.mapping.notes.add(BACKWARDS, &wrong.row.place, detail);
                continue;
            }
            // An operator of fuseline ends its spans, or means it; a clean export has no other
            // without an end.
            for span in all.filter(|span| span.end == 0 && !is_own(span)) {
                self.mapping.notes.add(ENDLESS, &span.row.place, String::new);
            }
            match (self.message(message), self.skipped) {
                (Ok(entries), _) => self.entries.extend(entries),
                (Err(problem), Some(kind)) => {
                    let detail = || problem.without_remedy();
                    self.mapping.notes.add(kind, &problem.place, detail);
                }
                (Err(problem), None) => return Err(problem),
            }
        }
        self.entries.sort_by_key(|entry| entry.at);
        Ok(())
    }

    /// Keeps each span once: an exporter that tries again delivers some twice. A copy that has
    /// ended says more.
    fn unique<'s>(&mut self, spans: &'s [SpanRecord]) -> Vec<&'s SpanRecord> {
        let mut places: HashMap<&SpanId, usize> = HashMap::new();
        let mut unique: Vec<&SpanRecord> = Vec::new();
        for span in spans {
            if let Some(index) = places.get(&span.id) {
                self.mapping.notes.add(TWICE, &span.row.place, String::new);
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

    /// Returns the messages by their start; they are numbered if no id is named and none has one.
    fn messages<'s>(&mut self, spans: &[&'s SpanRecord]) -> Vec<SpanMessage<'s>> {
        let is_message = |span: &&&SpanRecord| self.options.role(span) == Some(SpanRole::Message);
        let mut found: Vec<&SpanRecord> = spans.iter().filter(is_message).copied().collect();
        found.sort_by_key(|span| span.start);
        let has_id = |span: &&SpanRecord| self.options.value(span, "t").is_some();
        self.has_ids = self.options.names("t") || found.iter().any(has_id);
        for span in found.iter().filter(|_| !self.has_ids) {
            let remedy = || "if they have ids, name the attribute with --attribute t=NAME";
            self.mapping.notes.add_with(NUMBERED, &span.row.place, String::new, remedy);
        }
        let message = |(number, span)| SpanMessage { number, span, calls: Vec::new() };
        (0..).zip(found).map(message).collect()
    }

    /// Gives messages their requests and local's computations.
    fn calls<'s>(&mut self, spans: &[&'s SpanRecord], messages: &mut [SpanMessage<'s>]) {
        let by_id: SpansById<'_> = spans.iter().map(|span| (&span.id, *span)).collect();
        let places: HashMap<&SpanId, usize> =
            messages.iter().enumerate().map(|(place, message)| (&message.span.id, place)).collect();
        for span in spans {
            let role = match self.options.role(span) {
                Some(role @ (SpanRole::Request | SpanRole::Local)) => role,
                Some(SpanRole::Message) | None => continue,
            };
            let source = match role {
                SpanRole::Local => "local",
                _ => self.options.value(span, "p").unwrap_or(&span.name),
            };
            match self.message_above(span, &by_id, &places) {
                Above::Message(message) => {
                    messages[message].calls.push(SpanCall { source, role, span });
                }
                Above::Call => {}
                Above::Nothing => self.mapping.notes.add(ORPHANS, &span.row.place, String::new),
            }
        }
    }

    /// Returns the message above a span, or above the attempt that it links to.
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
            // Spans below a client span belong to its own call.
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

    /// Returns a message's open, its end, and its calls.
    fn message(&mut self, message: &SpanMessage<'_>) -> Result<Vec<Entry>, Problem> {
        let SpanMessage { span, calls, .. } = message;
        let mut entries = vec![self.event("open", message, span, span.start, None)?];
        let latency = self.options.value(span, "latency");
        let is_open = span.end == 0 || span.row.cell("fuseline.ended").is_some();
        let latency = latency.map(|text| {
            let view = self.options.view("emit", None);
            self.mapping.time(&span.row, &view, "latency", text, duration)
        });
        let is_sent = self.options.value(span, "by").is_some() || !span.has_failed;
        if !is_open || latency.is_some() {
            let end = if is_sent { "emit" } else { "miss" };
            let mut end = self.event(end, message, span, span.end, None)?;
            if let Some(latency) = latency.transpose()? {
                end.at = i128::from(span.start) + latency;
            }
            entries.push(end);
        }
        let mut attempts: BTreeMap<u64, Vec<&SpanCall<'_>>> = BTreeMap::new();
        for call in calls {
            let p = self.mapping.sources.priority(call.source);
            let wrong =
                |why| Problem::at(&call.span.row.place, format!("{:?} is {why}", call.source));
            attempts.entry(p.map_err(wrong)?).or_default().push(call);
        }
        for mut calls in attempts.into_values() {
            calls.sort_by_key(|call| call.span.start);
            let is_one = calls.len() == 1;
            for (attempt, call) in calls.into_iter().enumerate() {
                let attempt = (!is_one && call.role == SpanRole::Request).then_some(attempt);
                entries.extend(self.call(message, *call, attempt)?);
            }
        }
        Ok(entries)
    }

    /// Returns a call's request, and its result or failure; `attempt` is which of several attempts
    /// it is.
    fn call(
        &mut self,
        message: &SpanMessage<'_>,
        call: SpanCall<'_>,
        attempt: Option<usize>,
    ) -> Result<Vec<Entry>, Problem> {
        let SpanCall { source, role, span } = call;
        let mut span = span.clone();
        if let Some(attempt) = attempt.filter(|_| self.options.value(&span, "try").is_none()) {
            span.row.cells.insert(0, ((*self.options.name("try")).into(), attempt.to_string()));
        }
        let mut entries = Vec::new();
        if role == SpanRole::Request {
            entries.push(self.event("request", message, &span, span.start, Some(source))?);
        }
        if span.end != 0 && !self.options.was_ended_by_caller(&span) {
            let end = if span.has_failed { "fail" } else { "result" };
            if span.has_failed {
                self.note_at_once(message, &span, entries.first().and_then(|request| request.due));
            }
            let mut end = self.event(end, message, &span, span.end, Some(source))?;
            if role == SpanRole::Local {
                end.more.clear();
            }
            entries.push(end);
        }
        Ok(entries)
    }

    /// Returns an event of a span; its values are the span's attributes, and the message's id.
    fn event(
        &mut self,
        ev: &'static str,
        message: &SpanMessage<'_>,
        span: &SpanRecord,
        at: u64,
        source: Option<&str>,
    ) -> Result<Entry, Problem> {
        let mut row = span.row.clone();
        row.log_time = Some(at);
        let name = self.options.name("t");
        row.cells.retain(|(known, _)| **known != *name);
        let id = self.options.value(message.span, "t").map(str::to_owned);
        let id = id.or_else(|| (!self.has_ids).then(|| message.number.to_string()));
        row.cells.extend(id.map(|id| ((*name).into(), id)));
        let view = self.options.view(ev, source);
        let entry = self.mapping.entry(&row, message.number, &view)?;
        entry.ok_or_else(|| Problem::at(&row.place, "it is not an event"))
    }

    /// Notes a call that failed as its message ended: the caller may have ended it.
    fn note_at_once(&mut self, message: &SpanMessage<'_>, span: &SpanRecord, due: Option<i128>) {
        let apart = i128::from(message.span.end) - i128::from(span.end);
        let is_early = due.is_some_and(|due| i128::from(span.end) < due);
        // An operator of fuseline says so itself.
        let is_at_once = is_early && (0..=CLOCK_STEP).contains(&apart);
        if !is_at_once || has_status_code(span) || is_own(span) {
            return;
        }
        let error = span.row.cells.iter().find(|(key, _)| **key == *"error.type");
        let remedy = error
            .or(span.row.cells.first())
            .map_or_else(|| "ATTRIBUTE=VALUE".to_owned(), |(key, value)| format!("{key}={value}"));
        let remedy = || format!("if the caller ended them, give --cancelled {remedy}");
        self.mapping.notes.add_with(AT_ONCE, &span.row.place, String::new, remedy);
    }
}

/// Returns `true` if a span is of an operator of fuseline.
fn is_own(span: &SpanRecord) -> bool {
    span.row.cells.iter().any(|(key, _)| key.starts_with("fuseline."))
}
