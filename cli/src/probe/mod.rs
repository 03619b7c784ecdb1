//! `fuseline probe`: measures a network as the paper's drive did, and records it as a drive.
//!
//! `client` sends, `log` counts and records, `summary` and `plots` show; `server` is the other
//! side.

mod client;
mod figures;
mod log;
mod options;
mod pace;
mod plots;
mod progress;
mod row;
mod server;
mod summary;

use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use fuseline_tokio::grpc::tonic::Status;
use fuseline_tokio::grpc::{CallError, Connection, InferClient, RemoteError, Request, tonic};
use thiserror::Error;
use tokio::runtime::Runtime;
use tokio::time::timeout;

use crate::diagnostics::print_line;
use crate::duration::tenths;
use crate::exit::Exit;
use crate::fault::{Fault, chain, plain};
use crate::interrupt::Interrupt;
use crate::output::{self, Growing};
use crate::probe::client::{Schedule, drive};
use crate::probe::log::ProbeLog;
use crate::probe::progress::ProbeProgress;
use crate::probe::row::SlotRows;
use crate::probe::summary::ProbeSummary;
use crate::run::served::Served;
use crate::sink::OutputSink;
use fuseline_evaluation::models::REQUEST_BYTES;
use fuseline_evaluation::plot::{Folder, page_of};

pub(crate) use crate::probe::options::Args;

/// The default name of the recording.
const RECORDING: &str = "fuseline-probe.csv";
/// The server may take this long for its first answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// The reason why there is nothing to measure, or nowhere to write it.
#[derive(Debug, Error)]
enum ProbeError {
    #[error("{url}: {}", chain(.source))]
    Remote { url: String, source: RemoteError },
    #[error("{url}: {why}; {remedy}")]
    Silent { url: String, why: String, remedy: &'static str },
    #[error(
        "--plot -: the recording is read twice, so it cannot come from standard input; name a file"
    )]
    Stdin,
    #[error(
        "--csv -: the recording cannot go to standard output, where the summary goes; name a file"
    )]
    Stdout,
    #[error("{file}: {}; make room, or name another --csv", plain(.source))]
    Write { file: String, source: csv::Error },
}

impl From<ProbeError> for Fault {
    fn from(error: ProbeError) -> Self {
        Self::own(error)
    }
}

/// Measures, or answers those who do.
pub(crate) fn probe(args: &Args) -> Result<Exit, Fault> {
    if let Some(recording) = &args.plot {
        return again(recording, args).map(|()| Exit::Conforms);
    }
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let interrupt = Interrupt::watch();
    let ended = if args.serve {
        runtime.block_on(server::serve(args, &interrupt))
    } else {
        runtime.block_on(measure(args, &interrupt))
    };
    // Tasks that still run belong to calls that were given up.
    runtime.shutdown_background();
    ended.map(|()| Exit::Conforms)
}

/// Plots what was recorded before.
fn again(recording: &Path, args: &Args) -> Result<(), Fault> {
    if crate::input::is_standard(recording) {
        return Err(ProbeError::Stdin.into());
    }
    let Some((path, folder)) = folder(args)? else { return Ok(()) };
    let files = plots::plot(recording, &folder, None)?;
    OutputSink::new(anstream::stdout())
        .write_all(summary::plotted(path, &files).as_bytes())
        .map_err(Fault::Output)
}

/// Returns the folder for plots, if one is wanted.
fn folder(args: &Args) -> Result<Option<(&Path, Folder)>, Fault> {
    let folder = Folder::open(args.output.as_deref(), args.overwrite.force)?;
    Ok(args.output.as_deref().zip(folder))
}

async fn measure(args: &Args, interrupt: &Interrupt) -> Result<(), Fault> {
    let url = args.url.as_deref().unwrap_or_default();
    let remote = args.remote(url)?;
    if let Some(csv) = &args.csv {
        check_csv(csv, args)?;
    }
    let connection = remote.connect();
    let connection =
        connection.map_err(|source| ProbeError::Remote { url: url.to_owned(), source })?;
    let client = InferClient::new(connection.clone());
    let payload = Bytes::from(vec![0; REQUEST_BYTES]);
    tokio::select! {
        reached = reach(client.clone(), payload.clone(), url.starts_with("https:")) => {
            reached.map_err(|(why, remedy)| ProbeError::Silent { url: url.to_owned(), why, remedy })?;
        }
        () = interrupt.wait() => {
            print_line("interrupted before the first answer; nothing was recorded");
            return Ok(());
        }
    }
    warn_of_model(url, connection).await;
    let folder = folder(args)?;
    let csv = Growing::open(args.csv.as_deref(), RECORDING, args.overwrite)?;
    let name = csv.path().display().to_string();
    let unwritten = |source| ProbeError::Write { file: name.clone(), source };
    let file = csv.empty().map_err(|source| Fault::Create { name: name.clone(), source })?;
    let rows = SlotRows::new(BufWriter::new(file)).map_err(unwritten)?;
    let schedule = Schedule { rate: args.rate, slots: args.slots(), give_up: args.give_up };
    let mut log = ProbeLog::new(rows, args.period(), (args.runtime, args.deadline));
    let live = ProbeProgress::new(args);
    let send_request = |slot| {
        let (client, payload) = (client.clone(), payload.clone());
        async move { call(client, slot, payload).await.is_ok() }
    };
    let look = (live.period(), |log: &ProbeLog<_>, now| live.show(log, now));
    let written = drive(&mut log, &schedule, send_request, interrupt.wait(), look).await;
    live.end();
    let mut summary = ProbeSummary::new((args, csv.path()), url, &log.figures, interrupt.is_set());
    // The summary is printed even if the files cannot be written.
    let written = written.map_err(|source| unwritten(source).into()).and_then(|()| {
        if let Some((path, folder)) = &folder {
            summary.page = Some(page_of(path));
            summary.plots = plots::plot(csv.path(), folder, Some(&summary.to_string()))?;
        }
        Ok(())
    });
    print_report(&summary, args.json).map_err(Fault::Output)?;
    if let Some((path, _)) = folder.filter(|_| !args.json && !summary.plots.is_empty()) {
        let reported = summary::plotted(path, &summary.plots);
        OutputSink::new(anstream::stdout())
            .write_all(reported.as_bytes())
            .map_err(Fault::Output)?;
    }
    written
}

fn print_report(summary: &ProbeSummary, is_json: bool) -> io::Result<()> {
    let mut out = OutputSink::new(anstream::stdout());
    if is_json {
        serde_json::to_writer(&mut out, summary)?;
        writeln!(out)
    } else {
        write!(out, "{summary}")
    }
}

/// Warns where the server answers as late as a model would: that is recorded as the network's time.
async fn warn_of_model(url: &str, connection: Connection) {
    let mut served = Served::default();
    // No difference: nothing was said of it before.
    let _ = served.describe(connection).await;
    let Served { model, runtime, drive, .. } = served;
    if model.is_none() && runtime.is_none() && drive.is_none() {
        return;
    }
    let model = model.unwrap_or_else(|| "a model".to_owned());
    let runtime = runtime
        .map_or_else(String::new, |runtime| format!(", which takes about {}", tenths(runtime)));
    let drive = drive.map_or_else(String::new, |drive| format!(", behind {drive}"));
    print_line(format_args!(
        "warning: {url} serves {model}{runtime}{drive}; the round trips contain that time. To measure the \
         network alone, start `fuseline probe --serve` there"
    ));
}

/// Checks that rows can be written there.
fn check_csv(csv: &Path, args: &Args) -> Result<(), Fault> {
    if crate::input::is_standard(csv) {
        return Err(ProbeError::Stdout.into());
    }
    output::file(csv, &args.files(), args.overwrite).map(|_| ())
}

/// Makes a call that does not count; says why it has no answer, and a remedy.
async fn reach(
    client: InferClient,
    payload: Bytes,
    is_secret: bool,
) -> Result<(), (String, &'static str)> {
    match timeout(PATIENCE, call(client, 0, payload)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(status)) => {
            let is_stranger = status.code() == tonic::Code::Unauthenticated;
            let why = CallError::from(status).to_string();
            let remedy = if is_stranger { TOKEN } else { remedy(is_secret, &why) };
            Err((why, remedy))
        }
        Err(_) => Err((format!("no answer within {} s", PATIENCE.as_secs()), START)),
    }
}

const START: &str = "start `fuseline probe --serve` there first";
const TOKEN: &str = "give the server's token with --token-file";

/// Returns the remedy for a failure, by its text and by whether it was over TLS.
fn remedy(is_secret: bool, why: &str) -> &'static str {
    if why.contains("does not speak TLS") {
        "give an http URL"
    } else if why == CallError::BROKE && !is_secret {
        "if it speaks TLS, give an https URL and --ca"
    } else if why == CallError::BROKE || why.contains("certificate") || why.contains("alert") {
        "give the server's CA with --ca, and --cert and --key if it wants this side's"
    } else {
        START
    }
}

async fn call(mut client: InferClient, slot: u64, payload: Bytes) -> Result<(), Status> {
    let request = Request { timestamp: slot, payload, ..Request::default() };
    client.infer(tonic::Request::new(request)).await.map(|_| ())
}
