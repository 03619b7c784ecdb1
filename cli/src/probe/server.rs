//! `fuseline probe --serve`: answers at once.

use std::io::{self, Write};

use fuseline_tokio::grpc::{self, Reply, Request};
use thiserror::Error;
use tokio::net::TcpListener;

use crate::emulation::REPLY_BYTES;
use crate::fault::{Fault, chain, plain};
use crate::interrupt::Interrupt;
use crate::probe::options::Args;

/// A reply's payload; nobody looks into it.
static REPLY: [u8; REPLY_BYTES] = [0; REPLY_BYTES];

/// Why nobody is answered.
#[derive(Debug, Error)]
enum CannotServe {
    #[error("--listen {address}: {}; choose an address of this machine and a free port", plain(.source))]
    Listen { address: std::net::SocketAddr, source: io::Error },
    #[error("{}", chain(.0))]
    Serve(grpc::ServeError),
}

impl From<CannotServe> for Fault {
    fn from(error: CannotServe) -> Self {
        Self::own(error)
    }
}

/// Serves until Ctrl-C.
///
/// # Errors
/// If it cannot listen, or a file that it is described with is of no use.
pub(crate) async fn serve(args: &Args, interrupt: &Interrupt) -> Result<(), Fault> {
    let server = args.server()?;
    let listen = |source| CannotServe::Listen { address: args.listen, source };
    let listener = TcpListener::bind(args.listen).await.map_err(listen)?;
    let address = listener.local_addr().map_err(listen)?;
    let scheme = if server.identity.is_some() { "https" } else { "http" };
    let mut out = io::stdout();
    writeln!(out, "probes are answered at {scheme}://{address}")
        .and_then(|()| out.flush())
        .map_err(Fault::Output)?;
    let answer = |_: Request| async { Ok(Reply { payload: REPLY.as_slice().into() }) };
    tokio::select! {
        ended = grpc::serve(answer, server, listener, interrupt.wait()) => {
            ended.map_err(|error| CannotServe::Serve(error).into())
        }
        () = interrupt.wait() => Ok(()),
    }
}
