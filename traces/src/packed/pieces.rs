//! Unpacked bytes in pieces of many lines.

use std::io::{self, BufRead, Read};

/// The number of bytes that are unpacked at once. A longer line comes in several pieces, or makes a
/// piece longer.
pub(super) const PIECE: usize = 128 << 10;

/// Fills pieces with unpacked bytes.
pub(super) struct ReadPieces<R> {
    inner: R,
    /// The error to report once everything before it was handed over.
    error: Option<io::Error>,
}

impl<R: Read> ReadPieces<R> {
    pub(super) const fn new(inner: R) -> Self {
        Self { inner, error: None }
    }

    /// Fills a piece. Returns `false` at the end.
    pub(super) fn fill(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        piece.clear();
        piece.reserve(PIECE);
        if self.error.is_none() {
            self.error = self.inner.by_ref().take(PIECE as u64).read_to_end(piece).err();
        }
        match self.error.take_if(|_| piece.is_empty()) {
            Some(error) => Err(error),
            None => Ok(!piece.is_empty()),
        }
    }
}

/// Reads pieces that `F` fills; `F` returns `false` at the end.
pub(super) struct PieceReader<F> {
    fill: F,
    piece: Vec<u8>,
    taken: usize,
}

impl<F> PieceReader<F> {
    pub(super) const fn new(fill: F) -> Self {
        Self { fill, piece: Vec::new(), taken: 0 }
    }
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> BufRead for PieceReader<F> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.taken == self.piece.len() {
            self.taken = 0;
            match (self.fill)(&mut self.piece) {
                Ok(true) => {}
                Ok(false) => {
                    self.piece.clear();
                    break;
                }
                Err(error) => {
                    self.piece.clear();
                    return Err(error);
                }
            }
        }
        Ok(self.piece.get(self.taken..).unwrap_or_default())
    }

    fn consume(&mut self, amount: usize) {
        self.taken = self.piece.len().min(self.taken + amount);
    }
}

impl<F: FnMut(&mut Vec<u8>) -> io::Result<bool>> Read for PieceReader<F> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}
