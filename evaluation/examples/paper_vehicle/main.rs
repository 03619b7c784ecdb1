//! The paper's vehicle under one end-to-end deadline of 500 ms. It has two cameras and a
//! localization. Detection has two clouds, and tracking has one and sends its state along.
//! Prediction and planning follow, with contingency plans beside them, and then control at 20 Hz.
//!
//! The boxes, the runtimes of detection and the networks are recorded; everything else is emulated.
//! Time is virtual, so equal options give equal output. Run it with
//! `cargo run -p fuseline-evaluation --example paper_vehicle -- --kill west-detector`.

mod drive;
mod operators;
mod recording;
mod score;
mod world;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use fuseline_tokio::Error;
use tokio::runtime::Builder;

use crate::drive::{Driven, HEAD, Options, drive};
use crate::operators::Rule;
use crate::recording::Recording;
use crate::world::VehiclePart;

/// Drives the paper's vehicle on board, with clouds, and by each commit rule.
#[derive(Parser)]
struct Cli {
    /// The length of each drive, in seconds.
    #[arg(long, default_value_t = 57, value_parser = clap::value_parser!(u64).range(10..=57))]
    seconds: u64,
    /// Kill this part halfway; `each` kills one after the other, in drives of its own.
    #[arg(long, value_name = "PART")]
    kill: Option<String>,
    /// Write the traces of the eager drive into this folder, one an operator; of `each` into a
    /// folder for each part.
    #[arg(long, value_name = "FOLDER")]
    traces: Option<PathBuf>,
    /// Follow this frame; by default one of 12 s, or of 2 s after a part died.
    #[arg(long)]
    frame: Option<usize>,
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
    let recording = Arc::new(Recording::load()?);
    let kills: Vec<Option<VehiclePart>> = match cli.kill.as_deref() {
        None => vec![None],
        Some("each") => VehiclePart::ALL.map(Some).into(),
        Some(name) => {
            let part = VehiclePart::ALL.into_iter().find(|part| part.name() == name);
            let known = VehiclePart::ALL.map(VehiclePart::name).join(", ");
            vec![Some(part.ok_or_else(|| format!("--kill {name}: it is one of {known}, each"))?)]
        }
    };
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
        let died = part.map(|_| length / 2 + Duration::from_secs(2));
        let frame = recording.newest(died.unwrap_or(Duration::from_secs(12)));
        let frame = cli.frame.unwrap_or(frame);
        println!(
            "{}\n",
            part.map_or("all parts live".into(), |part| format!("{} dies", part.name()))
        );
        println!("{HEAD}|\n|---|---|---|---|---|---|---|");
        let mut all = Vec::new();
        for rule in Rule::ALL {
            let kill = part.map(|part| (part, length / 2));
            let traces = traces.as_deref().filter(|_| rule == Rule::Eager);
            let options = Options { rule, recording: &recording, length, kill, traces, frame };
            let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
            let driven = runtime.block_on(drive(options))?;
            println!("{}", driven.row(rule, &recording));
            all.push((rule, driven));
        }
        println!();
        for (rule, driven) in all {
            print_commands(rule, &driven);
            if rule == Rule::Eager {
                print_frame(frame, &driven);
            }
        }
        println!();
    }
    Ok(())
}

/// Prints who detected, and whether control was in time.
fn print_commands(rule: Rule, driven: &Driven) {
    let slowest = driven.commands.iter().map(|command| command.took).max();
    let slowest = slowest.map_or(0, |took| took.as_millis());
    let by: Vec<_> = driven.detected_by.iter().map(|(by, n)| format!("{by} {n}")).collect();
    let (rule, by) = (rule.name(), by.join(", "));
    let (commands, ticks) = (driven.commands.len(), driven.ticks);
    println!("{rule}: {commands} of {ticks} ticks within {slowest} ms; boxes by {by}");
}

/// Prints how each operator handled this frame.
fn print_frame(frame: usize, driven: &Driven) {
    for stage in &driven.life {
        let (from, to) = (stage.taken_in.as_millis(), stage.answered.as_millis());
        println!(
            "  frame {frame}: {:10} from {from:3} to {to:3} ms by {}",
            stage.operator, stage.by
        );
    }
}
