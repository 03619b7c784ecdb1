//! A growing file, as the whole lines that it has so far.

use std::fs::File;
use std::io::{self, BufRead, Read};
use std::thread;
use std::time::Duration;

use fuseline_traces::LINE;

use crate::interrupt::Interrupt;

/// A file that did not grow is looked at again after this time.
const PAUSE: Duration = Duration::from_millis(100);
/// The number of bytes that are read at once.
const CHUNK: usize = 64 * 1024;

/// Reads a file as it grows; its end comes with the interrupt.
///
/// Only whole lines are given out, so that a line is never read while it is being written, and a
/// last one without its end is left out. A line too long for a trace is given out as it is: its
/// reader refuses it.
pub(crate) struct Tail {
    file: File,
    interrupt: Interrupt,
    /// The bytes that were read and not used, whole lines first.
    held: Vec<u8>,
    /// The number of its bytes that were taken.
    consumed: usize,
    /// The number of its bytes that are whole lines.
    whole: usize,
    /// The number of bytes of the file that were read.
    read: u64,
}

impl Tail {
    /// Reads from where the file stands.
    pub(crate) const fn new(file: File, interrupt: Interrupt) -> Self {
        Self { file, interrupt, held: Vec::new(), consumed: 0, whole: 0, read: 0 }
    }

    /// Reads once more; says whether there was anything new.
    fn grow(&mut self) -> io::Result<bool> {
        if self.file.metadata()?.len() < self.read {
            let shrank = "the file shrank while it was followed; follow the new one";
            return Err(io::Error::new(io::ErrorKind::InvalidData, shrank));
        }
        self.held.drain(..self.consumed);
        let before = self.held.len();
        self.held.resize(before + CHUNK, 0);
        let read = self.file.read(&mut self.held[before..]);
        self.held.truncate(before + *read.as_ref().unwrap_or(&0));
        let len = read?;
        self.read += len as u64;
        self.consumed = 0;
        self.whole = match self.held.iter().rposition(|byte| *byte == b'\n') {
            Some(end) => end + 1,
            None if self.held.len() > LINE => self.held.len(),
            None => 0,
        };
        Ok(len > 0)
    }
}

impl BufRead for Tail {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.consumed == self.whole && !self.interrupt.is_set() {
            if !self.grow()? {
                thread::sleep(PAUSE);
            }
        }
        Ok(&self.held[self.consumed..self.whole])
    }

    fn consume(&mut self, amount: usize) {
        self.consumed = (self.consumed + amount).min(self.whole);
    }
}

impl Read for Tail {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// Returns a file with this text and a tail of it that is already interrupted, so that nothing
    /// waits.
    fn tail(text: &str) -> (tempfile::NamedTempFile, Tail) {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let tail = Tail::new(file.reopen().unwrap(), Interrupt::default());
        (file, tail)
    }

    #[test]
    fn whole_lines_are_given_and_an_unfinished_one_waits() {
        let (mut file, mut tail) = tail("one\ntwo\nthr");
        assert_eq!(tail.fill_buf().unwrap(), b"one\ntwo\n");
        tail.consume(4);
        assert_eq!(tail.fill_buf().unwrap(), b"two\n");
        tail.consume(4);
        file.write_all(b"ee\n").unwrap();
        assert_eq!(tail.fill_buf().unwrap(), b"three\n");
    }

    #[test]
    fn an_interrupt_is_the_end_and_leaves_an_unfinished_line_out() {
        let (_file, mut tail) = tail("one\ntw");
        let mut line = String::new();
        tail.read_line(&mut line).unwrap();
        tail.interrupt.set();
        assert_eq!(tail.read_line(&mut line).unwrap(), 0);
        assert_eq!(line, "one\n");
    }

    #[test]
    fn a_line_too_long_is_given_out_to_be_refused() {
        let (_file, mut tail) = tail(&"x".repeat(LINE + 1));
        assert_eq!(tail.fill_buf().unwrap().len(), LINE + 1);
    }

    #[test]
    fn a_file_that_shrinks_is_an_error() {
        let (file, mut tail) = tail("one\n");
        tail.fill_buf().unwrap();
        tail.consume(4);
        file.as_file().set_len(0).unwrap();
        assert_eq!(tail.fill_buf().unwrap_err().kind(), io::ErrorKind::InvalidData);
    }
}
