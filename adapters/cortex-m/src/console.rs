//! Standard input and output of the host that debugs the board.

use core::fmt;

use cortex_m_semihosting::syscall;

/// The longest line of a trace (A38).
pub const LONGEST: usize = 65_536;

/// The host's console.
pub struct Console {
    input: usize,
    output: usize,
    buffer: heapless::Vec<u8, { LONGEST + 1 }>,
    /// The number of bytes at the front of the buffer that were returned as lines.
    consumed: usize,
}

impl Console {
    /// Opens both directions.
    #[must_use]
    pub fn open() -> Self {
        let open = |mode: usize| -> usize {
            let name = b":tt\0";
            #[expect(unsafe_code, reason = "asks the host")]
            // SAFETY: the name ends and has the given length; the host only reads it.
            unsafe {
                syscall!(OPEN, name.as_ptr(), mode, name.len() - 1)
            }
        };
        Self { input: open(0), output: open(4), buffer: heapless::Vec::new(), consumed: 0 }
    }

    /// Returns the next line without its end, or `None` if the input ends or the line is too long.
    pub fn line(&mut self) -> Option<&[u8]> {
        self.buffer.rotate_left(self.consumed);
        self.buffer.truncate(self.buffer.len() - self.consumed);
        self.consumed = 0;
        loop {
            if let Some(end) = self.buffer.iter().position(|byte| *byte == b'\n') {
                self.consumed = end + 1;
                return Some(&self.buffer[..end]);
            }
            self.read_some()?;
        }
    }

    /// Waits for more input. Returns `None` if there is none, or if the buffer is full.
    fn read_some(&mut self) -> Option<()> {
        let mut chunk = [0_u8; 1024];
        let room = chunk.len().min(self.buffer.capacity() - self.buffer.len());
        #[expect(unsafe_code, reason = "asks the host")]
        // SAFETY: the host writes at most `room` bytes, and the chunk has at least as many.
        let remaining = unsafe { syscall!(READ, self.input, chunk.as_mut_ptr(), room) };
        let got = chunk.get(..room.checked_sub(remaining)?)?;
        self.buffer.extend_from_slice(got).ok()?;
        (!got.is_empty()).then_some(())
    }
}

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        #[expect(unsafe_code, reason = "asks the host")]
        // SAFETY: the host reads the text, which has the given length.
        let remaining = unsafe { syscall!(WRITE, self.output, text.as_ptr(), text.len()) };
        if remaining == 0 { Ok(()) } else { Err(fmt::Error) }
    }
}
