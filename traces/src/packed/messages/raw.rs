//! [`RawMessages`]: reads the messages of some topics of an MCAP file unchanged, with their encoding.
//!
//! The library allocates whatever length a file claims, so this module checks lengths first.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};
use std::ops::Range;
use std::rc::Rc;

use mcap::McapError;
use mcap::records::{Record, op};

use super::records::split_head;
use super::{MessageError, blocks};

/// The longest record in bytes; a 4K image with four channels fits.
///
/// A record in an lz4 chunk takes the memory that it claims before its first byte arrives. Any
/// record takes up to three times its length while a buffer grows. All schemas together may have
/// this many bytes too.
pub const RECORD: usize = 40 << 20;
/// The number of other topics that are remembered.
const SEEN: usize = 1000;
/// The length of a message's head: its channel, a number, and two instants.
const MESSAGE: usize = 22;

/// A message as it was recorded.
#[derive(Clone, Debug)]
pub struct RawMessage {
    /// The index of its topic among the topics that were asked for.
    pub topic: usize,
    /// The instant of recording in ns.
    pub log_time: u64,
    /// The format of its bytes.
    pub format: Rc<PayloadFormat>,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// The format of the messages of a channel.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PayloadFormat {
    /// The encoding, such as `json`, `cdr` or `protobuf`.
    pub encoding: String,
    /// The schema, or `None` if the file has none before the channel.
    pub schema: Option<Rc<PayloadSchema>>,
}

/// A schema of a file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PayloadSchema {
    /// The type's name, such as `std_msgs/msg/Header`.
    pub name: String,
    /// The schema's encoding, such as `ros2msg` or `protobuf`.
    pub encoding: String,
    /// The definition of the type, in that encoding.
    pub data: Vec<u8>,
}

/// Puts the next whole records of the file into a block.
type NextRecords<'a> = dyn FnMut(&mut Vec<u8>) -> io::Result<bool> + 'a;

/// Reads the messages of some topics of an MCAP file, in the order of the file.
///
/// After an error it yields nothing more.
pub struct RawMessages<'a> {
    records: Box<NextRecords<'a>>,
    block: Vec<u8>,
    /// The place in the block at which the next record begins.
    at: usize,
    topics: Vec<&'a str>,
    schemas: BTreeMap<u16, Rc<PayloadSchema>>,
    /// The number of bytes of all schemas.
    schemas_len: usize,
    channels: BTreeMap<u16, (usize, Rc<PayloadFormat>)>,
    /// The topics of all channels.
    seen: BTreeSet<String>,
}

/// A message that borrows its bytes from the block.
pub(super) struct LentMessage<'m> {
    pub(super) topic: usize,
    pub(super) log_time: u64,
    pub(super) format: &'m Rc<PayloadFormat>,
    pub(super) data: &'m [u8],
}

impl<'a> RawMessages<'a> {
    /// Creates a reader for the messages of these topics. It reads nothing yet.
    pub fn new(inner: impl Read + 'a, topics: Vec<&'a str>) -> Self {
        Self::of_blocks(blocks(inner), topics)
    }

    /// Creates a reader for blocks of whole records.
    pub(super) fn of_blocks(
        records: impl FnMut(&mut Vec<u8>) -> io::Result<bool> + 'a,
        topics: Vec<&'a str>,
    ) -> Self {
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        let (records, block) = (Box::new(records), Vec::new());
        let seen = BTreeSet::new();
        Self { records, block, at: 0, topics, schemas, schemas_len: 0, channels, seen }
    }

    /// Returns the topics of the channels so far, up to a thousand and those that were asked for.
    pub fn seen(&self) -> impl Iterator<Item = &str> {
        self.seen.iter().map(|topic| &**topic)
    }

    /// Returns the next message of the topics, or `None` at the end.
    ///
    /// # Errors
    /// Returns a [`MessageError`] if the file cannot be read.
    pub fn message(&mut self) -> Result<Option<RawMessage>, MessageError> {
        Ok(self.lend()?.map(|message| {
            let LentMessage { topic, log_time, format, data } = message;
            RawMessage { topic, log_time, format: Rc::clone(format), data: data.to_vec() }
        }))
    }

    /// Returns the next message, borrowed from the block.
    pub(super) fn lend(&mut self) -> Result<Option<LentMessage<'_>>, MessageError> {
        let (channel_id, log_time, data) = loop {
            let Some((opcode, record)) = self.record()? else { return Ok(None) };
            if opcode != op::MESSAGE {
                self.describe(opcode, record)?;
                continue;
            }
            let bytes = &self.block[record.clone()];
            let Some(head) = bytes.first_chunk::<MESSAGE>() else {
                // The library reports the error.
                mcap::parse_record(opcode, bytes)?;
                continue;
            };
            let [low, high, _, _, _, _, log_time @ .., _, _, _, _, _, _, _, _] = head;
            let channel_id = u16::from_le_bytes([*low, *high]);
            if self.channels.contains_key(&channel_id) {
                break (
                    channel_id,
                    u64::from_le_bytes(*log_time),
                    record.start + MESSAGE..record.end,
                );
            }
        };
        let data = &self.block[data];
        let channel = self.channels.get(&channel_id);
        Ok(channel.map(|(topic, format)| LentMessage { topic: *topic, log_time, format, data }))
    }

    /// Returns the code of the next record and the range of its bytes in the block.
    fn record(&mut self) -> Result<Option<(u8, Range<usize>)>, MessageError> {
        while self.at == self.block.len() {
            self.at = 0;
            if !(self.records)(&mut self.block)? {
                self.block.clear();
                return Ok(None);
            }
        }
        let Some((head, rest)) = self.block[self.at..].split_first_chunk() else {
            return Err(McapError::UnexpectedEoc.into());
        };
        let (opcode, len) = split_head(*head);
        let fits = usize::try_from(len).ok().filter(|len| *len <= rest.len());
        let Some(len) = fits else { return Err(McapError::UnexpectedEoc.into()) };
        let start = self.block.len() - rest.len();
        let end = start + len;
        self.at = end;
        Ok(Some((opcode, start..end)))
    }

    /// Notes a record that is not a message.
    fn describe(&mut self, opcode: u8, record: Range<usize>) -> Result<(), MessageError> {
        let data = &self.block[record];
        match opcode {
            op::SCHEMA => {
                let room = RECORD - self.schemas_len;
                if let Some((id, schema)) = schema_of(data, room) {
                    self.schemas_len += schema.data.len();
                    self.schemas.insert(id, Rc::new(schema));
                }
            }
            op::CHANNEL => {
                if !is_whole_channel(data) {
                    return Err(McapError::UnexpectedEof.into());
                }
                let Record::Channel(channel) = mcap::parse_record(opcode, data)? else {
                    return Ok(());
                };
                let topic = self.topics.iter().position(|topic| *topic == channel.topic);
                if topic.is_some() || self.seen.len() < SEEN {
                    self.seen.insert(channel.topic);
                }
                if let Some(topic) = topic {
                    let schema = self.schemas.get(&channel.schema_id).cloned();
                    let format = PayloadFormat { encoding: channel.message_encoding, schema };
                    self.channels.insert(channel.id, (topic, Rc::new(format)));
                }
            }
            // Other records are not parsed, because the library allocates whatever length a text in
            // them claims.
            _ => {}
        }
        Ok(())
    }
}

/// Returns a schema and its number, or `None` if it is not whole or its definition is longer than
/// `room`.
fn schema_of(record: &[u8], room: usize) -> Option<(u16, PayloadSchema)> {
    // The number comes before the name, the encoding and the definition.
    record.get(2..).and_then(after_text).and_then(after_text).and_then(after_text)?;
    let Ok(Record::Schema { header, data }) = mcap::parse_record(op::SCHEMA, record) else {
        return None;
    };
    let schema =
        PayloadSchema { name: header.name, encoding: header.encoding, data: data.into_owned() };
    Some((header.id, schema)).filter(|(_, schema)| schema.data.len() <= room)
}

/// Returns `true` if the texts of a channel's record end within it: topic, encoding, and pairs of
/// metadata.
///
/// The library allocates whatever length a text claims, and it looks for the value of a last key
/// behind the pairs.
fn is_whole_channel(channel: &[u8]) -> bool {
    // The numbers of the channel and of its schema come first.
    let texts = channel.get(4..).and_then(after_text).and_then(after_text);
    let Some((len, rest)) = texts.and_then(|rest| rest.split_first_chunk::<4>()) else {
        return false;
    };
    // Fields of a later version of the format may follow.
    let pairs = usize::try_from(u32::from_le_bytes(*len)).ok().and_then(|len| rest.get(..len));
    let Some(mut pairs) = pairs else { return false };
    while let Some(rest) = after_text(pairs).and_then(after_text) {
        pairs = rest;
    }
    pairs.is_empty()
}

/// Returns what follows a text, which has its length in 4 bytes before it.
fn after_text(bytes: &[u8]) -> Option<&[u8]> {
    let (len, rest) = bytes.split_first_chunk::<4>()?;
    rest.get(usize::try_from(u32::from_le_bytes(*len)).ok()?..)
}
