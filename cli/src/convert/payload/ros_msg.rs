//! ROS 2 message definitions, as recordings have them: a type, then those that it needs, behind
//! lines of `=`.

use std::collections::BTreeMap;

use super::cdr::{CdrField, CdrLayout, CdrType, FieldKind, FieldShape};

/// A definition that is used by most and may be missing.
const TIME: [&str; 2] = ["int32 sec", "uint32 nanosec"];
const TIMES: [&str; 2] = ["builtin_interfaces/Time", "builtin_interfaces/Duration"];

/// The beginning of a service's event, for any service; recordings have only the service's own
/// definition.
const SERVICE_EVENT: &str = "\
service_msgs/ServiceEventInfo info
========
MSG: service_msgs/ServiceEventInfo
uint8 event_type
builtin_interfaces/Time stamp
char[16] client_gid
int64 sequence_number
";

/// Returns the layout of the type's messages in CDR.
pub(super) fn layout(name: &str, text: &str) -> Result<CdrLayout, String> {
    let is_service = text.is_empty() || text.lines().any(|line| line.trim() == "---");
    let text = if name.ends_with("_Event") && is_service { SERVICE_EVENT } else { text };
    let mut definitions = vec![(short(name), Vec::new())];
    for line in text.lines().map(str::trim) {
        if line.len() >= 8 && line.bytes().all(|byte| byte == b'=') {
            definitions.push((String::new(), Vec::new()));
        } else if let Some((name, own)) = definitions.last_mut() {
            match line.strip_prefix("MSG: ") {
                Some(named) if name.is_empty() => *name = short(named),
                _ => own.push(line),
            }
        }
    }
    definitions.extend(TIMES.map(|time| (time.to_owned(), TIME.to_vec())));
    let mut places = BTreeMap::new();
    for (place, (name, _)) in definitions.iter().enumerate() {
        places.entry(name.clone()).or_insert(place);
    }
    let types = definitions.iter().map(|(name, lines)| type_of(name, lines, &places));
    Ok(CdrLayout { types: types.collect::<Result<_, _>>()? })
}

/// Returns `package/Type`, without the folder between them.
fn short(name: &str) -> String {
    name.trim().replacen("/msg/", "/", 1)
}

fn type_of(
    name: &str,
    lines: &[&str],
    places: &BTreeMap<String, usize>,
) -> Result<CdrType, String> {
    let package = name.split_once('/').map_or("", |(package, _)| package);
    let mut fields = Vec::new();
    for line in lines.iter().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        let no_field = || format!("{name} has a line {line:?}, which is not a field");
        let (kind, rest) = line.split_once(char::is_whitespace).ok_or_else(no_field)?;
        let rest = rest.trim_start();
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        let (field, rest) = rest.split_at(end);
        // A constant is not in the message, and neither is a default.
        if rest.trim_start().starts_with('=') {
            continue;
        }
        let (kind, shape) = shape_of(kind);
        let shape = shape.ok_or_else(no_field)?;
        let kind = kind_of(kind, package, places).ok_or_else(|| {
            format!("{name} has a field of type {kind:?}, which the schema does not define")
        })?;
        fields.push(CdrField { name: field.to_owned(), kind, shape });
    }
    Ok(CdrType { fields, is_time: TIMES.contains(&name) })
}

/// Reads `int32`, `int32[3]`, `int32[]` or `int32[<=3]`.
fn shape_of(kind: &str) -> (&str, Option<FieldShape>) {
    let Some((kind, len)) = kind.split_once('[') else { return (kind, Some(FieldShape::One)) };
    let shape = match len.strip_suffix(']') {
        Some(len) if len.is_empty() || len.starts_with("<=") => Some(FieldShape::Sequence),
        Some(len) => len.parse().ok().map(FieldShape::Array),
        None => None,
    };
    (kind, shape)
}

fn kind_of(kind: &str, package: &str, places: &BTreeMap<String, usize>) -> Option<FieldKind> {
    Some(match kind {
        "bool" => FieldKind::Bool,
        "byte" | "char" | "uint8" => FieldKind::Unsigned(1),
        "uint16" => FieldKind::Unsigned(2),
        "uint32" => FieldKind::Unsigned(4),
        "uint64" => FieldKind::Unsigned(8),
        "int8" => FieldKind::Signed(1),
        "int16" => FieldKind::Signed(2),
        "int32" => FieldKind::Signed(4),
        "int64" => FieldKind::Signed(8),
        "float32" => FieldKind::Float(4),
        "float64" => FieldKind::Float(8),
        _ if kind == "string" || kind.starts_with("string<=") => FieldKind::Text,
        _ => {
            let full = match kind {
                "Header" => "std_msgs/Header".to_owned(),
                _ if kind.contains('/') => short(kind),
                _ => format!("{package}/{kind}"),
            };
            FieldKind::Message(*places.get(&full)?)
        }
    })
}
