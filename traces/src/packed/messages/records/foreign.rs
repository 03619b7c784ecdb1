//! A chunk that the library reads.

use std::io::BufRead;

use mcap::McapError;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::buffered;
use crate::packed::messages::raw::RECORD;

/// A chunk that is being read, with lz4 or an unknown packing, or with a faulty head.
pub(super) struct ForeignChunk {
    reader: LinearReader,
    /// The rest of the chunk's record in the file.
    left: u64,
}

impl ForeignChunk {
    /// Creates a chunk from the bytes that were read, from its record's code on.
    pub(super) fn new(read: &[u8], left: u64) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_record_length_limit(RECORD)
            .with_validate_chunk_crcs(true);
        let mut reader = LinearReader::new_with_options(options);
        reader.insert(read.len()).copy_from_slice(read);
        reader.notify_read(read.len());
        Self { reader, left }
    }

    /// Puts the next record into a block. Returns `false` at the chunk's end.
    pub(super) fn advance(
        &mut self,
        inner: &mut impl BufRead,
        block: &mut Vec<u8>,
    ) -> Result<bool, McapError> {
        match self.reader.next_event().transpose()? {
            Some(LinearReadEvent::Record { data, opcode }) => {
                block.push(opcode);
                block.extend_from_slice(&(data.len() as u64).to_le_bytes());
                block.extend_from_slice(data);
            }
            // The library wants the next record of the file.
            None => return Ok(false),
            Some(LinearReadEvent::ReadRequest(_)) if self.left == 0 => return Ok(false),
            Some(LinearReadEvent::ReadRequest(wanted)) => {
                let bytes = buffered(inner, self.left.min(wanted as u64))?;
                let len = bytes.len();
                self.reader.insert(len).copy_from_slice(bytes);
                self.reader.notify_read(len);
                inner.consume(len);
                self.left -= len as u64;
            }
        }
        Ok(true)
    }
}
