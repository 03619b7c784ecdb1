//! What a recorded message's bytes say: JSON, CDR by the ROS 2 definition beside it, or Protobuf by its descriptors.

mod cdr;
#[cfg(feature = "bags")]
mod protobuf;
mod ros_msg;

use std::borrow::Cow;

use fuseline_traces::packed::PayloadFormat;
use fuseline_traces::rows::{Columns, field_event, json_event};

use crate::convert::payload::cdr::{CdrLayout, MessageFields};
use crate::convert::recorded::AnnotatedEvent;

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

    /// A message's event; none if it is to be left out.
    ///
    /// # Errors
    /// If the message is not of its type, or is no event.
    pub(super) fn event(
        &self,
        data: &[u8],
        log_time: u64,
        columns: &Columns<'_>,
    ) -> Result<Option<AnnotatedEvent>, String> {
        match self {
            Self::Json => json_event(data, log_time, columns),
            Self::Cdr(layout) => {
                let fields = layout.read(data).map_err(|error| error.to_string())?;
                field_event(&|name| text_of(&fields, name), log_time, columns)
            }
            #[cfg(feature = "bags")]
            Self::Protobuf(message) => {
                let message = message.decode(data)?;
                let field = |name: &str| protobuf::text(&message, name).map(Cow::Owned);
                field_event(&field, log_time, columns)
            }
        }
    }
}

fn text_of<'f>(fields: &'f MessageFields, name: &str) -> Option<Cow<'f, str>> {
    let (_, text) = fields.iter().find(|(path, _)| path == name)?;
    Some(Cow::Borrowed(text))
}
