//! OpenTelemetry's spans as OTLP JSON, in whatever wrapper. What they mean is in `spans`.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

use serde_json::{Map, Value};

use crate::convert::recorded::ConvertError;

/// A span as far as it matters here.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct SpanRecord {
    pub(super) file: Arc<str>,
    pub(super) id: SpanId,
    /// The parent, in the same trace.
    pub(super) parent: Option<SpanId>,
    pub(super) name: String,
    pub(super) is_client: bool,
    pub(super) start: u64,
    /// 0 of a span that has not ended.
    pub(super) end: u64,
    pub(super) attributes: BTreeMap<String, String>,
    pub(super) links: Vec<SpanId>,
    /// Whether its status is an error.
    pub(super) has_failed: bool,
}

/// The trace's id and the span's own.
pub(super) type SpanId = (String, String);

/// Where RPC clients put the status of a call: the stable attribute, and the older ones of gRPC and Connect.
const STATUS_CODES: [&str; 4] = [
    "rpc.status_code",
    "rpc.response.status_code",
    "rpc.grpc.status_code",
    "rpc.connect_rpc.error_code",
];
/// Codes that say that the caller ended the call: it cancelled it, or its own deadline was over.
const ENDED: [&str; 5] = ["1", "4", "cancelled", "canceled", "deadline_exceeded"];
/// Names that OTLP JSON begins with, in a wrapper or without, and no log of rows.
const WRAPPERS: [&str; 7] = [
    "resourceSpans",
    "resource_spans",
    "scopeSpans",
    "scope_spans",
    "instrumentationLibrarySpans",
    "startTimeUnixNano",
    "start_time_unix_nano",
];
/// Names that spans of Jaeger or Zipkin have together.
const OTHERS: [[&str; 2]; 2] = [["traceID", "operationName"], ["traceId", "localEndpoint"]];
/// How deep wrappers and values lie within each other.
const DEPTH: usize = 64;

/// All spans of a file, which is one export or several, one after the other.
pub(super) fn read(file: &Arc<str>, inner: impl Read) -> Result<Vec<SpanRecord>, ConvertError> {
    let exports = serde_json::Deserializer::from_reader(inner).into_iter::<Value>();
    let mut spans = Vec::new();
    for export in exports {
        let fault = |error: &serde_json::Error| {
            let remedy = if error.is_eof() {
                "; --truncated reads what stands before"
            } else {
                "; text that a logger wrote around it is taken off by grep -o '{.*}'"
            };
            ConvertError::file(file, &format!("no OTLP JSON: {error}{remedy}"))
        };
        let export = export.map_err(|error| fault(&error))?;
        gather(file, &export, 0, &mut spans)?;
        if spans.is_empty() && is_other(&export) {
            let message = "spans as Jaeger or Zipkin had them before OTLP; export them as OTLP JSON, such as by Jaeger's \
                           /api/v3";
            return Err(ConvertError::file(file, message));
        }
    }
    Ok(spans)
}

/// The same up to where the file is cut.
pub(super) fn read_truncated(
    file: &Arc<str>,
    inner: impl Read,
) -> Result<(Vec<SpanRecord>, bool), ConvertError> {
    let mut spans = Vec::new();
    for export in serde_json::Deserializer::from_reader(inner).into_iter::<Value>() {
        match export {
            Ok(export) => gather(file, &export, 0, &mut spans)?,
            Err(error) if error.is_eof() || error.is_io() => return Ok((spans, true)),
            Err(error) => {
                return Err(ConvertError::file(file, &format!("no OTLP JSON: {error}")));
            }
        }
    }
    Ok((spans, false))
}

/// Whether a file's first bytes are those of spans.
pub(super) fn is_export(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let is_named = |name: &str| text.contains(&format!("\"{name}\""));
    let is_batches = || text.replace(char::is_whitespace, "").starts_with("{\"batches\":[");
    let is_other = || OTHERS.iter().any(|names| names.iter().all(|name| is_named(name)));
    text.starts_with(['{', '['])
        && (WRAPPERS.iter().any(|name| is_named(name)) || is_other() || is_batches())
}

/// Takes the spans out of whatever they are wrapped in: what has a span's id and its begin is a span.
fn gather(
    file: &Arc<str>,
    value: &Value,
    depth: usize,
    spans: &mut Vec<SpanRecord>,
) -> Result<(), ConvertError> {
    if depth == DEPTH {
        return Ok(());
    }
    match value {
        Value::Array(values) => {
            for value in values {
                gather(file, value, depth + 1, spans)?;
            }
        }
        Value::Object(object) => {
            if field(object, "spanId", "span_id").is_some()
                && field(object, "name", "name").is_some()
            {
                let span = span(file, object);
                spans.push(span.map_err(|message| ConvertError::file(file, &message))?);
                return Ok(());
            }
            for value in object.values() {
                gather(file, value, depth + 1, spans)?;
            }
        }
        _ => {}
    }
    Ok(())
}

fn is_other(export: &Value) -> bool {
    let text = export.to_string();
    text.contains("\"operationName\"") || text.contains("\"localEndpoint\"")
}

/// A field by its name in JSON or in Protobuf; null is none.
fn field<'v>(object: &'v Map<String, Value>, name: &str, other: &str) -> Option<&'v Value> {
    object.get(name).or_else(|| object.get(other)).filter(|value| !value.is_null())
}

fn text(object: &Map<String, Value>, name: &str, other: &str) -> String {
    field(object, name, other).and_then(Value::as_str).unwrap_or_default().to_owned()
}

fn span(file: &Arc<str>, object: &Map<String, Value>) -> Result<SpanRecord, String> {
    let trace = text(object, "traceId", "trace_id");
    let (own, name) = (text(object, "spanId", "span_id"), text(object, "name", "name"));
    let instant = |key: &str, other: &str| {
        let Some(value) = field(object, key, other) else { return Ok(None) };
        let read = value.as_u64().or_else(|| value.as_str()?.parse().ok());
        let message = || {
            format!(
                "the span {name:?} with the id {own} has {key} {value}, which is no number of nanoseconds"
            )
        };
        read.map(Some).ok_or_else(message)
    };
    let start = instant("startTimeUnixNano", "start_time_unix_nano")?;
    let start = start.ok_or_else(|| {
        format!("missing field `startTimeUnixNano` of the span {name:?} with the id {own}")
    })?;
    let end = instant("endTimeUnixNano", "end_time_unix_nano")?.unwrap_or(0);
    let parent = text(object, "parentSpanId", "parent_span_id");
    let is_no_parent = parent.bytes().all(|byte| byte == b'0');
    let kind = object.get("kind");
    let is_client = kind.and_then(Value::as_u64) == Some(3)
        || kind.and_then(Value::as_str) == Some("SPAN_KIND_CLIENT");
    let code = object.get("status").and_then(|status| status.get("code"));
    let has_failed = code.and_then(Value::as_u64) == Some(2)
        || code.and_then(Value::as_str) == Some("STATUS_CODE_ERROR");
    let links = object.get("links").and_then(Value::as_array).into_iter().flatten();
    let link = |link: &Value| {
        let link = link.as_object()?;
        let of = text(link, "traceId", "trace_id");
        let of = if of.is_empty() { trace.clone() } else { of };
        Some((of, text(link, "spanId", "span_id")))
    };
    Ok(SpanRecord {
        file: Arc::clone(file),
        parent: (!is_no_parent).then(|| (trace.clone(), parent)),
        links: links.filter_map(link).collect(),
        id: (trace.clone(), own),
        name,
        is_client,
        start,
        end,
        attributes: attributes(object.get("attributes")),
        has_failed,
    })
}

/// Attributes whose values are texts, numbers or truths.
fn attributes(all: Option<&Value>) -> BTreeMap<String, String> {
    let read = |attribute: &Value| {
        let key = attribute.get("key")?.as_str()?.to_owned();
        let value = attribute.get("value")?.as_object()?.values().next()?;
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Number(_) | Value::Bool(_) => value.to_string(),
            _ => return None,
        };
        Some((key, text))
    };
    all.and_then(Value::as_array).into_iter().flatten().filter_map(read).collect()
}

impl SpanRecord {
    /// Whether the caller ended the call: it cancelled it, its own deadline was over, or one of these attributes has this value.
    pub(super) fn was_ended_by_caller(&self, cancelled: &[(String, String)]) -> bool {
        let is_code = |key: &&str| {
            let code = self.attributes.get(*key);
            code.is_some_and(|code| ENDED.contains(&&*code.to_lowercase()))
        };
        let is_named = |(key, value): &(String, String)| {
            self.attributes.get(key).is_some_and(|it| it == value)
        };
        self.attributes.contains_key("fuseline.ended")
            || STATUS_CODES.iter().any(is_code)
            || cancelled.iter().any(is_named)
    }

    /// Whether it says how its call ended.
    pub(super) fn has_status_code(&self) -> bool {
        STATUS_CODES.iter().any(|key| self.attributes.contains_key(*key))
    }

    /// What it is called in errors and notes.
    pub(super) fn called(&self) -> String {
        format!("the span {:?} with the id {}", self.name, self.id.1)
    }
}
