//! `fuseline probe`: measures a network as the paper's drive did, and records it as a drive.

mod client;
mod figures;
mod live;
mod log;
mod options;
mod pace;
mod position;
mod row;
mod server;
mod summary;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use fuseline_tokio::grpc::tonic::Status;
use fuseline_tokio::grpc::{CallError, InferClient, RemoteError, Request, tonic};
use thiserror::Error;
use tokio::runtime::Runtime;
use tokio::time::timeout;

use crate::emulation::REQUEST_BYTES;
use crate::exit::Exit;
use crate::fault::{Fault, chain, plain};
use crate::interrupt::Interrupt;
use crate::output;
use crate::probe::client::{Schedule, drive};
use crate::probe::live::Live;
use crate::probe::log::Log;
use crate::probe::position::Fixes;
use crate::probe::row::Rows;
use crate::probe::summary::Summary;
use crate::sink::Sink;

pub(crate) use crate::probe::options::Args;

/// How long the server may take for its first answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why there is nothing to measure, or nowhere to write it.
#[derive(Debug, Error)]
enum ProbeError {
    #[error("{url}: {}", chain(.source))]
    Remote { url: String, source: RemoteError },
    #[error("{url}: {why}; start `fuseline probe --serve` there first")]
    Silent { url: String, why: String },
    #[error("--gpsd {address}: {}; start gpsd there, or leave it out", plain(.source))]
    Gpsd { address: String, source: io::Error },
    #[error("--csv -: the rows are told as they come; name a file")]
    Stdout,
    #[error("{file}: {}; make room, or name another --csv", plain(.source))]
    Write { file: String, source: csv::Error },
}

impl From<ProbeError> for Fault {
    fn from(error: ProbeError) -> Self {
        Self::own(error)
    }
}

/// Measures, or serves who measures.
pub(crate) fn probe(args: &Args) -> Result<Exit, Fault> {
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let interrupt = Interrupt::watch();
    let ended = if args.serve {
        runtime.block_on(server::serve(args, &interrupt))
    } else {
        runtime.block_on(measure(args, &interrupt))
    };
    // Whatever still runs belongs to calls that were given up.
    runtime.shutdown_background();
    ended.map(|()| Exit::Conforms)
}

async fn measure(args: &Args, interrupt: &Interrupt) -> Result<(), Fault> {
    let url = args.url.as_deref().unwrap_or_default();
    let remote = args.remote(url)?;
    check_csv(&args.csv, args)?;
    let connection = remote.connect();
    let connection =
        connection.map_err(|source| ProbeError::Remote { url: url.to_owned(), source })?;
    let client = InferClient::new(connection);
    let payload = Bytes::from(vec![0; REQUEST_BYTES]);
    tokio::select! {
        reached = reach(client.clone(), payload.clone()) => {
            reached.map_err(|why| ProbeError::Silent { url: url.to_owned(), why })?;
        }
        () = interrupt.wait() => return Ok(()),
    }
    let fixes = positions(args).await?;
    let name = args.csv.display().to_string();
    let unwritten = |source| ProbeError::Write { file: name.clone(), source };
    let file =
        File::create(&args.csv).map_err(|source| Fault::Create { name: name.clone(), source })?;
    let rows = Rows::new(BufWriter::new(file), fixes).map_err(unwritten)?;
    let schedule = Schedule { rate: args.rate, slots: args.slots(), give_up: args.give_up };
    let mut log = Log::new(rows, args.period(), (args.runtime(), args.deadline()));
    let live = Live::new(args);
    let ask = |slot| {
        let (client, payload) = (client.clone(), payload.clone());
        async move { call(client, slot, payload).await.is_ok() }
    };
    let look = (live.period(), |log: &Log<_>, now| live.show(log, now));
    let wrote = drive(&mut log, &schedule, ask, interrupt.wait(), look).await;
    live.end();
    let summary = Summary::new(args, url, &log.figures, interrupt.came());
    tell(&summary, args.json).map_err(Fault::Output)?;
    wrote.map_err(|source| unwritten(source).into())
}

fn tell(summary: &Summary, is_json: bool) -> io::Result<()> {
    let mut out = Sink::new(anstream::stdout());
    if is_json {
        serde_json::to_writer(&mut out, summary)?;
        writeln!(out)
    } else {
        write!(out, "{summary}")
    }
}

/// Whether rows can be written there.
fn check_csv(csv: &Path, args: &Args) -> Result<(), Fault> {
    if crate::input::is_standard(csv) {
        return Err(ProbeError::Stdout.into());
    }
    output::file(csv, &args.files()).map(|_| ())
}

/// Makes a call that does not count; says why it has no answer.
async fn reach(client: InferClient, payload: Bytes) -> Result<(), String> {
    match timeout(PATIENCE, call(client, 0, payload)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(status)) => Err(CallError::from(status).to_string()),
        Err(_) => Err(format!("no answer within {} s", PATIENCE.as_secs())),
    }
}

async fn call(mut client: InferClient, slot: u64, payload: Bytes) -> Result<(), Status> {
    client.infer(tonic::Request::new(Request { timestamp: slot, payload })).await.map(|_| ())
}

/// The positions as they come, if somebody tells them.
async fn positions(args: &Args) -> Result<Fixes, Fault> {
    let fixes = Fixes::default();
    if let Some(address) = &args.gpsd {
        let stream = position::connect(address).await;
        let stream =
            stream.map_err(|source| ProbeError::Gpsd { address: address.clone(), source })?;
        tokio::spawn(position::follow(stream, address.clone(), fixes.clone()));
    }
    if let Some(path) = &args.nmea {
        position::read(path, fixes.clone())
            .map_err(|source| Fault::Open { name: path.display().to_string(), source })?;
    }
    Ok(fixes)
}
