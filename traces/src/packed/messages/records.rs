//! [`RecordBlocks`]: reads the records of an MCAP file in sequence, and unpacks its chunks.
//!
//! The library would yield one record at a time and unpack only as much as that record needs. This
//! module unpacks a chunk and computes its checksum in large pieces. It leaves chunks that are
//! neither plain nor zstd, and chunks with a faulty head, to the library.

mod foreign;

use std::io::{self, BufRead, BufReader, Read};

use flate2::Crc;
use mcap::records::op;
use mcap::{MAGIC, McapError};
use zstd::stream::raw::{Decoder, InBuffer, Operation, OutBuffer};

use self::foreign::ForeignChunk;
use super::raw::RECORD;

/// The number of bytes in a block of records, unless one record is longer.
const BLOCK: usize = 256 << 10;
/// The number of bytes that are read and unpacked at once, so that memory grows only as bytes
/// arrive.
const PIECE: usize = 64 << 10;
/// The length of a record's head: its code and the length of what follows.
const HEAD: usize = 9;
/// The length of a chunk's head: two instants, a size, a checksum, and the length of the packing's
/// name.
const CHUNK: usize = 32;
/// The length of the packed size, which follows the name.
const SIZE: usize = 8;
/// The name of the packing that this module unpacks.
const ZSTD: &[u8] = b"zstd";

/// An MCAP file that is being read.
pub(super) struct RecordBlocks<R> {
    inner: BufReader<R>,
    place: FilePlace,
    zstd: Option<Decoder<'static>>,
    /// The beginning of a record for which the last block had no room.
    cut: Vec<u8>,
    /// The error to report once everything before it was handed over.
    error: Option<McapError>,
}

/// The part of the file that comes next.
enum FilePlace {
    Magic,
    Record,
    /// This many bytes of a record that is handed over.
    Taken(u64),
    /// This many bytes that are skipped.
    Skipped(u64),
    Chunk(ChunkRest),
    Foreign(Box<ForeignChunk>),
    EndMagic,
    End,
}

/// The rest of a chunk.
struct ChunkRest {
    is_packed: bool,
    /// Its length in the file.
    len: u64,
    /// Its length after unpacking, if it is packed.
    unpacked_len: u64,
    /// The length of what follows in the chunk's record.
    padding: u64,
    /// The checksum, or `None` if the chunk has none.
    checksum: Option<(u32, Crc)>,
}

impl<R: Read> RecordBlocks<R> {
    /// Creates a reader. It reads nothing yet.
    pub(super) fn new(inner: R) -> Self {
        let inner = BufReader::with_capacity(PIECE, inner);
        Self { inner, place: FilePlace::Magic, zstd: None, cut: Vec::new(), error: None }
    }

    /// Puts whole records into a block. Returns `false` at the end of the file. Records before an
    /// error are handed over first.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read; nothing follows then.
    pub(super) fn fill(&mut self, block: &mut Vec<u8>) -> Result<bool, McapError> {
        block.clear();
        block.append(&mut self.cut);
        let mut whole = 0;
        while self.error.is_none() && (whole == 0 || block.len() < BLOCK) {
            match self.advance(block, &mut whole) {
                Ok(()) if matches!(self.place, FilePlace::End) => break,
                Ok(()) => {}
                Err(error) => self.error = Some(error),
            }
        }
        self.cut.extend_from_slice(&block[whole..]);
        block.truncate(whole);
        if whole == 0
            && let Some(error) = self.error.take()
        {
            self.place = FilePlace::End;
            self.cut.clear();
            return Err(error);
        }
        Ok(whole > 0)
    }

    /// Reads a few more bytes of the file. `whole` is the end of the last whole record of the
    /// block.
    fn advance(&mut self, block: &mut Vec<u8>, whole: &mut usize) -> Result<(), McapError> {
        match &mut self.place {
            FilePlace::Magic => {
                self.magic()?;
                self.place = FilePlace::Record;
            }
            FilePlace::Record => self.place = self.record(block)?,
            FilePlace::Taken(left) => {
                let bytes = buffered(&mut self.inner, *left)?;
                block.extend_from_slice(bytes);
                let len = bytes.len();
                self.inner.consume(len);
                *left -= len as u64;
                if *left == 0 {
                    self.place = FilePlace::Record;
                    *whole = block.len();
                }
            }
            FilePlace::Skipped(0) => self.place = FilePlace::Record,
            FilePlace::Skipped(left) => {
                let len = buffered(&mut self.inner, *left)?.len();
                self.inner.consume(len);
                *left -= len as u64;
            }
            FilePlace::Chunk(_) => self.chunk(block, whole)?,
            FilePlace::Foreign(chunk) => {
                if !chunk.advance(&mut self.inner, block)? {
                    self.place = FilePlace::Record;
                }
                *whole = block.len();
            }
            FilePlace::EndMagic => {
                self.magic()?;
                self.place = FilePlace::End;
            }
            FilePlace::End => {}
        }
        Ok(())
    }

    /// Reads the head of the next record of the file.
    fn record(&mut self, block: &mut Vec<u8>) -> Result<FilePlace, McapError> {
        let mut head = [0; HEAD];
        self.exactly(&mut head)?;
        let (opcode, len) = split_head(head);
        if opcode == op::CHUNK {
            return self.chunk_head(head, len);
        }
        if len > RECORD as u64 {
            return Err(McapError::RecordTooLarge { opcode, len });
        }
        match opcode {
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                block.extend_from_slice(&head);
                return Ok(FilePlace::Taken(len));
            }
            op::DATA_END | op::FOOTER => {
                let mut bytes = Vec::new();
                let read = self.inner.by_ref().take(len).read_to_end(&mut bytes)?;
                if (read as u64) < len {
                    return Err(McapError::UnexpectedEof);
                }
                mcap::parse_record(opcode, &bytes)?;
                let is_last = opcode == op::FOOTER;
                return Ok(if is_last { FilePlace::EndMagic } else { FilePlace::Record });
            }
            _ => {}
        }
        Ok(FilePlace::Skipped(len))
    }

    /// Reads the head of a chunk of `len` bytes.
    fn chunk_head(&mut self, record: [u8; HEAD], len: u64) -> Result<FilePlace, McapError> {
        let mut head = [0; CHUNK + SIZE];
        self.exactly(&mut head)?;
        let (unpacked_len, name_len) = (number(&head[16..]), u64::from(short(&head[28..])));
        let head_len = head.len() as u64 + name_len;
        if len < head_len {
            return Err(McapError::BadChunkLength { header: head_len, available: len });
        }
        let mut read = [&record[..], &head].concat();
        let mut left = len - head.len() as u64;
        if name_len == ZSTD.len() as u64 {
            // The name that the size displaced.
            let mut rest = [0; ZSTD.len()];
            self.exactly(&mut rest)?;
            read.extend_from_slice(&rest);
            left -= rest.len() as u64;
        }
        let (size, name) =
            (number(&read[read.len() - SIZE..]), &read[HEAD + CHUNK..read.len() - SIZE]);
        let padding = left.checked_sub(size).filter(|padding| *padding <= RECORD as u64);
        let is_packed = name == ZSTD;
        let is_known = name_len == 0 || is_packed;
        let (true, Some(padding)) = (is_known, padding) else {
            return Ok(FilePlace::Foreign(Box::new(ForeignChunk::new(&read, left))));
        };
        let checksum = short(&head[24..]);
        let checksum = (checksum != 0).then(|| (checksum, Crc::new()));
        if let Some(zstd) = self.zstd.as_mut().filter(|_| is_packed) {
            zstd.reinit()?;
        }
        Ok(FilePlace::Chunk(ChunkRest { is_packed, len: size, unpacked_len, padding, checksum }))
    }

    /// Reads more of a chunk, or its end.
    fn chunk(&mut self, block: &mut Vec<u8>, whole: &mut usize) -> Result<(), McapError> {
        let FilePlace::Chunk(chunk) = &mut self.place else { return Ok(()) };
        let left = if chunk.is_packed { chunk.unpacked_len } else { chunk.len };
        if left == 0 {
            if *whole < block.len() {
                return Err(McapError::UnexpectedEoc);
            }
            if let Some((saved, crc)) = &chunk.checksum
                && *saved != crc.sum()
            {
                return Err(McapError::BadChunkCrc { saved: *saved, calculated: crc.sum() });
            }
            self.place = FilePlace::Skipped(chunk.len + chunk.padding);
            return Ok(());
        }
        let before = block.len();
        if chunk.is_packed {
            let zstd = match &mut self.zstd {
                Some(zstd) => zstd,
                none => none.insert(Decoder::new()?),
            };
            unpack(&mut self.inner, zstd, chunk, block)?;
        } else {
            let bytes = buffered(&mut self.inner, chunk.len)?;
            block.extend_from_slice(bytes);
            let len = bytes.len();
            self.inner.consume(len);
            chunk.len -= len as u64;
        }
        if let Some((_, crc)) = &mut chunk.checksum {
            crc.update(&block[before..]);
        }
        whole_records(block, whole)
    }

    fn magic(&mut self) -> Result<(), McapError> {
        let mut magic = [0; MAGIC.len()];
        self.exactly(&mut magic)?;
        if magic == *MAGIC { Ok(()) } else { Err(McapError::BadMagic) }
    }

    /// Reads exactly these bytes, or reports that the file was cut off.
    fn exactly(&mut self, bytes: &mut [u8]) -> Result<(), McapError> {
        self.inner.read_exact(bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => McapError::UnexpectedEof,
            _ => error.into(),
        })
    }
}

/// Unpacks more of a chunk into a block.
fn unpack(
    inner: &mut impl BufRead,
    zstd: &mut Decoder<'_>,
    chunk: &mut ChunkRest,
    block: &mut Vec<u8>,
) -> Result<(), McapError> {
    let packed = if chunk.len == 0 { &[] } else { buffered(inner, chunk.len)? };
    block.reserve(PIECE);
    let before = block.len();
    let (mut from, mut to) = (InBuffer::around(packed), OutBuffer::around_pos(block, before));
    let unpacked = zstd.run(&mut from, &mut to);
    unpacked.map_err(|error| McapError::DecompressionError(error.to_string()))?;
    let (read, wrote) = (from.pos(), to.pos() - before);
    inner.consume(read);
    if read == 0 && wrote == 0 {
        return Err(McapError::DecompressionError("decompressor made no progress".to_owned()));
    }
    chunk.len -= read as u64;
    // Bytes beyond the length that the chunk claims are not records.
    let most = usize::try_from(chunk.unpacked_len).unwrap_or(usize::MAX);
    block.truncate(before.saturating_add(most));
    chunk.unpacked_len -= (block.len() - before) as u64;
    Ok(())
}

/// Moves `whole` behind the last whole record of a block.
fn whole_records(block: &[u8], whole: &mut usize) -> Result<(), McapError> {
    while let Some((head, rest)) = block.get(*whole..).and_then(|rest| rest.split_first_chunk()) {
        let (opcode, len) = split_head(*head);
        let fits = usize::try_from(len).ok().filter(|len| *len <= RECORD);
        let len = fits.ok_or_else(|| McapError::RecordTooLarge { opcode, len })?;
        if rest.len() < len {
            break;
        }
        *whole += HEAD + len;
    }
    Ok(())
}

/// Returns from one to `most` bytes of the file.
fn buffered(inner: &mut impl BufRead, most: u64) -> Result<&[u8], McapError> {
    while let Err(error) = inner.fill_buf() {
        if error.kind() != io::ErrorKind::Interrupted {
            return Err(error.into());
        }
    }
    let bytes = inner.fill_buf()?;
    let most = usize::try_from(most).unwrap_or(usize::MAX);
    let bytes = bytes.get(..most).unwrap_or(bytes);
    if bytes.is_empty() && most > 0 { Err(McapError::UnexpectedEof) } else { Ok(bytes) }
}

/// Splits a record's head into code and length.
pub(super) const fn split_head(head: [u8; HEAD]) -> (u8, u64) {
    let [opcode, len @ ..] = head;
    (opcode, u64::from_le_bytes(len))
}

/// Returns the number in the first eight bytes.
fn number(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

fn short(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests;
