//! Unpacking in a thread of its own, while what is unpacked is read.

use std::io::{self, BufRead, Read};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use crate::packed::{Packing, unpack};

/// How much is handed over at once, in bytes; a line that is longer comes in several pieces.
const PIECE: usize = 128 * 1024;
/// How many pieces wait to be read, before unpacking waits.
const WAITING: usize = 4;

/// Reads a trace's lines as [`unpack`] does, and unpacks in a thread beside the reader's. A plain trace needs none.
///
/// The thread ends with what is packed, or soon after what is returned here is dropped.
///
/// # Errors
/// If the first bytes cannot be read, or there can be no thread.
pub fn unpack_beside<R: BufRead + Send + 'static>(
    mut inner: R,
) -> io::Result<Box<dyn BufRead + Send>> {
    if inner.fill_buf()?.first().copied().and_then(Packing::of).is_none() {
        return Ok(Box::new(inner));
    }
    let (pieces, unpacked) = sync_channel(WAITING);
    let thread = thread::Builder::new().name("unpack".to_owned());
    let thread = thread.spawn(move || send(inner, &pieces))?;
    Ok(Box::new(UnpackedPieces { unpacked, thread: Some(thread), piece: Vec::new(), taken: 0 }))
}

/// Unpacks until the end, an error, or nobody reads any more.
fn send(inner: impl BufRead, pieces: &SyncSender<io::Result<Vec<u8>>>) {
    let mut trace = match unpack(inner) {
        Ok(trace) => trace,
        // Without a reader nobody wants to know.
        Err(error) => return drop(pieces.send(Err(error))),
    };
    loop {
        let mut piece = Vec::with_capacity(PIECE);
        let filled = fill(&mut piece, &mut trace);
        // What came before an error counts.
        if pieces.send(Ok(piece)).is_err() {
            return;
        }
        match filled {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => return drop(pieces.send(Err(error))),
        }
    }
}

/// Fills a piece; false at the end.
fn fill(piece: &mut Vec<u8>, trace: &mut impl BufRead) -> io::Result<bool> {
    while piece.len() < PIECE {
        match trace.fill_buf() {
            Ok([]) => return Ok(false),
            Ok(bytes) => {
                piece.extend_from_slice(bytes);
                let len = bytes.len();
                trace.consume(len);
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}

/// What the thread has unpacked.
struct UnpackedPieces {
    unpacked: Receiver<io::Result<Vec<u8>>>,
    /// None once it has ended.
    thread: Option<JoinHandle<()>>,
    piece: Vec<u8>,
    taken: usize,
}

impl BufRead for UnpackedPieces {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.taken == self.piece.len() {
            let Ok(piece) = self.unpacked.recv() else {
                // One that has panicked has not come to the end.
                let ended = self.thread.take().map_or(Ok(()), JoinHandle::join);
                ended.unwrap_or_else(|panic| resume_unwind(panic));
                break;
            };
            (self.piece, self.taken) = (piece?, 0);
        }
        Ok(self.piece.get(self.taken..).unwrap_or_default())
    }

    fn consume(&mut self, amount: usize) {
        self.taken = self.piece.len().min(self.taken + amount);
    }
}

impl Read for UnpackedPieces {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.fill_buf()?.read(buffer)?;
        self.consume(len);
        Ok(len)
    }
}
