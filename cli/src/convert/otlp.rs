//! OpenTelemetry's spans as OTLP JSON, in whatever wrapper. What they mean is in `spans`.

use std::io::Read;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::Value;

use crate::convert::row::{Cells, Place, Problem, ProblemKind, Row, Spot};

/// A span as far as it matters here; its attributes are its row.
#[derive(Clone, Debug)]
pub(super) struct SpanRecord {
    pub(super) row: Row,
    pub(super) id: SpanId,
    /// The parent, in the same trace.
    pub(super) parent: Option<SpanId>,
    pub(super) name: String,
    pub(super) is_client: bool,
    pub(super) start: u64,
    /// 0 of a span that has not ended.
    pub(super) end: u64,
    pub(super) links: Vec<SpanId>,
    /// `true` if its status is an error.
    pub(super) has_failed: bool,
}

/// The trace's id and the span's own.
pub(super) type SpanId = (String, String);

/// A span as exporters write it: by the names of JSON or of Protobuf, with null for what is absent.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct ExportedSpan {
    #[serde(alias = "trace_id")]
    trace_id: Option<String>,
    #[serde(alias = "span_id")]
    span_id: Option<String>,
    #[serde(alias = "parent_span_id")]
    parent_span_id: Option<String>,
    name: Option<String>,
    kind: Value,
    #[serde(alias = "start_time_unix_nano")]
    start_time_unix_nano: Value,
    #[serde(alias = "end_time_unix_nano")]
    end_time_unix_nano: Value,
    attributes: Option<Vec<ExportedAttribute>>,
    links: Option<Vec<ExportedSpan>>,
    status: Option<ExportedStatus>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct ExportedStatus {
    code: Value,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct ExportedAttribute {
    key: String,
    value: Value,
}

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
/// Wrappers lie within each other at most to this depth.
const DEPTH: usize = 64;

/// The content of a file, span by span.
type ReadSpans = Vec<Result<SpanRecord, Problem>>;

/// Returns all spans of a file, which is one export or several, one after the other; the last
/// problem may be that it is cut.
pub(super) fn read(file: &Arc<str>, inner: impl Read) -> Result<ReadSpans, Problem> {
    let mut spans = Vec::new();
    for export in serde_json::Deserializer::from_reader(inner).into_iter::<Value>() {
        let export = match export {
            Ok(export) => export,
            Err(error) if error.is_eof() || error.is_io() => {
                let message = format!("not OTLP JSON: {error}");
                let place = Place::new(file, Spot::File);
                spans.push(Err(Problem::of_kind(ProblemKind::Cut, &place, message)));
                break;
            }
            Err(error) => {
                let remedy = "if a logger wrote text around it, remove that with grep -o '{.*}'";
                return Err(Problem::of_file(file, format!("not OTLP JSON: {error}; {remedy}")));
            }
        };
        gather(file, &export, 0, &mut spans);
        if spans.is_empty() && has_both(&export.to_string()) {
            let message = "the spans are in an older format of Jaeger or Zipkin; export them as \
                           OTLP JSON, for example with Jaeger's /api/v3";
            return Err(Problem::of_file(file, message));
        }
    }
    Ok(spans)
}

/// Returns `true` if a file's first text is that of spans.
pub(super) fn is_export(text: &str) -> bool {
    let is_batches = || text.replace(char::is_whitespace, "").starts_with("{\"batches\":[");
    text.starts_with(['{', '['])
        && (WRAPPERS.iter().any(|name| is_named(text, name)) || has_both(text) || is_batches())
}

fn is_named(text: &str, name: &str) -> bool {
    text.contains(&format!("\"{name}\""))
}

fn has_both(text: &str) -> bool {
    OTHERS.iter().any(|names| names.iter().all(|name| is_named(text, name)))
}

/// Takes the spans out of whatever they are wrapped in: what has a span's id and a name is a span.
fn gather(file: &Arc<str>, value: &Value, depth: usize, spans: &mut ReadSpans) {
    match value {
        _ if depth == DEPTH => {}
        Value::Array(values) => {
            for value in values {
                gather(file, value, depth + 1, spans);
            }
        }
        Value::Object(object) => {
            let has = |name: &str| object.get(name).is_some_and(|value| !value.is_null());
            if (has("spanId") || has("span_id")) && has("name") {
                spans.push(span(file, value));
                return;
            }
            for value in object.values() {
                gather(file, value, depth + 1, spans);
            }
        }
        _ => {}
    }
}

fn span(file: &Arc<str>, object: &Value) -> Result<SpanRecord, Problem> {
    let known = |key: &str| object.get(key).and_then(Value::as_str).unwrap_or_default();
    let id = if known("spanId").is_empty() { known("span_id") } else { known("spanId") };
    let spot = Spot::Span(format!("the span {:?} with the id {id}", known("name")).into());
    let place = Place::new(file, spot);
    let exported: ExportedSpan = Deserialize::deserialize(object)
        .map_err(|error: serde_json::Error| Problem::at(&place, error.to_string()))?;
    let instant = |key: &str, value: &Value| {
        let read = value.as_u64().or_else(|| value.as_str()?.parse().ok());
        let message = || format!("its {key} is {value}; it must be a whole number of nanoseconds");
        read.or(value.is_null().then_some(0)).ok_or_else(|| Problem::at(&place, message()))
    };
    let start = instant("startTimeUnixNano", &exported.start_time_unix_nano)?;
    if exported.start_time_unix_nano.is_null() {
        return Err(Problem::at(&place, "missing field `startTimeUnixNano`"));
    }
    let end = instant("endTimeUnixNano", &exported.end_time_unix_nano)?;
    let trace = exported.trace_id.unwrap_or_default();
    let parent = exported.parent_span_id.unwrap_or_default();
    let is_no_parent = parent.bytes().all(|byte| byte == b'0');
    let link = |link: ExportedSpan| {
        let of = link.trace_id.filter(|of| !of.is_empty()).unwrap_or_else(|| trace.clone());
        (of, link.span_id.unwrap_or_default())
    };
    let is = |value: &Value, code: u64, name: &str| {
        value.as_u64() == Some(code) || value.as_str() == Some(name)
    };
    let status = exported.status.unwrap_or_default();
    Ok(SpanRecord {
        parent: (!is_no_parent).then(|| (trace.clone(), parent)),
        links: exported.links.unwrap_or_default().into_iter().map(link).collect(),
        id: (trace.clone(), exported.span_id.unwrap_or_default()),
        name: exported.name.unwrap_or_default(),
        is_client: is(&exported.kind, 3, "SPAN_KIND_CLIENT"),
        start,
        end,
        has_failed: is(&status.code, 2, "STATUS_CODE_ERROR"),
        row: Row::new(place, attributes(exported.attributes.unwrap_or_default())),
    })
}

/// Attributes whose values are texts, numbers or truths.
fn attributes(all: Vec<ExportedAttribute>) -> Cells {
    let read = |ExportedAttribute { key, value }: ExportedAttribute| {
        let text = match value.as_object()?.values().next()? {
            Value::String(text) => text.clone(),
            value @ (Value::Number(_) | Value::Bool(_)) => value.to_string(),
            _ => return None,
        };
        Some((key.into(), text))
    };
    let mut cells: Cells = all.into_iter().filter_map(read).collect();
    cells.sort();
    cells
}
