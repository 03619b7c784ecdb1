//! The paper's experiments, in virtual time. The physics is stated, and the shipped machine
//! decides.
//!
//! `fuseline scenario` parses [`Args`] and calls [`play`]. The command also uses the paper's
//! [`models`], the [`link`] of a vehicle, the charts of [`plot`], and the format of a
//! [`duration`](mod@duration).

mod approach;
mod arbitrage;
mod braking;
pub mod duration;
mod jaywalking;
pub mod link;
pub mod models;
mod networks;
mod operator;
mod options;
mod paper;
mod planner;
pub mod plot;
mod reaction;
mod red_light;
mod report;
mod shape;
#[cfg(test)]
mod tests;
mod traffic_jam;

use std::io::{self, Write};

use fuseline_deadline::Invalid;
use fuseline_testkit::networks::DriveError;
use thiserror::Error;

pub use crate::paper::{TripQuantiles, paper_round_trips};
use crate::plot::FolderError;

/// The scenario that is played, and its options.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    scenario: ScenarioCommand,
}

#[derive(clap::Subcommand)]
enum ScenarioCommand {
    /// Stop behind a standing motorcycle: the paper's table of 90 cells.
    TrafficJam(traffic_jam::Args),
    /// A car runs a red light and is hidden until late; vehicles may share their locations.
    RedLight(red_light::Args),
    /// A person steps onto the road; a plan may be ready for that.
    Jaywalking(jaywalking::Args),
    /// The vehicle of the traffic jam over recorded networks, policies side by side.
    Networks(networks::Args),
    /// The same models on board and in the cloud: who has a result first.
    Arbitrage(arbitrage::Args),
}

/// The reason a scenario cannot be played.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// A figure of the vehicle makes no sense.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// The window of the operator is too small.
    #[error(
        "at {speed} m/s more than 1024 frames are open at once; lower --rate or the deadline, or raise --speed"
    )]
    Full {
        /// In m/s.
        speed: f64,
    },
    /// The folder would get too many traces.
    #[error(
        "{runs} runs would leave as many traces, but at most {most} are allowed; choose fewer with \
         --drive, --speed, --policy or --starts"
    )]
    Traces {
        /// The number of runs that are wanted.
        runs: usize,
        /// The greatest number of traces that a folder takes.
        most: usize,
    },
    /// A drive cannot be read.
    #[error(transparent)]
    Drive(#[from] DriveError),
    /// A folder or a file in it cannot be written.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The result cannot be printed.
    #[error("standard output: {0}")]
    Output(io::Error),
}

/// Plays a scenario and prints its result.
///
/// # Errors
/// Returns an error if the options make no sense, or something cannot be read or written.
pub fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    match &args.scenario {
        ScenarioCommand::TrafficJam(args) => traffic_jam::play(args, out),
        ScenarioCommand::RedLight(args) => red_light::play(args, out),
        ScenarioCommand::Jaywalking(args) => jaywalking::play(args, out),
        ScenarioCommand::Networks(args) => networks::play(args, out),
        ScenarioCommand::Arbitrage(args) => arbitrage::play(args, out),
    }
}
