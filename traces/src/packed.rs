//! Reads the lines of a trace from a file that is plain, gzip, zstd or MCAP.
//!
//! ```
//! # #[cfg(feature = "packed")]
//! # {
//! use fuseline_traces::judge;
//! use fuseline_traces::packed::unpack;
//!
//! let trace = b"{\"fuseline\":1,\"window\":16,\"clouds\":[]}\n{\"ev\":\"tick\",\"at\":7}\n";
//! let packed = zstd::encode_all(&trace[..], 0)?;
//! let verdict = judge("drive.jsonl.zst", unpack(&packed[..])?)?;
//! assert!(verdict.violations.is_empty() && verdict.lines == 2);
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The first byte of a file tells how it is packed; its name does not matter. The command and the
//! Python wheel both read files with this module, so they accept the same files.
//!
//! | packed | unpacked in memory of |
//! |---|---|
//! | gzip, with one or several members | 32 KiB |
//! | zstd, with one or several frames | the frame's window, at most 128 MiB |
//! | MCAP, its chunks plain, lz4 or zstd | its largest record, at most 40 MiB |
//!
//! In an MCAP file, the messages of the topic `/fuseline/trace` are the lines. They are rewritten
//! in the form of a trace, so their verdict is the same as after `fuseline convert`. A length that
//! a file claims takes no memory before its bytes arrive. A record in an lz4 chunk is the
//! exception: it takes the memory that it claims at once. Every record beyond 40 MiB is refused.
//!
//! Without the feature `packed` only gzip is unpacked.
//!
//! This module does not read tar or zip, and no encoding other than JSON (`RawMessages` returns
//! such bytes). It cannot supply the header for an MCAP file without one;
//! `fuseline convert --header` can.

mod beside;
#[cfg(feature = "packed")]
mod messages;
mod pieces;

use std::io::{self, BufRead, BufReader, Read};

use flate2::bufread::MultiGzDecoder;

pub use beside::unpack_beside;
#[cfg(feature = "packed")]
pub use messages::{
    MessageError, Messages, PayloadFormat, PayloadSchema, RECORD, RawMessage, RawMessages,
};

#[cfg(feature = "packed")]
use self::messages::MessageLines;
use self::pieces::PIECE;
#[cfg(feature = "packed")]
use self::pieces::PieceReader;

/// The topic of a trace's lines, unless another one is named.
pub const TOPIC: &str = "/fuseline/trace";

/// The binary logarithm of the greatest window of a zstd frame, in bytes. The `zstd` command has
/// the same limit.
#[cfg(feature = "packed")]
const WINDOW_LOG: u32 = 27;

/// The first bytes of a zstd frame.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// The packing of a file, told by its first byte. No trace begins with one of these bytes.
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
    /// Returns the packing for a first byte, or `None` for a plain file.
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

/// Reads the lines of a trace, however they are packed.
///
/// If a packed file is cut off, reading its end returns an error of the kind `UnexpectedEof`.
///
/// # Errors
/// Returns an error if the first bytes cannot be read.
pub fn unpack<'a, R: BufRead + 'a>(mut inner: R) -> io::Result<Box<dyn BufRead + 'a>> {
    Ok(match inner.fill_buf()?.first().copied().and_then(Packing::of) {
        None => Box::new(inner),
        #[cfg(feature = "packed")]
        Some(Packing::Mcap) => {
            let mut lines = MessageLines::new(inner);
            Box::new(PieceReader::new(move |piece: &mut Vec<u8>| lines.fill(piece)))
        }
        Some(packing) => Box::new(BufReader::with_capacity(PIECE, decoder(inner, packing)?)),
    })
}

/// Reads bytes, unpacked if they are packed as gzip or zstd, and unchanged otherwise.
///
/// If a packed file is cut off, reading its end returns an error of the kind `UnexpectedEof`.
///
/// # Errors
/// Returns an error if the first bytes cannot be read.
pub fn unpack_bytes<'a, R: BufRead + 'a>(mut inner: R) -> io::Result<Box<dyn BufRead + 'a>> {
    let start = inner.fill_buf()?;
    let packing = if start.starts_with(&[0x1f, 0x8b]) {
        Packing::Gzip
    } else if start.starts_with(&ZSTD) {
        Packing::Zstd
    } else {
        return Ok(Box::new(inner));
    };
    Ok(Box::new(BufReader::with_capacity(PIECE, decoder(inner, packing)?)))
}

/// Unpacks a message that is compressed by itself, as rosbag2 does in its mode `message`. Returns
/// `None` if it is not compressed or has more than [`RECORD`] bytes.
#[cfg(feature = "packed")]
#[must_use]
pub fn unpack_message(data: &[u8]) -> Option<Vec<u8>> {
    if !data.starts_with(&ZSTD) {
        return None;
    }
    let mut unpacked = Vec::new();
    let most = u64::try_from(RECORD).ok()? + 1;
    decoder(data, Packing::Zstd).ok()?.take(most).read_to_end(&mut unpacked).ok()?;
    (unpacked.len() <= RECORD).then_some(unpacked)
}

/// Unpacks bytes that are packed as gzip or zstd.
fn decoder<'a, R: BufRead + 'a>(inner: R, packing: Packing) -> io::Result<Box<dyn Read + 'a>> {
    Ok(match packing {
        Packing::Gzip => Box::new(MultiGzDecoder::new(inner)),
        #[cfg(feature = "packed")]
        Packing::Zstd => {
            let mut unpacked = zstd::Decoder::with_buffer(inner)?;
            unpacked.window_log_max(WINDOW_LOG)?;
            Box::new(unpacked)
        }
        // MCAP is not a stream of bytes.
        #[cfg(feature = "packed")]
        Packing::Mcap => Box::new(inner),
        #[cfg(not(feature = "packed"))]
        Packing::Zstd | Packing::Mcap => {
            let why = format!(
                "packed as {packing:?}, which this build cannot read; build it with the feature packed"
            );
            return Err(io::Error::new(io::ErrorKind::Unsupported, why));
        }
    })
}
