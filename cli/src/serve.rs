//! `fuseline serve`: serves one emulated cloud for operators elsewhere, or puts a recorded network
//! before a real server.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::grpc::{self, Infer, Remote, RemoteError, ServeError, Token};
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use crate::duration::{ANY, duration};
use crate::emulation::{Emulation, answer};
use crate::exit::Exit;
use crate::fault::{Fault, chain, plain};
use crate::files::{self, FileError};
use crate::forward::{RecordedNetwork, forward};
use crate::interrupt::Interrupt;
use fuseline_evaluation::models::Model;

#[derive(clap::Args)]
#[command(after_help = "\
A reply takes the round trip that the drive had at that moment plus the runtime that the paper
measured, up to 5 % more or less by the seed. The drive begins with the first request.

With --forward it puts the drive in front of a real gRPC server, whatever its service.
It passes calls on unread, and delays each by half of the round trip in either direction.
Clients use this address without TLS instead of the server's.

Examples:
  fuseline serve --listen 0.0.0.0:50051 --model DINO-SWIN-Tiny
  fuseline serve --drive vnperf/highway:sprint --start 150s
  fuseline serve --forward http://127.0.0.1:8001 --drive vnperf/highway:sprint
  fuseline serve --cert server.pem --key server.key --client-ca ca.pem --token-file secret
  fuseline run --cloud name=east,priority=2,model=DINO-SWIN-Tiny,url=http://10.0.0.2:50051")]
pub(crate) struct Args {
    /// The address and port to listen on; port 0 chooses one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50051")]
    listen: SocketAddr,
    /// Forward calls to this server, http://HOST:PORT or https://HOST:PORT, instead of emulating a
    /// model.
    #[arg(long, value_name = "URL", requires = "drive",
        conflicts_with_all = ["model", "seed", "cert", "client_ca", "token_file"])]
    forward: Option<String>,
    /// The model: NAME@orin or NAME@a100. Add ,runtime=TIME and ,ap=AP to replace the paper's
    /// figures, or to describe a model of your own.
    #[arg(long, value_name = "MODEL", default_value = "DETR-ResNet-101@a100")]
    model: Model,
    /// The network to this server: a built-in drive or a CSV file (see fuseline run --help).
    /// If it is not given, a reply takes only the runtime of the model.
    #[arg(long, value_name = "DRIVE")]
    drive: Option<String>,
    /// The time of the drive at which it begins.
    #[arg(long, value_name = "TIME", requires = "drive", value_parser = start,
        allow_hyphen_values = true)]
    start: Option<Duration>,
    /// The seed of the emulated runtime's spread.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// The server's certificate, in PEM; the server then uses TLS.
    #[arg(long, value_name = "FILE", requires = "key")]
    cert: Option<PathBuf>,
    /// The certificate's private key, in PEM.
    #[arg(long, value_name = "FILE", requires = "cert")]
    key: Option<PathBuf>,
    /// The CA certificates that must have signed clients' certificates, in PEM (mutual TLS).
    #[arg(long, value_name = "FILE", requires = "cert")]
    client_ca: Option<PathBuf>,
    /// A file with the bearer token that each call must have; by default the
    /// environment's `FUSELINE_TOKEN`.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

fn start(text: &str) -> Result<Duration, String> {
    duration(text, "62s", &ANY)
}

/// The reason why nothing can be served.
#[derive(Debug, Error)]
enum CannotServe {
    #[error("--listen {address}: {}; choose an address of this host and a free port", plain(.source))]
    Listen { address: SocketAddr, source: io::Error },
    #[error("{}", chain(.0))]
    Serve(ServeError),
    #[error("--forward {url}: {}", chain(.source))]
    Forward { url: String, source: RemoteError },
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
    if let Some(url) = &args.forward {
        return forwarding(args.listen, url, emulation);
    }
    let description = format!("{} (emulated) behind {}", emulation.model, emulation.drive.name());
    answering(args, answer(emulation, Arc::default()), &description)
}

/// Serves calls with `infer`, which `description` describes.
fn answering(args: &Args, infer: impl Infer, description: &str) -> Result<Exit, Fault> {
    let server = grpc::Server {
        identity: files::identity(args.cert.as_deref(), args.key.as_deref())?,
        client_ca: args.client_ca.as_deref().map(files::certificates).transpose()?,
        token: token(args)?,
        bounds: grpc::Bounds::default(),
    };
    let interrupt = Interrupt::watch();
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let ended = runtime.block_on(listen(infer, server, args.listen, description, &interrupt));
    runtime.shutdown_background();
    ended.map(|()| Exit::Conforms)
}

/// Forwards calls to `url` over the emulation's network.
fn forwarding(address: SocketAddr, url: &str, emulation: Emulation) -> Result<Exit, Fault> {
    let description = format!("{url} behind {}", emulation.drive.name());
    let Emulation { drive, start, .. } = emulation;
    let network = RecordedNetwork::new(drive, start);
    let remote = Remote::new(url);
    let interrupt = Interrupt::watch();
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let forwarding = async |listener| {
        let forwarded = forward(&remote, network, listener, interrupt.wait()).await;
        forwarded.map_err(|source| CannotServe::Forward { url: url.to_owned(), source })
    };
    let ended = runtime.block_on(listening(address, "http", &description, &interrupt, forwarding));
    runtime.shutdown_background();
    ended.map(|()| Exit::Conforms)
}

/// Listens at `address`, prints that, and serves calls with `infer` until Ctrl-C.
///
/// # Errors
/// Returns an error if it cannot listen or if the certificates cannot be used.
pub(crate) async fn listen(
    infer: impl Infer,
    server: grpc::Server,
    address: SocketAddr,
    description: &str,
    interrupt: &Interrupt,
) -> Result<(), Fault> {
    let scheme = if server.identity.is_some() { "https" } else { "http" };
    let until_interrupted = async |listener| {
        let ended = grpc::serve(infer, server, listener, interrupt.wait()).await;
        ended.map_err(CannotServe::Serve)
    };
    listening(address, scheme, description, interrupt, until_interrupted).await
}

/// Listens at `address`, prints that, and serves until Ctrl-C.
async fn listening(
    address: SocketAddr,
    scheme: &str,
    description: &str,
    interrupt: &Interrupt,
    serve: impl AsyncFnOnce(TcpListener) -> Result<(), CannotServe>,
) -> Result<(), Fault> {
    let cannot = |source| CannotServe::Listen { address, source };
    let listener = TcpListener::bind(address).await.map_err(cannot)?;
    let address = listener.local_addr().map_err(cannot)?;
    let mut serving = pin!(serve(listener));
    // Unusable certificates or URLs end serving at once.
    tokio::select! {
        biased;
        early = &mut serving => return early.map_err(Fault::from),
        () = tokio::task::yield_now() => {}
    }
    let mut out = io::stdout();
    writeln!(out, "{description} at {scheme}://{address}")
        .and_then(|()| out.flush())
        .map_err(Fault::Output)?;
    tokio::select! {
        late = &mut serving => late.map_err(Fault::from),
        // Calls under way are not awaited, because they may take as long as their network is away.
        () = interrupt.wait() => Ok(()),
    }
}

fn token(args: &Args) -> Result<Option<Token>, FileError> {
    match &args.token_file {
        Some(file) => files::token(file).map(Some),
        None => files::token_of_environment(),
    }
}
