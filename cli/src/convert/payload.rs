//! What a recorded message's bytes say: JSON, CDR by the ROS 2 definition beside it, or Protobuf by its descriptors.

mod cdr;
#[cfg(feature = "bags")]
mod protobuf;
mod ros_msg;

use std::sync::Arc;

use fuseline_traces::packed::PayloadFormat;

use crate::convert::json;
use crate::convert::payload::cdr::CdrLayout;

/// How the messages of a channel are decoded.
#[derive(Debug)]
pub(super) enum PayloadDecoder {
    Json,
    Cdr(CdrLayout),
    #[cfg(feature = "bags")]
    Protobuf(protobuf::MessageType),
}

impl PayloadDecoder {
    /// # Errors
    /// If it is none of these, or its schema is missing or not understood.
    pub(super) fn of(format: &PayloadFormat) -> Result<Self, String> {
        let schema = format.schema.as_deref();
        match (&*format.encoding, schema.map(|schema| (&*schema.encoding, schema))) {
            ("json", _) => Ok(Self::Json),
            ("cdr", Some(("ros2msg", schema))) => {
                let text = String::from_utf8_lossy(&schema.data);
                let layout = ros_msg::layout(&schema.name, &text);
                layout.map(Self::Cdr).map_err(|why| format!("schema {}: {why}", schema.name))
            }
            #[cfg(feature = "bags")]
            ("protobuf", Some(("protobuf", schema))) => {
                let message = protobuf::MessageType::new(&schema.name, &schema.data);
                message.map(Self::Protobuf).map_err(|why| format!("schema {}: {why}", schema.name))
            }
            #[cfg(not(feature = "bags"))]
            ("protobuf", Some(_)) => {
                Err("it is Protobuf, which needs a fuseline built with --features bags".to_owned())
            }
            ("cdr" | "protobuf", None) => {
                Err(format!("it is {}, and the file has no schema of it", format.encoding))
            }
            (encoding, Some((schema, _))) => Err(format!(
                "it is {encoding} by a schema in {schema}; json, cdr by ros2msg and protobuf are read"
            )),
            (encoding, None) => Err(format!("it is {encoding}; json, cdr and protobuf are read")),
        }
    }

    /// A message's values by their paths, such as `header.stamp`.
    ///
    /// # Errors
    /// If the message is not of its type.
    pub(super) fn cells(&self, data: &[u8]) -> Result<Vec<(Arc<str>, String)>, String> {
        let fields = match self {
            Self::Json => return json::cells_of(data),
            Self::Cdr(layout) => layout.read(data).map_err(|error| error.to_string())?,
            #[cfg(feature = "bags")]
            Self::Protobuf(message) => protobuf::fields(&message.decode(data)?),
        };
        Ok(fields.into_iter().map(|(path, text)| (path.into(), text)).collect())
    }
}
