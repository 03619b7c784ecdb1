//! `fuseline drive`: another implementation, driven through cases and judged.
//!
//! `case` has the runs, `peer` the process, `trial` compares its decisions with the reference
//! machine's, `runner` drives all cases, `repeat` and `shrink` make a failing run small, and
//! `report` shows the results.

mod case;
mod extent;
mod junit;
mod options;
mod peer;
mod reach;
mod repeat;
mod report;
mod runner;
mod save;
mod shrink;
#[cfg(test)]
mod tests;
mod text;
mod trial;
mod written;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use quick_junit::SerializeError;
use thiserror::Error;

use self::case::Suite;
pub(crate) use self::options::Args;
use self::report::DriveReport;
use self::runner::{CaseRunner, quoted};
use self::trial::DriveStop;
use crate::exit::Exit;
use crate::fault::{Fault, plain};
use crate::output::{self, Output};
use crate::sink::OutputSink;

/// The reason why a command cannot be driven.
#[derive(Debug, Error)]
enum CommandError {
    #[error("--save {}: this is a file; name a folder", .path.display())]
    NoFolder { path: PathBuf },
    #[error("{command:?}: {}; give a program that can be started", plain(.source))]
    Start { command: OsString, source: io::Error },
    #[error(
        "{command}: it ended before it answered the first header ({status}); run it by hand and \
         type a header to see why"
    )]
    Died { command: String, status: ExitStatus },
}

impl From<CommandError> for Fault {
    fn from(error: CommandError) -> Self {
        Self::own(error)
    }
}

/// Drives the command through all cases and reports the results.
pub(crate) fn drive(args: &Args) -> Result<Exit, Fault> {
    let generator = args.generator();
    let suite = if args.run.is_empty() {
        Suite::whole(generator, args.cases.unwrap_or(u64::MAX))?
    } else {
        Suite::of(&args.run, generator)?
    };
    if let Some(folder) = args.save.as_deref().filter(|path| path.exists() && !path.is_dir()) {
        return Err(CommandError::NoFolder { path: folder.to_owned() }.into());
    }
    let junit = junit_file(args, &suite)?;
    let mut driver = CaseRunner::new(args, suite);
    let stopped = match driver.all() {
        Ok(()) => None,
        Err(DriveStop::Interrupted) => {
            driver.report.was_interrupted = true;
            None
        }
        Err(DriveStop::Start(source)) => {
            let command = args.command.first().cloned().unwrap_or_default();
            Some(CommandError::Start { command, source })
        }
        Err(DriveStop::Died(status)) => {
            Some(CommandError::Died { command: quoted(&args.command), status })
        }
    };
    let report = driver.finish();
    if let Some(error) = stopped {
        // Nobody may take an earlier file for this run's.
        put(junit.as_ref(), || junit::error(&report.name, &error.to_string()))?;
        return Err(error.into());
    }
    let written = write(args, junit.as_ref(), &report);
    // The verdict is printed even if files cannot be written.
    let mut out = OutputSink::new(anstream::stdout());
    if args.json {
        let printed = serde_json::to_writer(&mut out, &report.json()).map_err(io::Error::from);
        printed.and_then(|()| writeln!(out)).map_err(Fault::Output)?;
    } else {
        report.print_report(&mut out).map_err(Fault::Output)?;
    }
    written?;
    Ok(report.exit())
}

/// Writes all files.
fn write(args: &Args, junit: Option<&Output>, report: &DriveReport) -> Result<(), Fault> {
    for entry in &report.findings {
        save::save(entry, args.overwrite)?;
    }
    put(junit, || junit::xml(report))
}

fn put(
    output: Option<&Output>,
    xml: impl FnOnce() -> Result<String, SerializeError>,
) -> Result<(), Fault> {
    let Some(output) = output else { return Ok(()) };
    let text = xml().map_err(|error| Fault::Output(io::Error::other(error)))?;
    output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))
}

/// Returns the file of `JUnit`, if one is wanted. No file that is written is one that is read.
fn junit_file(args: &Args, suite: &Suite) -> Result<Option<Output>, Fault> {
    let read: Vec<&Path> = args.run.iter().map(Path::new).collect();
    if let Some(folder) = args.save.as_deref().filter(|_| args.overwrite.force) {
        for path in suite.fixed.iter().flat_map(|case| save::paths(folder, &case.id, 0, true)) {
            output::file(&path, &read, args.overwrite)?;
        }
    }
    args.junit.as_deref().map(|path| Output::new(path, &read, args.overwrite)).transpose()
}
