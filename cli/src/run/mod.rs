//! `fuseline run`: runs a camera operator with emulated models behind recorded networks, and judges
//! its trace. `plan` checks the options, `camera` drives the operator, and `report` reads the
//! trace.

mod camera;
mod cloud;
mod config;
mod deadlines;
mod error;
mod metadata;
mod network;
mod plan;
mod progress;
mod queue;
mod report;
mod sent;
pub(crate) mod served;
mod table;

use std::io::{self, Write};

use fuseline_traces::{Doubt, Verdict};
use tokio::runtime::Runtime;

use crate::exit::Exit;
use crate::fault::Fault;
use crate::interrupt::Interrupt;
use crate::output::{Growing, Output};
use crate::run::error::RunError;
use crate::run::network::Network;
use crate::run::plan::{RunPlan, TRACE};
use crate::run::progress::RunProgress;
use crate::run::report::Reading;
use crate::run::table::PlanSummary;
use crate::sink::OutputSink;
use crate::verdict;

pub(crate) use crate::run::plan::Args;
#[cfg(test)]
pub(crate) use crate::run::table::sources_table;

/// Runs what the options say, reports it, and keeps its trace.
pub(crate) fn run(args: &Args) -> Result<Exit, Fault> {
    let mut plan = RunPlan::new(args)?;
    let interrupt = Interrupt::watch();
    let mut out = OutputSink::new(anstream::stdout());
    let runtime = Runtime::new().map_err(Fault::Runtime)?;
    let network = runtime.block_on(Network::connect(&plan))?;
    runtime.block_on(network.describe(&mut plan));
    // From here on no other run writes to this trace.
    let own = Growing::open(args.trace.as_deref(), TRACE, args.overwrite)?;
    own.path().clone_into(&mut plan.trace);
    let name = plan.trace.display().to_string();
    let camera = match runtime.block_on(async { camera::start(&plan, network) }) {
        Ok(camera) => camera,
        Err(fault) => {
            own.discard();
            return Err(fault);
        }
    };
    if !args.json {
        writeln!(out, "{}", PlanSummary(&plan)).map_err(Fault::Output)?;
    }
    let mut live = RunProgress::new(&plan);
    let driven = runtime.block_on(camera.drive(&mut live, &interrupt));
    live.end();
    // Tasks that still run belong to calls that were given up.
    runtime.shutdown_background();

    let reading = Reading::new(&plan.trace, &name, &plan)?;
    let ended_at = reading.ended_at;
    let mut report = reading.report(&plan, &driven);
    let silent = report.silent_clouds();
    report.trace = args.doubted(report.trace, silent.clone());
    if driven.recording_error.is_none() {
        let notes = crate::report::noted_tick(ended_at, &report.notes(&plan));
        own.append(notes.as_bytes())
            .map_err(|source| Fault::Create { name: name.clone(), source })?;
        report.count_noted_line();
    }
    if args.json {
        serde_json::to_writer(&mut out, &report)
            .map_err(io::Error::from)
            .and_then(|()| writeln!(out))
    } else {
        writeln!(out, "{report}")
            .and_then(|()| verdict::print_report(&report.trace, &mut out, 0, false))
    }
    .map_err(Fault::Output)?;
    if let Some(page) = plan.page.as_ref().filter(|_| report.page.is_some()) {
        make(page, &plan, |found| args.doubted(found, silent))?;
        if !args.json {
            writeln!(out, "{}: the page of this run", page.name()).map_err(Fault::Output)?;
        }
    }
    match driven.recording_error {
        Some(why) => Err(RunError::Unrecorded { trace: name, why }.into()),
        None => Ok(verdict::exit(&report.trace)),
    }
}

impl Args {
    /// Returns the verdict with this doubt, if there is one, and with what is accepted.
    fn doubted(&self, found: Verdict, doubt: Option<Doubt>) -> Verdict {
        let found = match doubt {
            Some(doubt) => found.doubting(doubt),
            None => found,
        };
        self.accept.accepted(found)
    }
}

/// Makes the page of the run's trace, and opens it if that is wanted and possible.
fn make(
    page: &Output,
    plan: &RunPlan,
    doubted: impl FnOnce(Verdict) -> Verdict,
) -> Result<(), Fault> {
    crate::report::of(&plan.trace, page, doubted)?;
    if plan.open
        && let Err(error) = open::that_detached(page.name())
    {
        eprintln!("warning: no browser opens {}: {error}", page.name());
    }
    Ok(())
}
