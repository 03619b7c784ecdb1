//! Traces as lines, however they are packed: plain, gzip, zstd or MCAP.
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
//! The first byte says how a file is packed, not its name. The command and the wheel for Python both read with this, so what
//! one can read the other can.
//!
//! | packed | unpacked in memory of |
//! |---|---|
//! | gzip, several members too | 32 KiB |
//! | zstd, several frames too | the frame's window, at most 128 MiB |
//! | MCAP, its chunks plain, lz4 or zstd | its largest record, at most 40 MiB |
//!
//! Of an MCAP file the messages of the topic `/fuseline/trace` are the lines. They are written anew in the form of a trace, so that
//! their verdict is that of what `fuseline convert` makes. A length that a file claims takes no memory before its bytes come;
//! but a record in a chunk of lz4 takes at once what it claims, and any is refused beyond 40 MiB.
//!
//! Without the feature `packed` only gzip is unpacked.
//!
//! Not provided: tar and zip, a header of one's own for an MCAP file that has none (`fuseline convert --header` does that), other
//! encodings than JSON (`RawMessages` has their bytes).

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

/// The topic of a trace's lines, unless another is named.
pub const TOPIC: &str = "/fuseline/trace";

/// The binary logarithm of the greatest window of a zstd frame, in bytes: what its own command takes.
#[cfg(feature = "packed")]
const WINDOW_LOG: u32 = 27;

/// What a zstd frame begins with.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

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
        #[cfg(feature = "packed")]
        Some(Packing::Mcap) => {
            let mut lines = MessageLines::new(inner);
            Box::new(PieceReader::new(move |piece: &mut Vec<u8>| lines.fill(piece)))
        }
        Some(packing) => Box::new(BufReader::with_capacity(PIECE, decoder(inner, packing)?)),
    })
}

/// Reads bytes, unpacked if they are packed as gzip or zstd; everything else comes as it is.
///
/// What is packed and not whole gives an error of the kind `UnexpectedEof` where it ends.
///
/// # Errors
/// If the first bytes cannot be read.
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

/// Unpacks a message that is compressed alone, as rosbag2 does in its mode `message`; none if it is not, or has more than
/// [`RECORD`] bytes.
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
        // MCAP is no stream of bytes.
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
