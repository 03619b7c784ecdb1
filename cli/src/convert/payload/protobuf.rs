//! Messages in Protobuf, by the descriptors that a recording has.

use prost_reflect::{
    DescriptorPool, DynamicMessage, Kind, MessageDescriptor, ReflectMessage, Value,
};

use crate::convert::json::seconds;

/// How deep messages within messages are read.
const DEPTH: usize = 16;

/// A type of messages.
#[derive(Debug)]
pub(in crate::convert) struct MessageType(MessageDescriptor);

impl MessageType {
    /// The type of this name among the descriptors, a `FileDescriptorSet`.
    ///
    /// # Errors
    /// If they are none, or lack the type.
    pub(super) fn new(name: &str, descriptors: &[u8]) -> Result<Self, String> {
        let pool = DescriptorPool::decode(descriptors).map_err(|error| error.to_string())?;
        let found = pool.get_message_by_name(name);
        found.map(Self).ok_or_else(|| "the descriptors lack it".to_owned())
    }

    /// # Errors
    /// If the bytes are no such message.
    pub(super) fn decode(&self, data: &[u8]) -> Result<DynamicMessage, String> {
        DynamicMessage::decode(self.0.clone(), data).map_err(|error| error.to_string())
    }
}

/// The values of a message by their paths, such as `header.stamp`; lists, maps and bytes have none.
pub(super) fn fields(message: &DynamicMessage) -> Vec<(String, String)> {
    let mut fields = Vec::new();
    gather("", message, 0, &mut fields);
    fields
}

fn gather(outer: &str, message: &DynamicMessage, depth: usize, fields: &mut Vec<(String, String)>) {
    for field in message.descriptor().fields() {
        if depth == DEPTH || field.supports_presence() && !message.has_field(&field) {
            continue;
        }
        let name = field.name();
        let path = if outer.is_empty() { name.to_owned() } else { format!("{outer}.{name}") };
        let text = match &*message.get_field(&field) {
            Value::Message(inner) => {
                fields.extend(time(inner).map(|time| (path.clone(), time)));
                gather(&path, inner, depth + 1, fields);
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
            Value::EnumNumber(number) => match field.kind() {
                Kind::Enum(of) => of
                    .get_value(*number)
                    .map_or_else(|| number.to_string(), |value| value.name().to_owned()),
                _ => number.to_string(),
            },
        };
        if field.json_name() != name {
            let inner = field.json_name();
            let path = if outer.is_empty() { inner.to_owned() } else { format!("{outer}.{inner}") };
            fields.push((path, text.clone()));
        }
        fields.push((path, text));
    }
}

/// A `Timestamp` or `Duration`.
fn time(message: &DynamicMessage) -> Option<String> {
    let of = message.descriptor();
    if !matches!(of.full_name(), "google.protobuf.Timestamp" | "google.protobuf.Duration") {
        return None;
    }
    let whole = message.get_field_by_name("seconds")?.as_i64()?;
    let nanos = message.get_field_by_name("nanos")?.as_i32()?;
    Some(seconds(whole, u32::try_from(nanos).ok()?))
}
