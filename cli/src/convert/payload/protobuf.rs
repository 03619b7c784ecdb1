//! Messages in Protobuf, by the descriptors that a recording has.

use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, ReflectMessage, Value};

use crate::convert::json::{joined, seconds};
use crate::convert::row::Cells;

/// Messages within messages are read to this depth.
const DEPTH: usize = 16;

/// Returns the type of this name among the descriptors, a `FileDescriptorSet`.
pub(super) fn message_type(name: &str, descriptors: &[u8]) -> Result<MessageDescriptor, String> {
    let pool = DescriptorPool::decode(descriptors).map_err(|error| error.to_string())?;
    pool.get_message_by_name(name)
        .ok_or_else(|| "the file's descriptors do not define it".to_owned())
}

/// Returns the values of a message by their paths, such as `header.stamp`; lists, maps and bytes
/// have none.
pub(super) fn cells(of: &MessageDescriptor, data: &[u8]) -> Result<Cells, String> {
    let message = DynamicMessage::decode(of.clone(), data).map_err(|error| error.to_string())?;
    let mut cells = Vec::new();
    gather("", &message, 0, &mut cells);
    Ok(cells)
}

fn gather(outer: &str, message: &DynamicMessage, depth: usize, cells: &mut Cells) {
    for field in message.descriptor().fields() {
        if depth == DEPTH || field.supports_presence() && !message.has_field(&field) {
            continue;
        }
        let path = joined(outer, field.name());
        let text = match &*message.get_field(&field) {
            Value::Message(inner) => {
                gather(&path, inner, depth + 1, cells);
                cells.extend(time(inner).map(|time| (path, time)));
                continue;
            }
            Value::Bytes(_) | Value::List(_) | Value::Map(_) => continue,
            Value::Bool(value) => value.to_string(),
            Value::I32(value) => value.to_string(),
            Value::I64(value) => value.to_string(),
            Value::U32(value) => value.to_string(),
            Value::U64(value) => value.to_string(),
            Value::F32(value) => value.to_string(),
            Value::F64(value) => value.to_string(),
            Value::String(value) => value.clone(),
            Value::EnumNumber(number) => {
                let kind = field.kind();
                let value = kind.as_enum().and_then(|of| of.get_value(*number));
                value.map_or_else(|| number.to_string(), |value| value.name().to_owned())
            }
        };
        if field.json_name() != field.name() {
            cells.push((joined(outer, field.json_name()), text.clone()));
        }
        cells.push((path, text));
    }
}

/// Reads a `Timestamp` or `Duration`. Returns `None` for any other message.
fn time(message: &DynamicMessage) -> Option<String> {
    let of = message.descriptor();
    if !matches!(of.full_name(), "google.protobuf.Timestamp" | "google.protobuf.Duration") {
        return None;
    }
    let whole = message.get_field_by_name("seconds")?.as_i64()?;
    let nanos = message.get_field_by_name("nanos")?.as_i32()?;
    Some(seconds(whole, u32::try_from(nanos).ok()?))
}
