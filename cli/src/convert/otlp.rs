//! OpenTelemetry's spans as OTLP JSON: what `convert` reads of them. What they mean is in `spans`.

use std::collections::BTreeMap;
use std::io::Read;

use serde::{Deserialize, Deserializer};

use crate::convert::recorded::ConvertError;

/// A span as far as it matters here.
#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct SpanRecord {
    pub(super) span_id: String,
    #[serde(default)]
    pub(super) parent_span_id: String,
    pub(super) name: String,
    #[serde(default, rename = "kind", deserialize_with = "is_client")]
    pub(super) is_client: bool,
    #[serde(deserialize_with = "nanoseconds")]
    pub(super) start_time_unix_nano: u64,
    /// 0 of a span that has not ended.
    #[serde(default, deserialize_with = "nanoseconds")]
    pub(super) end_time_unix_nano: u64,
    #[serde(default, deserialize_with = "attributes")]
    pub(super) attributes: BTreeMap<String, AttributeValue>,
    #[serde(default)]
    pub(super) links: Vec<SpanLink>,
    #[serde(default)]
    status: SpanStatus,
}

/// A number or a text; other values have no meaning here.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum AttributeValue {
    Number(u64),
    Text(String),
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
pub(super) struct SpanLink {
    pub(super) span_id: String,
}

#[derive(Deserialize, Default, Debug)]
struct SpanStatus {
    #[serde(default)]
    code: NumberOrText,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
struct OtlpExport {
    resource_spans: Vec<OtlpResource>,
}

#[derive(Deserialize, Debug)]
#[serde(rename_all = "camelCase")]
struct OtlpResource {
    #[serde(default)]
    scope_spans: Vec<OtlpScope>,
}

#[derive(Deserialize, Debug)]
struct OtlpScope {
    #[serde(default)]
    spans: Vec<SpanRecord>,
}

#[derive(Deserialize, Debug)]
#[serde(untagged)]
enum NumberOrText {
    Number(u64),
    Text(String),
}

/// Where RPC clients put the status of a call: the stable attribute, and the older ones of gRPC and Connect.
const STATUS_CODES: [&str; 4] = [
    "rpc.status_code",
    "rpc.response.status_code",
    "rpc.grpc.status_code",
    "rpc.connect_rpc.error_code",
];

/// All spans of a file, which is one export or several, one after the other.
pub(super) fn read(file: &str, inner: impl Read) -> Result<Vec<SpanRecord>, ConvertError> {
    let exports = serde_json::Deserializer::from_reader(inner).into_iter::<OtlpExport>();
    let mut spans = Vec::new();
    for export in exports {
        let fault =
            |error| ConvertError::File { file: file.to_owned(), message: format!("{error}") };
        let resources = export.map_err(fault)?.resource_spans;
        let scopes = resources.into_iter().flat_map(|resource| resource.scope_spans);
        spans.extend(scopes.flat_map(|scope| scope.spans));
    }
    Ok(spans)
}

/// Whether a file's first bytes are an export's.
pub(super) fn is_export(start: &[u8]) -> bool {
    let mut text = start.iter().copied().filter(|byte| !byte.is_ascii_whitespace());
    br#"{"resourceSpans":"#.iter().all(|byte| text.next() == Some(*byte))
}

impl SpanRecord {
    /// Whether its status is an error.
    pub(super) fn has_failed(&self) -> bool {
        match &self.status.code {
            NumberOrText::Number(code) => *code == 2,
            NumberOrText::Text(code) => code == "STATUS_CODE_ERROR",
        }
    }

    /// Whether the caller ended the call: it cancelled it, or its own deadline was over.
    pub(super) fn was_ended_by_caller(&self) -> bool {
        if self.attributes.contains_key("fuseline.ended") {
            return true;
        }
        STATUS_CODES.iter().filter_map(|key| self.attributes.get(*key)).any(|code| match code {
            AttributeValue::Number(code) => matches!(code, 1 | 4),
            AttributeValue::Text(code) => {
                matches!(
                    &*code.to_lowercase(),
                    "1" | "4" | "cancelled" | "canceled" | "deadline_exceeded"
                )
            }
        })
    }
}

impl Default for NumberOrText {
    fn default() -> Self {
        Self::Number(0)
    }
}

fn nanoseconds<'de, D: Deserializer<'de>>(source: D) -> Result<u64, D::Error> {
    match NumberOrText::deserialize(source)? {
        NumberOrText::Number(at) => Ok(at),
        NumberOrText::Text(at) => {
            at.parse().map_err(|_| serde::de::Error::custom(format!("{at:?} is no instant")))
        }
    }
}

fn is_client<'de, D: Deserializer<'de>>(source: D) -> Result<bool, D::Error> {
    Ok(match NumberOrText::deserialize(source)? {
        NumberOrText::Number(kind) => kind == 3,
        NumberOrText::Text(kind) => kind == "SPAN_KIND_CLIENT",
    })
}

fn attributes<'de, D: Deserializer<'de>>(
    source: D,
) -> Result<BTreeMap<String, AttributeValue>, D::Error> {
    #[derive(Deserialize)]
    struct OtlpAttribute {
        key: String,
        #[serde(default)]
        value: serde_json::Map<String, serde_json::Value>,
    }
    let read = |OtlpAttribute { key, value }: OtlpAttribute| {
        let (kind, value) = value.into_iter().next()?;
        let value = match (kind.as_str(), value) {
            ("intValue", serde_json::Value::Number(number)) => {
                AttributeValue::Number(number.as_u64()?)
            }
            ("intValue", serde_json::Value::String(text)) => {
                AttributeValue::Number(text.parse().ok()?)
            }
            ("stringValue", serde_json::Value::String(text)) => AttributeValue::Text(text),
            _ => return None,
        };
        Some((key, value))
    };
    Ok(Vec::<OtlpAttribute>::deserialize(source)?.into_iter().filter_map(read).collect())
}
