#![doc = include_str!("../README.md")]

mod messages;
pub mod rows;

use std::io::{self, BufRead, BufReader};

pub use messages::{MessageError, Messages, TOPIC};

/// The binary logarithm of the greatest window of a zstd frame, in bytes: what its own command takes.
const WINDOW_LOG: u32 = 27;

/// How a file's first byte says that it is packed; a trace begins with none of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Packing {
    /// Gzip.
    Gzip,
    /// Zstd.
    Zstd,
    /// MCAP.
    Mcap,
}

impl Packing {
    /// What a first byte says; none of a plain file.
    #[must_use]
    pub const fn of(first: u8) -> Option<Self> {
        match first {
            0x1f => Some(Self::Gzip),
            0x28 => Some(Self::Zstd),
            0x89 => Some(Self::Mcap),
            _ => None,
        }
    }
}

/// Reads a trace's lines, however they are packed.
///
/// What is packed and not whole gives an error of the kind `UnexpectedEof` where it ends.
///
/// # Errors
/// If the first bytes cannot be read.
pub fn unpack<'a, R: BufRead + 'a>(mut inner: R) -> io::Result<Box<dyn BufRead + 'a>> {
    Ok(match inner.fill_buf()?.first().copied().and_then(Packing::of) {
        None => Box::new(inner),
        Some(Packing::Gzip) => fuseline_traces::unpack(inner)?,
        Some(Packing::Zstd) => {
            let mut unpacked = zstd::Decoder::with_buffer(inner)?;
            unpacked.window_log_max(WINDOW_LOG)?;
            Box::new(BufReader::with_capacity(64 * 1024, unpacked))
        }
        Some(Packing::Mcap) => Box::new(messages::Lines::new(inner)),
    })
}
