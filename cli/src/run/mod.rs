//! `fuseline run`: a camera operator with emulated models behind recorded networks, and its trace
//! judged.

mod camera;
mod cloud;
mod ledger;
mod live;
mod plan;
mod report;
mod table;

use std::io::{self, Write};
use std::path::Path;

use tempfile::{Builder, NamedTempFile};
use tokio::runtime::Runtime;

use crate::Exit;
use crate::fault::Fault;
use crate::interrupt::Interrupt;
use crate::run::live::Live;
use crate::run::plan::Plan;
use crate::run::report::Reading;
use crate::run::table::Introduction;
use crate::sink::Sink;

pub(crate) use crate::run::cloud::{CloudError, seconds};
pub(crate) use crate::run::plan::{Args, PlanError};

/// Runs what the options say, reports it, and keeps its trace.
pub(crate) fn run(args: &Args) -> Result<Exit, Fault> {
    let plan = Plan::new(args)?;
    let name = plan.trace.display().to_string();
    let trace = beside(&plan.trace)
        .map_err(|error| Fault::Create { name: name.clone(), source: error.kind().into() })?;
    let interrupt = Interrupt::watch();
    let mut out = Sink::new(anstream::stdout());
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let camera = runtime.block_on(camera::start(&plan, trace.path()))?;
    if !args.json {
        writeln!(out, "{}", Introduction(&plan)).map_err(Fault::Output)?;
    }
    let mut live = Live::new(&plan);
    let driven = runtime.block_on(camera.drive(&mut live, &interrupt));
    live.end();
    let driven = driven?;
    // Whatever still runs belongs to calls that were given up.
    runtime.shutdown_background();

    let reading = Reading::new(trace.path(), &name, &plan)?;
    trace.persist(&plan.trace).map_err(|error| Fault::Create { name, source: error.error })?;
    let report = reading.report(&plan, &driven);
    if args.json {
        serde_json::to_writer(&mut out, &report)
            .map_err(io::Error::from)
            .and_then(|()| writeln!(out))
    } else {
        writeln!(out, "{report}").and_then(|()| report.trace.tell(&mut out, 0, false))
    }
    .map_err(Fault::Output)?;
    Ok(report.trace.exit())
}

/// A file with a temporary name beside `path`, to be renamed to it once it is whole.
fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let name = path.file_name().ok_or(io::ErrorKind::IsADirectory)?;
    // What a rename would replace must be a trace, neither a directory nor a device.
    match path.metadata() {
        Ok(metadata) if metadata.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
        Ok(metadata) if !metadata.is_file() => return Err(io::ErrorKind::AlreadyExists.into()),
        Ok(_) | Err(_) => {}
    }
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        Some(_) | None => Path::new("."),
    };
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(name);
    builder.prefix(&prefix).suffix(".tmp").tempfile_in(directory)
}
