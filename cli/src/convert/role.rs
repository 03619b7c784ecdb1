//! The user's names for spans: of messages, of local's computations, and of attributes.

use std::borrow::Cow;
use std::sync::Arc;

use crate::convert::key::word;
use crate::convert::mapping::{Named, View, ViewKind};
use crate::convert::notes::unknown;
use crate::convert::otlp::SpanRecord;
use crate::convert::row::Problem;
use crate::convert::time;

#[derive(clap::Args)]
#[command(next_help_heading = "Spans")]
pub(super) struct SpanOptions {
    /// The name of the spans that are messages, or local's computations; by default messages are
    /// spans without a parent, and there is no local [possible roles: message, local].
    #[arg(long, value_name = "ROLE=NAME", value_delimiter = ',', value_parser = role)]
    span: Vec<(SpanRole, String)>,
    /// The attribute of a span that has a key, such as t=frame.id; by default `t` is fuseline.t,
    /// and so on. A message has t, within, by (the source of its output), latency (ns from its
    /// start to its output, if the span ends at another time) and deadline (local's). A request has
    /// p, deadline, of, for and try.
    #[arg(long, value_name = "KEY=NAME", value_delimiter = ',', value_parser = attribute)]
    attribute: Vec<(&'static str, String)>,
    /// The attribute and value of a call that the client itself ended, such as
    /// error.type=CANCELLED, which is not a failure of the cloud. Calls with gRPC's codes 1 and 4
    /// need no option.
    #[arg(long, value_name = "ATTRIBUTE=VALUE", value_delimiter = ',', value_parser = cancelled)]
    cancelled: Vec<(String, String)>,
}

/// The role of a span.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum SpanRole {
    Message,
    Local,
    Request,
}

/// The attributes; where nobody says another name, it is `fuseline.` and the key.
const KEYS: [&str; 9] = ["t", "within", "by", "latency", "p", "deadline", "of", "for", "try"];
/// The attributes of a call's status: the stable one, and the older ones of gRPC and Connect.
const STATUS_CODES: [&str; 4] = [
    "rpc.status_code",
    "rpc.response.status_code",
    "rpc.grpc.status_code",
    "rpc.connect_rpc.error_code",
];
/// Codes that say that the caller ended the call: it cancelled it, or its own deadline was over.
const ENDED: [&str; 5] = ["1", "4", "cancelled", "canceled", "deadline_exceeded"];

impl SpanOptions {
    /// Returns the role of a span by its name and kind, or `None`.
    pub(super) fn role(&self, span: &SpanRecord) -> Option<SpanRole> {
        if let Some((role, _)) = self.span.iter().find(|(_, name)| *name == span.name) {
            return Some(*role);
        }
        if self.value(span, "p").is_some_and(|p| time::number(p) == Ok(0)) {
            return Some(SpanRole::Local);
        }
        let is_named = self.span.iter().any(|(role, _)| *role == SpanRole::Message);
        match span {
            _ if !is_named && span.parent.is_none() => Some(SpanRole::Message),
            _ if span.is_client => Some(SpanRole::Request),
            _ => None,
        }
    }

    /// Returns `true` if an attribute of this key was named.
    pub(super) fn names(&self, key: &str) -> bool {
        self.attribute.iter().any(|(known, _)| *known == key)
    }

    /// Returns the name of an attribute.
    pub(super) fn name(&self, key: &str) -> Cow<'_, str> {
        let given = self.attribute.iter().find(|(known, _)| *known == key);
        given.map_or_else(|| format!("fuseline.{key}").into(), |(_, name)| name.into())
    }

    pub(super) fn value<'s>(&self, span: &'s SpanRecord, key: &str) -> Option<&'s str> {
        span.row.cell(&self.name(key)).filter(|text| !text.is_empty())
    }

    /// Returns the places of the values of a span's event.
    pub(super) fn view<'s>(&'s self, event: &'static str, source: Option<&'s str>) -> View<'s> {
        // The message names the source of an output, and the view names the source of a call.
        let keys = KEYS.iter().filter(|key| **key != "p");
        let named = keys.map(|key| Named {
            key: if *key == "by" { "p" } else { key },
            what: (*key).into(),
            name: self.name(key),
        });
        View {
            kind: ViewKind::Span,
            topic: None,
            event: Some(event),
            source,
            named: named.collect(),
        }
    }

    /// Returns `true` if an attribute or a span of this name is read.
    pub(super) fn uses(&self, name: &str) -> bool {
        self.attribute.iter().any(|(_, named)| named == name)
            || self.span.iter().any(|(_, named)| named == name)
            || self.cancelled.iter().any(|(named, _)| named == name)
            || name.starts_with("fuseline.")
    }

    /// Returns `true` if the caller ended the call: it cancelled it, its own deadline was over, or
    /// an attribute has the value that says so.
    pub(super) fn was_ended_by_caller(&self, span: &SpanRecord) -> bool {
        let is_code = |code: &str| ENDED.contains(&&*code.to_lowercase());
        let is_named =
            |(name, value): &(String, String)| span.row.cell(name) == Some(value.as_str());
        span.row.cell("fuseline.ended").is_some()
            || STATUS_CODES.iter().any(|key| span.row.cell(key).is_some_and(is_code))
            || self.cancelled.iter().any(is_named)
    }

    /// Refuses a name that was given and occurs nowhere.
    pub(super) fn refuse_mistyped(
        &self,
        file: &Arc<str>,
        spans: &[SpanRecord],
    ) -> Result<(), Problem> {
        let attributes = || spans.iter().flat_map(|span| &span.row.cells);
        let keys = || attributes().map(|(key, _)| &**key);
        let fault = |message: String| Err(Problem::of_file(file, message));
        for (role, name) in &self.span {
            let role = if *role == SpanRole::Message { "message" } else { "local" };
            let mut names = spans.iter().map(|span| &*span.name);
            if !names.clone().any(|known| known == name) {
                return fault(unknown("span", name, &format!("--span {role}={name}"), &mut names));
            }
        }
        let named =
            self.attribute.iter().map(|(key, name)| (format!("--attribute {key}="), name, ""));
        let cancelled = self
            .cancelled
            .iter()
            .map(|(name, value)| (format!("--cancelled {name}={value}"), name, value.as_str()));
        for (option, name, value) in named.chain(cancelled) {
            let values = attributes().filter(|(key, _)| **key == **name).map(|(_, text)| &**text);
            let option = if value.is_empty() { option + name } else { option };
            if values.clone().next().is_none() {
                return fault(unknown("attribute", name, &option, keys()));
            }
            if !value.is_empty() && !values.clone().any(|known| known == value) {
                let noun = format!("attribute {name:?} with the value");
                return fault(unknown(&noun, value, &option, values));
            }
        }
        Ok(())
    }
}

/// Returns `true` if a span says how its call ended.
pub(super) fn has_status_code(span: &SpanRecord) -> bool {
    STATUS_CODES.iter().any(|key| span.row.cell(key).is_some())
}

fn role(text: &str) -> Result<(SpanRole, String), &'static str> {
    match text.split_once('=') {
        Some(("message", name)) => Ok((SpanRole::Message, name.to_owned())),
        Some(("local", name)) => Ok((SpanRole::Local, name.to_owned())),
        _ => Err("it must be message=NAME or local=NAME"),
    }
}

fn attribute(text: &str) -> Result<(&'static str, String), String> {
    let (key, name) = text.split_once('=').ok_or("write KEY=NAME, such as t=frame.id")?;
    Ok((word("key ", key, &KEYS)?, name.to_owned()))
}

fn cancelled(text: &str) -> Result<(String, String), &'static str> {
    let split = text.split_once('=').filter(|(name, _)| !name.is_empty());
    let (name, value) = split.ok_or("it must be ATTRIBUTE=VALUE, such as error.type=CANCELLED")?;
    Ok((name.to_owned(), value.to_owned()))
}
