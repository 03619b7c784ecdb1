//! [`RecordBlocks`]: collects the records of an MCAP file into blocks, in the order of the file.

use std::io::{self, Read};

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::raw::RECORD;

/// The number of bytes in a block of records, unless one record is longer.
const BLOCK: usize = 256 << 10;
/// The number of bytes that are read at once, so that memory grows only as bytes arrive.
const PIECE: usize = 64 << 10;
/// The length of a record's head: its code and the length of what follows.
const HEAD: usize = 9;

/// An MCAP file that is being read.
pub(super) struct RecordBlocks<R> {
    inner: R,
    reader: LinearReader,
    /// The error to report once everything before it was handed over.
    error: Option<McapError>,
    has_ended: bool,
}

impl<R: Read> RecordBlocks<R> {
    /// Creates a reader. It reads nothing yet.
    pub(super) fn new(inner: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_record_length_limit(RECORD)
            .with_validate_chunk_crcs(true);
        let reader = LinearReader::new_with_options(options);
        Self { inner, reader, error: None, has_ended: false }
    }

    /// Puts whole schemas, channels and messages into a block. Returns `false` at the end of the
    /// file. Records before an error are handed over first.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read; nothing follows then.
    pub(super) fn fill(&mut self, block: &mut Vec<u8>) -> Result<bool, McapError> {
        block.clear();
        while !self.has_ended && block.len() < BLOCK {
            match self.advance(block) {
                Ok(goes_on) => self.has_ended = !goes_on,
                Err(error) => (self.error, self.has_ended) = (Some(error), true),
            }
        }
        match self.error.take_if(|_| block.is_empty()) {
            Some(error) => Err(error),
            None => Ok(!block.is_empty()),
        }
    }

    /// Takes one record from the library, or gives it more bytes of the file. Returns `false` at
    /// the end.
    fn advance(&mut self, block: &mut Vec<u8>) -> Result<bool, McapError> {
        match self.reader.next_event().transpose()? {
            Some(LinearReadEvent::Record { data, opcode }) => {
                if matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                    block.push(opcode);
                    block.extend_from_slice(&(data.len() as u64).to_le_bytes());
                    block.extend_from_slice(data);
                }
            }
            Some(LinearReadEvent::ReadRequest(_)) => {
                let len = match self.inner.read(self.reader.insert(PIECE)) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => return Ok(true),
                    read => read?,
                };
                self.reader.notify_read(len);
            }
            None => return Ok(false),
        }
        Ok(true)
    }
}

/// Splits a record's head into code and length.
pub(super) const fn split_head(head: [u8; HEAD]) -> (u8, u64) {
    let [opcode, len @ ..] = head;
    (opcode, u64::from_le_bytes(len))
}
