//! Where the records of chunks end.

use mcap::records::op;

/// A record's code and the length of what follows.
const HEAD: usize = 9;
/// What a chunk's record begins with: two instants, a size, a checksum, the length of the packing's name.
const CHUNK: usize = 32;
const SIZE: usize = 8;
/// At the beginning of a file.
const MAGIC: usize = 8;

/// Looks at the bytes of a file before the library does, which takes the length of a record off that of its chunk without a
/// look: with the checks of a debug build it panics where a record of a chunk that is not packed goes beyond the chunk.
///
/// What else is wrong with a file is reported by the library.
#[derive(Debug)]
pub(super) struct ChunkScanner {
    at: ReadPosition,
    /// What is passed over.
    skip: u64,
    /// The bytes so far of what is being read.
    head: Vec<u8>,
}

/// A record that goes beyond its chunk.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct RecordOverrun;

/// What comes next.
#[derive(Clone, Copy, Debug)]
enum ReadPosition {
    Magic,
    Record,
    /// The rest of a chunk's record is so long.
    Chunk(u64),
    /// A chunk that is not packed, and its record's rest.
    Size(u64),
    /// So many bytes of records in a chunk, and of its record behind them.
    Inner(u64, u64),
}

impl ChunkScanner {
    pub(super) const fn new() -> Self {
        Self { at: ReadPosition::Magic, skip: 0, head: Vec::new() }
    }

    /// Takes the next bytes of the file.
    pub(super) fn look(&mut self, mut bytes: &[u8]) -> Result<(), RecordOverrun> {
        loop {
            let skipped = usize::try_from(self.skip).unwrap_or(usize::MAX).min(bytes.len());
            self.skip -= skipped as u64;
            bytes = &bytes[skipped..];
            let wanted = self.wanted() - self.head.len();
            let (head, rest) = bytes.split_at(wanted.min(bytes.len()));
            self.head.extend_from_slice(head);
            if self.skip > 0 || head.len() < wanted {
                return Ok(());
            }
            bytes = rest;
            self.pass()?;
            self.head.clear();
        }
    }

    const fn wanted(&self) -> usize {
        match self.at {
            ReadPosition::Magic => MAGIC,
            ReadPosition::Record | ReadPosition::Inner(..) => HEAD,
            ReadPosition::Chunk(_) => CHUNK,
            ReadPosition::Size(_) => SIZE,
        }
    }

    /// Goes on behind what was read.
    fn pass(&mut self) -> Result<(), RecordOverrun> {
        (self.at, self.skip) = match self.at {
            ReadPosition::Magic => (ReadPosition::Record, 0),
            ReadPosition::Record if self.head[0] == op::CHUNK => {
                (ReadPosition::Chunk(self.number(1)), 0)
            }
            ReadPosition::Record => (ReadPosition::Record, self.number(1)),
            ReadPosition::Chunk(len) => {
                let rest = len.saturating_sub(CHUNK as u64);
                if self.head[28..].iter().all(|byte| *byte == 0) {
                    (ReadPosition::Size(rest), 0)
                } else {
                    (ReadPosition::Record, rest)
                }
            }
            ReadPosition::Size(len) => {
                let (rest, size) = (len.saturating_sub(SIZE as u64), self.number(0));
                inside(size, rest.saturating_sub(size))
            }
            ReadPosition::Inner(left, behind) => {
                let len = self.number(1);
                let left = left.checked_sub(HEAD as u64).and_then(|left| left.checked_sub(len));
                let (at, skip) = inside(left.ok_or(RecordOverrun)?, behind);
                (at, skip.saturating_add(len))
            }
        };
        Ok(())
    }

    /// The eight bytes from here on.
    fn number(&self, from: usize) -> u64 {
        let bytes = self.head[from..].first_chunk::<8>();
        u64::from_le_bytes(*bytes.expect("what is at hand is whole"))
    }
}

/// So many bytes of records in a chunk, and so many behind them.
const fn inside(left: u64, behind: u64) -> (ReadPosition, u64) {
    if left > 0 { (ReadPosition::Inner(left, behind), 0) } else { (ReadPosition::Record, behind) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with one chunk that is not packed and says that its records take so many bytes, and bytes behind it.
    fn file(claimed: u64) -> Vec<u8> {
        let records = [&[op::MESSAGE][..], &3_u64.to_le_bytes(), b"abc"].concat();
        let chunk = [&[0; CHUNK][..], &claimed.to_le_bytes(), &records, &[0; 4]].concat();
        let len = (chunk.len() as u64).to_le_bytes();
        [&[0; MAGIC][..], &[op::CHUNK], &len, &chunk, &[op::HEADER], &0_u64.to_le_bytes()].concat()
    }

    #[test]
    fn a_record_ends_in_its_chunk_however_the_bytes_come() {
        // One record of 12 bytes: less cuts it off, more is a second one of which there is not enough.
        for (claimed, is_whole) in [(0, true), (1, false), (11, false), (12, true), (13, false)] {
            let file = file(claimed);
            for piece in [1, 2, 7, file.len()] {
                let mut chunks = ChunkScanner::new();
                let looked = file.chunks(piece).try_for_each(|piece| chunks.look(piece));
                assert_eq!(looked.is_ok(), is_whole, "{claimed} by {piece}");
            }
        }
    }
}
