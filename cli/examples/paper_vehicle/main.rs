//! The paper's vehicle: two cameras and a localization, detection with two clouds, tracking with one and a state that goes
//! along, prediction, planning with contingency plans beside, and control at 20 Hz, under one end-to-end deadline of 500 ms.
//!
//! Networks are recorded ones; runtimes are emulated, and so is what is computed. Time is virtual: equal options give equal
//! lines. Run it with `cargo run -p fuseline --example paper_vehicle -- --kill west-detector`.

mod drive;
mod operators;
mod world;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use fuseline_tokio::Error;
use tokio::runtime::Builder;

use crate::drive::{Driven, Figures, Options, drive};
use crate::operators::Mode;
use crate::world::VehiclePart;

/// Drives the paper's vehicle on board, with the cloud, and with both.
#[derive(Parser)]
struct Cli {
    /// How long each drive is, in seconds.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(10..=3600))]
    seconds: u64,
    /// Kill this part halfway; `each` kills one after the other, in a drive of its own.
    #[arg(long, value_name = "PART")]
    kill: Option<String>,
    /// Write the traces of the drive with both into this folder, one an operator; of `each` into a folder for each part.
    #[arg(long, value_name = "FOLDER")]
    traces: Option<PathBuf>,
    /// Follow this frame; by default one of 12 s, or of 2 s after a part died.
    #[arg(long)]
    frame: Option<u64>,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(cli: &Cli) -> Result<(), Error> {
    let length = Duration::from_secs(cli.seconds);
    let kills: Vec<Option<VehiclePart>> = match cli.kill.as_deref() {
        None => vec![None],
        Some("each") => VehiclePart::ALL.map(Some).into(),
        Some(name) => {
            let part = VehiclePart::ALL.into_iter().find(|part| part.name() == name);
            let known = VehiclePart::ALL.map(VehiclePart::name).join(", ");
            vec![Some(part.ok_or_else(|| format!("--kill {name}: it is one of {known}, each"))?)]
        }
    };
    println!("runtimes and values are emulated; networks are recorded");
    println!(
        "{:24} {:>12} {:>11} {:>8} {:>7} {:>5} {:>5}",
        "", "commands", "within", "age p50", "p99", "AP", "stops"
    );
    let are_several = kills.len() > 1;
    for part in kills {
        let folder = |folder: &PathBuf| match part {
            Some(part) if are_several => folder.join(part.name()),
            _ => folder.clone(),
        };
        let traces = cli.traces.as_ref().map(folder);
        if let Some(folder) = &traces {
            std::fs::create_dir_all(folder)?;
        }
        let second_half = part.map(|_| cli.seconds * 10 / 2 + 20);
        let frame = cli.frame.or(second_half).unwrap_or(121);
        for mode in [Mode::Local, Mode::Cloud, Mode::Fusion] {
            let kill = part.map(|part| (part, length / 2));
            let traces = traces.as_deref().filter(|_| mode == Mode::Fusion);
            let options = Options { mode, length, kill, traces, frame };
            let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
            let driven = runtime.block_on(drive(options))?;
            let dead = kill.map_or("", |(part, _)| part.name());
            println!("{}", row(&format!("{mode:?} {dead}"), &driven));
            if mode == Mode::Fusion {
                print_frame(frame, &driven);
            }
        }
    }
    Ok(())
}

/// A line of the table.
fn row(name: &str, driven: &Driven) -> String {
    let Figures { ages, accuracy, stops } = driven.figures();
    let slowest = driven.commands.iter().map(|command| command.took).max();
    let slowest = slowest.map_or(0, |took| took.as_millis());
    let (commands, ticks) = (driven.commands.len(), driven.ticks);
    let [p50, p99] = ages.map(|age| age.as_millis());
    format!(
        "{name:24} {commands:4} of {ticks:4} {slowest:8} ms {p50:5} ms {p99:4} ms {accuracy:5.1} {stops:5}"
    )
}

/// Who detected, and one frame's life.
fn print_frame(frame: u64, driven: &Driven) {
    let by: Vec<_> = driven.detected_by.iter().map(|(by, n)| format!("{by} {n}")).collect();
    println!("  frames detected by: {}", by.join(", "));
    let missing: Vec<_> = driven.missing.iter().map(|(input, n)| format!("{input} {n}")).collect();
    if !missing.is_empty() {
        println!("  missing in sets: {}", missing.join(", "));
    }
    for stage in &driven.life {
        let (from, to) = (stage.taken_in.as_millis(), stage.answered.as_millis());
        println!(
            "  frame {frame}: {:10} from {from:3} to {to:3} ms by {}",
            stage.operator, stage.by
        );
    }
}
