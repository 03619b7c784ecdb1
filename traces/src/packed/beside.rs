//! Unpacking in threads of their own, while what is unpacked is read.

use std::io::{self, BufRead};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

#[cfg(feature = "packed")]
use crate::packed::messages::{MessageLines, blocks};
use crate::packed::pieces::{PieceReader, ReadPieces};
use crate::packed::{Packing, decoder};

/// How many pieces wait to be read, before unpacking waits.
const WAITING: usize = 4;

/// Reads a trace's lines as [`unpack`](crate::packed::unpack) does, and unpacks beside the reader: in a thread, of MCAP in two,
/// the first of which unpacks the chunks and the second makes lines of the messages. A plain trace needs none.
///
/// The threads end with what is packed, or soon after what is returned here is dropped.
///
/// # Errors
/// If the first bytes cannot be read, or there can be no thread.
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

/// Pieces that a thread fills.
struct UnpackingThread {
    pieces: Receiver<io::Result<Vec<u8>>>,
    /// Memory that was used before needs no pages of the system.
    spare: SyncSender<Vec<u8>>,
    /// None once it has ended.
    thread: Option<JoinHandle<()>>,
}

impl UnpackingThread {
    /// A thread with what fills pieces, which says false at the end.
    fn new<F: FnMut(&mut Vec<u8>) -> io::Result<bool>>(
        name: &str,
        make: impl FnOnce() -> io::Result<F> + Send + 'static,
    ) -> io::Result<Self> {
        let (filled, pieces) = sync_channel(WAITING);
        let (spare, used) = sync_channel(WAITING + 2);
        let thread = thread::Builder::new().name(name.to_owned());
        let thread = thread.spawn(move || match make() {
            Ok(fill) => send(fill, &filled, &used),
            // Without a reader nobody wants to know.
            Err(error) => drop(filled.send(Err(error))),
        })?;
        Ok(Self { pieces, spare, thread: Some(thread) })
    }

    /// Puts the next piece in the place of one that was read; false at the end.
    fn next(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        let Ok(filled) = self.pieces.recv() else {
            piece.clear();
            // One that has panicked has not come to the end.
            let ended = self.thread.take().map_or(Ok(()), JoinHandle::join);
            ended.unwrap_or_else(|panic| resume_unwind(panic));
            return Ok(false);
        };
        let read = std::mem::replace(piece, filled?);
        // Where there is no room for it, it is not needed.
        drop(self.spare.try_send(read));
        Ok(true)
    }
}

/// Fills pieces until the end, an error, or nobody reads any more.
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
