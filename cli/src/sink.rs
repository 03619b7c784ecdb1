//! Output whose reader may go away: the exit code is still wanted.

use std::io::{self, Write};

/// Takes everything, even after its reader has gone.
pub(crate) struct OutputSink<W> {
    inner: W,
    is_closed: bool,
}

impl<W: Write> OutputSink<W> {
    /// Writes to `inner` while somebody reads it.
    pub(crate) const fn new(inner: W) -> Self {
        Self { inner, is_closed: false }
    }

    fn attempt<T>(&mut self, written: io::Result<T>, otherwise: T) -> io::Result<T> {
        match written {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                self.is_closed = true;
                Ok(otherwise)
            }
            written => written,
        }
    }
}

impl<W: Write> Write for OutputSink<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = if self.is_closed { Ok(bytes.len()) } else { self.inner.write(bytes) };
        self.attempt(written, bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = if self.is_closed { Ok(()) } else { self.inner.flush() };
        self.attempt(flushed, ())
    }
}
