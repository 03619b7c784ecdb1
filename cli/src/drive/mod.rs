//! `fuseline drive`: another implementation, driven through cases and judged.
//!
//! `case` has the runs, `peer` the process, `trial` compares its decisions with the reference
//! machine's, `runner` drives all cases, `repeat` and `shrink` make a failing run small, and
//! `report` shows the results.

mod case;
mod extent;
mod junit;
mod matrix;
mod options;
mod peer;
mod reach;
mod repeat;
mod report;
mod results;
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
    let generator = args.generate();
    let suite = if args.run.is_empty() {
        Suite::whole(generator, args.cases.unwrap_or(u64::MAX))?
    } else {
        Suite::of(&args.run, generator)?
    };
    if let Some(folder) = args.save.as_deref().filter(|path| path.exists() && !path.is_dir()) {
        return Err(CommandError::NoFolder { path: folder.to_owned() }.into());
    }
    let outputs = DriveOutputs::new(args, &suite)?;
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
        outputs.write_not_started(&report.name, &error.to_string())?;
        return Err(error.into());
    }
    let written = write(args, &outputs, &report);
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
fn write(args: &Args, outputs: &DriveOutputs, report: &DriveReport) -> Result<(), Fault> {
    for entry in &report.findings {
        save::save(entry, args.results.overwrite)?;
    }
    if let Some(output) = &outputs.junit {
        let text = junit::xml(report).map_err(|error| Fault::Output(io::Error::other(error)))?;
        output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))?;
    }
    outputs.results.write(&[results::judged(report)])?;
    for (matrix, output) in args.matrix.iter().zip(&outputs.matrix) {
        let text = matrix.text(report);
        output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))?;
    }
    Ok(())
}

/// The files of the results. None of them is read.
struct DriveOutputs {
    junit: Option<Output>,
    results: crate::results::Outputs,
    matrix: Vec<Output>,
}

impl DriveOutputs {
    fn new(args: &Args, suite: &Suite) -> Result<Self, Fault> {
        let read: Vec<&Path> = args.run.iter().map(Path::new).collect();
        let overwrite = args.results.overwrite;
        if let Some(folder) = args.save.as_deref().filter(|_| overwrite.force) {
            for path in suite.fixed.iter().flat_map(|case| save::paths(folder, &case.id, 0, true)) {
                output::file(&path, &read, overwrite)?;
            }
        }
        let output = |path: &Path| Output::new(path, &read, overwrite);
        Ok(Self {
            junit: args.junit.as_deref().map(output).transpose()?,
            results: args.results.outputs(&read)?,
            matrix: args
                .matrix
                .iter()
                .map(|matrix| output(matrix.path()))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Writes that the command could not be started, so that nobody takes an earlier file for this
    /// run's.
    fn write_not_started(&self, name: &str, why: &str) -> Result<(), Fault> {
        if let Some(output) = &self.junit {
            let text =
                junit::error(name, why).map_err(|error| Fault::Output(io::Error::other(error)))?;
            output.write(|out| out.write_all(text.as_bytes()).map_err(Fault::Output))?;
        }
        self.results.write(&[results::not_started(name, why)])
    }
}
