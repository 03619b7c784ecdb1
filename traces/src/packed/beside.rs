//! Unpacks in separate threads while the unpacked bytes are read.

use std::io::{self, BufRead};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

#[cfg(feature = "packed")]
use crate::packed::messages::{MessageLines, blocks};
use crate::packed::pieces::{PieceReader, ReadPieces};
use crate::packed::{Packing, decoder};

/// The number of pieces that wait to be read before unpacking pauses.
const WAITING: usize = 4;

/// Reads the lines of a trace as [`unpack`](crate::packed::unpack) does, but unpacks in a separate
/// thread.
///
/// An MCAP file uses two threads: the first unpacks the chunks, and the second makes lines of the
/// messages. A plain trace needs no thread. The threads end with the packed bytes, or soon after
/// the returned reader is dropped.
///
/// # Errors
/// Returns an error if the first bytes cannot be read or a thread cannot be started.
pub fn unpack_beside<R: BufRead + Send + 'static>(
    mut inner: R,
) -> io::Result<Box<dyn BufRead + Send>> {
    let pieces = match inner.fill_buf()?.first().copied().and_then(Packing::of) {
        None => return Ok(Box::new(inner)),
        #[cfg(feature = "packed")]
        Some(Packing::Mcap) => {
            let mut records = UnpackingThread::new("unpack", move || Ok(blocks(inner)))?;
            UnpackingThread::new("messages", move || {
                let mut lines = MessageLines::of_blocks(move |block| records.next(block));
                Ok(move |piece: &mut Vec<u8>| lines.fill(piece))
            })?
        }
        Some(packing) => UnpackingThread::new("unpack", move || {
            let mut trace = ReadPieces::new(decoder(inner, packing)?);
            Ok(move |piece: &mut Vec<u8>| trace.fill(piece))
        })?,
    };
    let mut pieces = pieces;
    Ok(Box::new(PieceReader::new(move |piece: &mut Vec<u8>| pieces.next(piece))))
}

/// The pieces that a thread fills.
struct UnpackingThread {
    pieces: Receiver<io::Result<Vec<u8>>>,
    /// Returns used buffers to the thread, since their memory needs no new pages from the system.
    spare: SyncSender<Vec<u8>>,
    /// `None` once the thread has ended.
    thread: Option<JoinHandle<()>>,
}

impl UnpackingThread {
    /// Starts a thread that runs `fill` for each piece until `fill` returns `false`.
    fn new<F: FnMut(&mut Vec<u8>) -> io::Result<bool>>(
        name: &str,
        make: impl FnOnce() -> io::Result<F> + Send + 'static,
    ) -> io::Result<Self> {
        let (filled, pieces) = sync_channel(WAITING);
        let (spare, used) = sync_channel(WAITING + 2);
        let thread = thread::Builder::new().name(name.to_owned());
        let thread = thread.spawn(move || match make() {
            Ok(fill) => send(fill, &filled, &used),
            // Without a reader nobody needs the error.
            Err(error) => drop(filled.send(Err(error))),
        })?;
        Ok(Self { pieces, spare, thread: Some(thread) })
    }

    /// Replaces a piece that was read by the next one. Returns `false` at the end.
    fn next(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        let Ok(filled) = self.pieces.recv() else {
            piece.clear();
            // A thread that has panicked has not come to the end.
            let ended = self.thread.take().map_or(Ok(()), JoinHandle::join);
            ended.unwrap_or_else(|panic| resume_unwind(panic));
            return Ok(false);
        };
        let read = std::mem::replace(piece, filled?);
        // If the channel has no room for the buffer, the buffer is not needed.
        drop(self.spare.try_send(read));
        Ok(true)
    }
}

/// Fills pieces until the end, an error, or the reader is gone.
fn send(
    mut fill: impl FnMut(&mut Vec<u8>) -> io::Result<bool>,
    pieces: &SyncSender<io::Result<Vec<u8>>>,
    used: &Receiver<Vec<u8>>,
) {
    loop {
        let mut piece = used.try_recv().unwrap_or_default();
        let filled = match fill(&mut piece) {
            Ok(true) => Ok(piece),
            Ok(false) => return,
            Err(error) => Err(error),
        };
        let is_last = filled.is_err();
        if pieces.send(filled).is_err() || is_last {
            return;
        }
    }
}
