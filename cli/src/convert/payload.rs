//! Decodes a recorded message: JSON, CDR by its ROS 2 definition, or Protobuf by its descriptors.

mod cdr;
mod protobuf;
mod ros_msg;
#[cfg(test)]
mod tests;

use fuseline_traces::packed::PayloadFormat;

use crate::convert::json;
use crate::convert::payload::cdr::CdrLayout;
use crate::convert::row::Cells;

/// Decodes the messages of a channel.
#[derive(Debug)]
pub(super) enum PayloadDecoder {
    Json,
    Cdr(CdrLayout),
    Protobuf(prost_reflect::MessageDescriptor),
}

impl PayloadDecoder {
    pub(super) fn of(format: &PayloadFormat) -> Result<Self, String> {
        let schema = format.schema.as_deref();
        let read = match (&*format.encoding, schema.map(|schema| (&*schema.encoding, schema))) {
            ("json", _) => Ok(Self::Json),
            ("cdr", Some(("ros2msg", schema))) => {
                let text = String::from_utf8_lossy(&schema.data);
                ros_msg::layout(&schema.name, &text).map(Self::Cdr)
            }
            ("protobuf", Some(("protobuf", schema))) => {
                protobuf::message_type(&schema.name, &schema.data).map(Self::Protobuf)
            }
            ("cdr" | "protobuf", None) => {
                return Err(format!(
                    "its encoding is {}, and the file has no schema for it",
                    format.encoding
                ));
            }
            (encoding, schema) => {
                let by =
                    schema.map_or_else(String::new, |(by, _)| format!(" with a schema in {by}"));
                return Err(format!(
                    "its encoding is {encoding}{by}; convert reads json, cdr with a schema in \
                     ros2msg, and protobuf"
                ));
            }
        };
        let name = schema.map_or("", |schema| &*schema.name);
        read.map_err(|why| format!("schema {name}: {why}"))
    }

    /// Returns a message's values by their paths, such as `header.stamp`.
    pub(super) fn cells(&self, data: &[u8]) -> Result<Cells, String> {
        match self {
            Self::Json => json::cells_of(data),
            Self::Cdr(layout) => layout.read(data).map_err(|error| error.to_string()),
            Self::Protobuf(message) => protobuf::cells(message, data),
        }
    }
}
