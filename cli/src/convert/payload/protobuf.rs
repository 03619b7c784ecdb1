//! Messages in Protobuf, by the descriptors that a recording has.

use fuseline_traces::rows::seconds;
use prost_reflect::{
    DescriptorPool, DynamicMessage, Kind, MessageDescriptor, ReflectMessage, Value,
};

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

/// What stands for a path of fields, such as `header.stamp`; nothing for lists, maps and messages, but for times.
pub(super) fn text(message: &DynamicMessage, path: &str) -> Option<String> {
    let (name, rest) = match path.split_once('.') {
        Some((name, rest)) => (name, Some(rest)),
        None => (path, None),
    };
    let of = message.descriptor();
    let field = of.get_field_by_name(name).or_else(|| of.get_field_by_json_name(name))?;
    if field.supports_presence() && !message.has_field(&field) {
        return None;
    }
    Some(match (&*message.get_field(&field), rest) {
        (Value::Message(inner), Some(rest)) => return text(inner, rest),
        (Value::Message(inner), None) => return time(inner),
        (_, Some(_)) | (Value::Bytes(_) | Value::List(_) | Value::Map(_), None) => return None,
        (Value::Bool(value), _) => value.to_string(),
        (Value::I32(value), _) => value.to_string(),
        (Value::I64(value), _) => value.to_string(),
        (Value::U32(value), _) => value.to_string(),
        (Value::U64(value), _) => value.to_string(),
        (Value::F32(value), _) => value.to_string(),
        (Value::F64(value), _) => value.to_string(),
        (Value::String(value), _) => value.clone(),
        (Value::EnumNumber(number), _) => match field.kind() {
            Kind::Enum(of) => of
                .get_value(*number)
                .map_or_else(|| number.to_string(), |value| value.name().to_owned()),
            _ => number.to_string(),
        },
    })
}

/// A `Timestamp` or `Duration`.
fn time(message: &DynamicMessage) -> Option<String> {
    let of = message.descriptor();
    if !matches!(of.full_name(), "google.protobuf.Timestamp" | "google.protobuf.Duration") {
        return None;
    }
    let whole = message.get_field_by_name("seconds")?.as_i64()?;
    let nanos = message.get_field_by_name("nanos")?.as_i32()?;
    Some(seconds(u64::try_from(whole).ok()?, u32::try_from(nanos).ok()?))
}
