//! `fuseline serve`: one emulated cloud for operators elsewhere.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::grpc::{self, ServeError, Token};
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use crate::emulation::{Emulation, answer};
use crate::exit::Exit;
use crate::fault::{Fault, chain, plain};
use crate::files::{self, FileError};
use crate::interrupt::Interrupt;
use crate::models::Model;
use crate::seconds::seconds;

#[derive(clap::Args)]
#[command(after_help = "\
A reply takes the round trip that the drive had at that moment plus the runtime that the paper
measured, up to 5 % more or less as the seed says. The drive begins with the first request.

Examples:
  fuseline serve --listen 0.0.0.0:50051 --model DINO-SWIN-Tiny
  fuseline serve --drive vnperf/highway:sprint --start 150
  fuseline serve --cert server.pem --key server.key --client-ca ca.pem --token-file secret
  fuseline run --cloud name=east,priority=2,model=DINO-SWIN-Tiny,url=http://10.0.0.2:50051")]
pub(crate) struct Args {
    /// The address and port to listen on; port 0 chooses one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50051")]
    listen: SocketAddr,
    /// The model, as NAME@orin or NAME@a100.
    #[arg(long, value_name = "MODEL", default_value = "DETR-ResNet-101@a100")]
    model: Model,
    /// The network on the way here: a built-in drive or a CSV file (see fuseline run --help).
    /// Without it a reply takes the runtime alone.
    #[arg(long, value_name = "DRIVE")]
    drive: Option<String>,
    /// Where the drive begins, in seconds.
    #[arg(long, value_name = "S", requires = "drive", value_parser = start,
        allow_negative_numbers = true)]
    start: Option<Duration>,
    /// Decides how the emulated runtime strays.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// The server's certificate, PEM; with it, it speaks TLS.
    #[arg(long, value_name = "FILE", requires = "key")]
    cert: Option<PathBuf>,
    /// The certificate's private key, PEM.
    #[arg(long, value_name = "FILE", requires = "cert")]
    key: Option<PathBuf>,
    /// The certificates, PEM, that clients' must be signed by (mutual TLS).
    #[arg(long, value_name = "FILE", requires = "cert")]
    client_ca: Option<PathBuf>,
    /// A file with the bearer token that each call must bear; else the
    /// environment's `FUSELINE_TOKEN`.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

fn start(text: &str) -> Result<Duration, &'static str> {
    seconds(text, 0.0..=31_536_000.0).ok_or("it must be seconds, 0 or more")
}

/// Why nothing can be served.
#[derive(Debug, Error)]
enum CannotServe {
    #[error("--listen {address}: {}; choose an address of this machine and a free port", plain(.source))]
    Listen { address: SocketAddr, source: io::Error },
    #[error("{}", chain(.0))]
    Serve(ServeError),
}

impl From<CannotServe> for Fault {
    fn from(error: CannotServe) -> Self {
        Self::own(error)
    }
}

/// Serves until Ctrl-C.
pub(crate) fn serve(args: &Args) -> Result<Exit, Fault> {
    let emulation = match &args.drive {
        Some(drive) => {
            let start = args.start.unwrap_or_default();
            Emulation::new(args.model.clone(), drive, start, args.seed)?
        }
        None => Emulation::direct(args.model.clone(), args.seed),
    };
    let server = grpc::Server {
        identity: files::identity(args.cert.as_deref(), args.key.as_deref())?,
        client_ca: args.client_ca.as_deref().map(files::certificates).transpose()?,
        token: token(args)?,
    };
    let interrupt = Interrupt::watch();
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let ended = runtime.block_on(async {
        let listen = |source| CannotServe::Listen { address: args.listen, source };
        let listener = TcpListener::bind(args.listen).await.map_err(listen)?;
        let address = listener.local_addr().map_err(listen)?;
        announce(&emulation, &server, address).map_err(Fault::Output)?;
        let serving =
            grpc::serve(answer(emulation, Arc::default()), server, listener, interrupt.wait());
        tokio::select! {
            ended = serving => ended.map_err(|error| CannotServe::Serve(error).into()),
            // Calls under way may take as long as their network is away.
            () = interrupt.wait() => Ok(()),
        }
    });
    runtime.shutdown_background();
    ended.map(|()| Exit::Conforms)
}

/// Says where the server listens and what it does.
fn announce(emulation: &Emulation, server: &grpc::Server, address: SocketAddr) -> io::Result<()> {
    let scheme = if server.identity.is_some() { "https" } else { "http" };
    let Emulation { model, drive, .. } = emulation;
    let mut out = io::stdout().lock();
    writeln!(out, "{model} (emulated) behind {} at {scheme}://{address}", drive.name())?;
    out.flush()
}

fn token(args: &Args) -> Result<Option<Token>, FileError> {
    match &args.token_file {
        Some(file) => files::token(file).map(Some),
        None => files::token_of_environment(),
    }
}
