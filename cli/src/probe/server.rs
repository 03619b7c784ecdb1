//! `fuseline probe --serve`: answers at once.

use fuseline_tokio::grpc::{Reply, Request};

use crate::fault::Fault;
use crate::interrupt::Interrupt;
use crate::probe::options::Args;
use crate::serve::listen;
use fuseline_evaluation::models::REPLY_BYTES;

/// A reply's payload; nobody looks into it.
static REPLY: [u8; REPLY_BYTES] = [0; REPLY_BYTES];

/// Serves until Ctrl-C.
///
/// # Errors
/// If it cannot listen, or a file that it is described with is of no use.
pub(crate) async fn serve(args: &Args, interrupt: &Interrupt) -> Result<(), Fault> {
    let answer =
        |_: Request| async { Ok(Reply { payload: REPLY.as_slice().into(), ..Reply::default() }) };
    listen(answer, args.server()?, args.listen, "answers to probes", interrupt).await
}
