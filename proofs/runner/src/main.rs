//! Runs the proofs and keeps their ledger. `proofs/prove` finds the engine and starts this program.

mod check;
mod error;
mod kani_engine;
mod ledger;
mod line;
mod mutants;
mod record;
mod run;
mod source;
mod tools;
mod translate;
mod uncatchable;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Parser;

use crate::error::Error;
use crate::run::ProofRun;
use crate::tools::{Limits, STOP};

/// Proves the promises about the machine, and shows that a faulty machine would not pass.
///
/// Each harness is proved, shown to reach its covers and its end, and shown to catch a seeded fault.
/// The exit code is 0 if everything is as it must be, 1 if not (also for a harness without a verdict), 2 if
/// nothing could be asked, and 77 if nothing can run here.
#[derive(Parser)]
#[command(name = "prove", version)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of the command line")]
struct Cli {
    /// Check only these harnesses, without faults unless they are requested.
    #[arg(long, value_name = "NAME")]
    harness: Vec<String>,
    /// Check only the seeded faults; with --harness, the faults as well.
    #[arg(long)]
    faults: bool,
    /// Search again for the harnesses, or those named, that catch each fault, and record them.
    #[arg(long)]
    search: bool,
    /// With --search, only these faults; with --mutants, only those with this text in their names.
    #[arg(long, value_name = "NAME")]
    fault: Vec<String>,
    /// Try each mutant of the façade and of its window that `cargo mutants` lists, with --harness only by the
    /// named ones. An interrupted run continues where it was.
    #[arg(long, conflicts_with_all = ["keep", "sample", "search"])]
    mutants: bool,
    /// Record the harnesses, assertions and covers of the sources.
    #[arg(long)]
    record: bool,
    /// Keep the verdicts in the committed ledger.
    #[arg(long)]
    keep: bool,
    /// Ask only a random sample of the questions that the ledger already answers for these sources and tools:
    /// as many harnesses as took this many seconds, and as many faults. All other questions are asked.
    #[arg(long, value_name = "SECONDS", conflicts_with_all = ["harness", "keep", "search"])]
    sample: Option<u64>,
    /// List what there is to prove, and stop.
    #[arg(long)]
    list: bool,
    /// Print one JSON object on each line.
    #[arg(long)]
    json: bool,
    /// Ask this many questions at once.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: u8,
    /// Limit the checker to this many seconds for one question.
    #[arg(long, value_name = "SECONDS", default_value_t = 1200)]
    time: u64,
    /// Limit the checker to this much memory for one question.
    #[arg(long, value_name = "MIB", default_value_t = 8192)]
    memory: u64,
    /// Ask Kani.
    #[arg(long, hide = true)]
    kani: bool,
    /// The folder of the checker's tools.
    #[arg(long, hide = true, default_value = "/")]
    root: PathBuf,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    // If the system refuses a handler, Ctrl-C ends the command in the usual way.
    let _ = ctrlc::set_handler(|| STOP.store(true, Ordering::Release));
    match act(&cli) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(Error::Interrupted) => ExitCode::from(130),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn act(cli: &Cli) -> Result<bool, Error> {
    let tree = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let sources = source::read(tree)?;
    if cli.list {
        for harness in &sources.harnesses {
            println!(
                "{:8} {}\n         {} Bounds: {}.",
                harness.group, harness.name, harness.says, harness.bounds
            );
        }
        return Ok(true);
    }
    let mut record = record::Record::load(tree)?;
    if cli.record {
        record.take(&sources);
        record.save(tree)?;
        ledger::VerdictLedger::load(tree)?.take(tree, &sources)?;
        return Ok(true);
    }
    let limits = Limits { time: Duration::from_secs(cli.time), memory_mib: cli.memory };
    let run = ProofRun {
        tree,
        root: &cli.root,
        sources: &sources,
        jobs: usize::from(cli.jobs),
        limits,
        json: cli.json,
        keep: cli.keep,
        sample: cli.sample.map(Duration::from_secs),
    };
    if cli.search {
        return run.search(&mut record, &cli.fault, &cli.harness);
    }
    if cli.mutants {
        return run.mutants(&cli.harness, &cli.fault);
    }
    let whole = cli.harness.is_empty();
    if cli.kani {
        let wrong = if whole { record.shrunk(&sources) } else { Vec::new() };
        for line in &wrong {
            eprintln!("{line}");
        }
        let chosen = kani_engine::KaniSelection::new(&sources, &record, &cli.harness)?;
        return Ok(chosen.prove(tree, cli.jobs, cli.time)? && wrong.is_empty());
    }
    if whole {
        let mut wrong = record.shrunk(&sources);
        let ledger = ledger::VerdictLedger::load(tree)?;
        wrong.extend(ledger.differs(&sources));
        eprintln!("{}", ledger.summary(&ledger::digest(tree)?));
        for wrong in &wrong {
            eprintln!("{wrong}");
        }
        if !wrong.is_empty() {
            return Ok(false);
        }
    }
    let mut good = true;
    if !(whole && cli.faults) {
        good &= run.harnesses(&cli.harness)?;
    }
    if cli.faults || whole {
        good &= run.faults(&record, &cli.harness)?;
    }
    Ok(good)
}
