//! `fuseline scenario`: the paper's evaluation in virtual time, from stated physics.

mod approach;
mod arbitrage;
mod braking;
mod jaywalking;
mod networks;
mod operator;
mod options;
mod paint;
mod paper;
mod planner;
mod reaction;
mod red_light;
mod shape;
#[cfg(test)]
mod tests;
mod traffic_jam;

use fuseline_deadline::Invalid;
use thiserror::Error;

use crate::exit::Exit;
use crate::fault::Fault;
use crate::remedy::options;

#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    scenario: ScenarioCommand,
}

#[derive(clap::Subcommand)]
enum ScenarioCommand {
    /// Stop behind a standing motorcycle: the paper's table of 90 cells.
    TrafficJam(traffic_jam::Args),
    /// A car runs a red light, hidden until it is late; vehicles may share where they are.
    RedLight(red_light::Args),
    /// A person steps onto the road; a plan for that may be at hand.
    Jaywalking(jaywalking::Args),
    /// The vehicle of the traffic jam over recorded networks, policies side by side.
    Networks(networks::Args),
    /// The same models on board and in the cloud: who has a result first.
    Arbitrage(arbitrage::Args),
}

/// Why a scenario cannot be played.
#[derive(Debug, Error)]
pub(crate) enum ScenarioError {
    #[error("{invalid}; change {}", options(*.invalid))]
    Invalid { invalid: Invalid },
    #[error(
        "at {speed} m/s more than 1024 frames are open at once; lower --rate or the deadline, or raise --speed"
    )]
    Full { speed: f64 },
    #[error(
        "{runs} runs would leave as many traces, and {most} are the most; name fewer with --drive, --speed, --policy or \
         --starts"
    )]
    Traces { runs: usize, most: usize },
}

impl From<ScenarioError> for Fault {
    fn from(error: ScenarioError) -> Self {
        Self::own(error)
    }
}

/// Plays a scenario.
pub(crate) fn play(args: &Args) -> Result<Exit, Fault> {
    match &args.scenario {
        ScenarioCommand::TrafficJam(args) => traffic_jam::play(args)?,
        ScenarioCommand::RedLight(args) => red_light::play(args)?,
        ScenarioCommand::Jaywalking(args) => jaywalking::play(args)?,
        ScenarioCommand::Networks(args) => networks::play(args)?,
        ScenarioCommand::Arbitrage(args) => arbitrage::play(args)?,
    }
    Ok(Exit::Conforms)
}
