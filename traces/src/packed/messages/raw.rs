//! [`RawMessages`]: the messages of some topics of an MCAP file as they are, with what they are encoded in.
//!
//! The library takes memory for whatever length a file claims, so lengths are checked here first.

use std::collections::BTreeMap;
use std::io::Read;
use std::rc::Rc;

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::MessageError;
use super::chunks::ChunkScanner;

/// The longest record, in bytes: an image of 4K and four channels fits. What a record in a packed chunk claims to hold takes
/// memory before the first byte of it came, and up to three times as much while a buffer grows. All schemas together
/// may take as much.
pub const RECORD: usize = 40 << 20;
/// How much is read at once, in bytes: what a record claims to hold takes memory as it comes.
const PIECE: usize = 64 << 10;

/// A message as it was recorded.
#[derive(Clone, Debug)]
pub struct RawMessage {
    /// Which of the topics it is of.
    pub topic: usize,
    /// When it was recorded, in nanoseconds.
    pub log_time: u64,
    /// What its bytes are.
    pub format: Rc<PayloadFormat>,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// What the bytes of a channel's messages are.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PayloadFormat {
    /// Such as `json`, `cdr` or `protobuf`.
    pub encoding: String,
    /// What describes them; none if the file has none before the channel.
    pub schema: Option<Rc<PayloadSchema>>,
}

/// A schema of a file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PayloadSchema {
    /// The type's name, such as `std_msgs/msg/Header`.
    pub name: String,
    /// Such as `ros2msg` or `protobuf`.
    pub encoding: String,
    /// The definition.
    pub data: Vec<u8>,
}

/// The messages of some topics of an MCAP file, in the order of the file.
///
/// After an error it yields nothing more.
pub struct RawMessages<'a, R> {
    inner: R,
    reader: LinearReader,
    chunks: ChunkScanner,
    topics: Vec<&'a str>,
    schemas: BTreeMap<u16, Rc<PayloadSchema>>,
    /// How many bytes the schemas have.
    schemas_len: usize,
    channels: BTreeMap<u16, (usize, Rc<PayloadFormat>)>,
}

impl<'a, R: Read> RawMessages<'a, R> {
    /// Reads the messages of these topics; nothing is read yet.
    pub fn new(inner: R, topics: Vec<&'a str>) -> Self {
        let options = LinearReaderOptions::default()
            .with_record_length_limit(RECORD)
            .with_validate_chunk_crcs(true);
        let reader = LinearReader::new_with_options(options);
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        let chunks = ChunkScanner::new();
        Self { inner, reader, chunks, topics, schemas, schemas_len: 0, channels }
    }

    /// The next message of the topics; none at the end.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn message(&mut self) -> Result<Option<RawMessage>, MessageError> {
        loop {
            let (data, opcode) = match self.reader.next_event().transpose()? {
                None => return Ok(None),
                Some(LinearReadEvent::ReadRequest(wanted)) => {
                    let room = self.reader.insert(wanted.min(PIECE));
                    let read = self.inner.read(room)?;
                    self.chunks.look(&room[..read]).map_err(|_| McapError::UnexpectedEoc)?;
                    self.reader.notify_read(read);
                    continue;
                }
                Some(LinearReadEvent::Record { data, opcode }) => (data, opcode),
            };
            match opcode {
                op::SCHEMA => {
                    let room = RECORD - self.schemas_len;
                    if let Some((id, schema)) = schema_of(data, room) {
                        self.schemas_len += schema.data.len();
                        self.schemas.insert(id, Rc::new(schema));
                    }
                    continue;
                }
                op::CHANNEL if !is_whole_channel(data) => {
                    return Err(McapError::UnexpectedEof.into());
                }
                op::CHANNEL | op::MESSAGE => {}
                // Others are not read, since the library takes the memory that a text in them
                // claims to need.
                _ => continue,
            }
            match mcap::parse_record(opcode, data)? {
                Record::Channel(channel) => {
                    let topic = self.topics.iter().position(|topic| *topic == channel.topic);
                    if let Some(topic) = topic {
                        let schema = self.schemas.get(&channel.schema_id).cloned();
                        let format = PayloadFormat { encoding: channel.message_encoding, schema };
                        self.channels.insert(channel.id, (topic, Rc::new(format)));
                    }
                }
                Record::Message { header, data } => {
                    if let Some((topic, format)) = self.channels.get(&header.channel_id) {
                        let (topic, format) = (*topic, Rc::clone(format));
                        let (data, log_time) = (data.into_owned(), header.log_time);
                        return Ok(Some(RawMessage { topic, log_time, format, data }));
                    }
                }
                _ => {}
            }
        }
    }
}

/// A schema and its number; none if it is not whole, or its definition is longer than `room`.
fn schema_of(record: &[u8], room: usize) -> Option<(u16, PayloadSchema)> {
    // Its number comes before name, encoding and definition.
    record.get(2..).and_then(after_text).and_then(after_text).and_then(after_text)?;
    let Ok(Record::Schema { header, data }) = mcap::parse_record(op::SCHEMA, record) else {
        return None;
    };
    let schema =
        PayloadSchema { name: header.name, encoding: header.encoding, data: data.into_owned() };
    Some((header.id, schema)).filter(|(_, schema)| schema.data.len() <= room)
}

/// Whether the texts of a channel's record end within it: topic, encoding, and pairs of metadata. The library takes the memory that
/// a text claims to need, and looks for the value of a last key behind the pairs.
fn is_whole_channel(channel: &[u8]) -> bool {
    // The channel's and its schema's number come before.
    let texts = channel.get(4..).and_then(after_text).and_then(after_text);
    let Some((len, rest)) = texts.and_then(|rest| rest.split_first_chunk::<4>()) else {
        return false;
    };
    // What a later version of the format adds may follow.
    let pairs = usize::try_from(u32::from_le_bytes(*len)).ok().and_then(|len| rest.get(..len));
    let Some(mut pairs) = pairs else { return false };
    while let Some(rest) = after_text(pairs).and_then(after_text) {
        pairs = rest;
    }
    pairs.is_empty()
}

/// What follows a text: its length in 4 bytes, then itself.
fn after_text(bytes: &[u8]) -> Option<&[u8]> {
    let (len, rest) = bytes.split_first_chunk::<4>()?;
    rest.get(usize::try_from(u32::from_le_bytes(*len)).ok()?..)
}
