//! What spans are: the user's names for messages, local's computations and attributes.

use crate::convert::otlp::SpanRecord;
use crate::convert::recorded::ConvertError;
use crate::convert::value::{self, listed};

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
    /// The attribute and value by which a client says that it ended a call itself, such as error.type=CANCELLED: that is no
    /// failure of the cloud. The codes 1 and 4 of gRPC say so without it.
    #[arg(long, value_name = "ATTRIBUTE=VALUE", value_delimiter = ',', value_parser = cancelled)]
    cancelled: Vec<(String, String)>,
}

/// What a span is to an operator.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum SpanRole {
    Message,
    Local,
    Request,
}

const KEYS: [&str; 8] = ["t", "within", "by", "took", "p", "deadline", "of", "try"];

impl SpanOptions {
    /// The attributes and values by which a client says that it ended a call.
    pub(super) fn cancelled(&self) -> &[(String, String)] {
        &self.cancelled
    }

    /// What a span is by its name and kind; none is neither.
    pub(super) fn role(&self, span: &SpanRecord) -> Option<SpanRole> {
        if let Some((role, _)) = self.span.iter().find(|(_, name)| *name == span.name) {
            return Some(*role);
        }
        if self.value(span, "p").is_some_and(|p| value::number(p) == Ok(0)) {
            return Some(SpanRole::Local);
        }
        let is_named = self.span.iter().any(|(role, _)| *role == SpanRole::Message);
        match span {
            _ if !is_named && span.parent.is_none() => Some(SpanRole::Message),
            _ if span.is_client => Some(SpanRole::Request),
            _ => None,
        }
    }

    pub(super) fn name(&self, key: &str) -> Option<&str> {
        self.attribute.iter().find(|(known, _)| *known == key).map(|(_, name)| &**name)
    }

    /// Whether an attribute or a span of this name is read.
    pub(super) fn uses(&self, name: &str) -> bool {
        self.attribute.iter().any(|(_, named)| named == name)
            || self.span.iter().any(|(_, named)| named == name)
            || self.cancelled.iter().any(|(named, _)| named == name)
            || name.starts_with("fuseline.")
    }

    pub(super) fn value<'s>(&self, span: &'s SpanRecord, key: &str) -> Option<&'s str> {
        let text = match self.name(key) {
            Some(name) => span.attributes.get(name),
            None => span.attributes.get(&format!("fuseline.{key}")),
        };
        text.map(|text| &**text).filter(|text| !text.is_empty())
    }

    /// Refuses a name that was given and occurs nowhere.
    pub(super) fn refuse_mistyped(
        &self,
        file: &str,
        spans: &[SpanRecord],
    ) -> Result<(), ConvertError> {
        if spans.is_empty() {
            return Ok(());
        }
        let has_span = |name: &str| spans.iter().any(|span| span.name == name);
        let has_attribute =
            |name: &str| spans.iter().any(|span| span.attributes.contains_key(name));
        let fault = |option: String, name: &str, what: &str, all: Vec<&str>| {
            let mut all = all;
            all.sort_unstable();
            all.dedup();
            let all = listed(name, all.into_iter());
            let message =
                format!("no {what} {name:?} in the file, which {option} names; it has {all}");
            Err(ConvertError::file(file, &message))
        };
        let names = || spans.iter().map(|span| &*span.name).collect();
        let attributes = || {
            let all = spans.iter().flat_map(|span| span.attributes.keys());
            all.map(|name| &**name).collect::<Vec<&str>>()
        };
        for (role, name) in &self.span {
            let role = if *role == SpanRole::Message { "message" } else { "local" };
            if !has_span(name) {
                return fault(format!("--span {role}={name}"), name, "span", names());
            }
        }
        for (key, name) in &self.attribute {
            if !has_attribute(name) {
                return fault(format!("--attribute {key}={name}"), name, "attribute", attributes());
            }
        }
        for (name, value) in &self.cancelled {
            if !has_attribute(name) {
                let option = format!("--cancelled {name}={value}");
                return fault(option, name, "attribute", attributes());
            }
        }
        Ok(())
    }
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

fn cancelled(text: &str) -> Result<(String, String), &'static str> {
    let split = text.split_once('=').filter(|(name, _)| !name.is_empty());
    let (name, value) = split.ok_or("it must be ATTRIBUTE=VALUE, such as error.type=CANCELLED")?;
    Ok((name.to_owned(), value.to_owned()))
}
