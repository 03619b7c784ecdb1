//! `fuseline scenario traffic-jam`: the paper's table. `cells` computes it, `narrow` varies it,
//! `reports` and `plots` show it.

mod cells;
mod narrow;
mod plots;
mod reports;
#[cfg(test)]
pub(crate) mod tests_of_cells;

use std::time::Duration;

use std::io::Write;

use serde::Serialize;

use crate::ScenarioError;
use crate::approach::{Approach, Vehicle};
use crate::options::{OutputOptions, PageHead, VehicleArgs, speed, time};
use crate::traffic_jam::cells::{Cell, CellParameters, DeadlineChoice, Jam};
use crate::traffic_jam::narrow::{CloudOnlySpeeds, Constants, Interval, OnBoardCells};

const HEAD: PageHead = [
    "Traffic jam",
    "A vehicle approaches a standing motorcycle at constant speed. It brakes once enough consecutive \
    frames report it. Local sees less far than the cloud, and the network delays the cloud's results. The \
    shipped machine decided every output, in virtual time. Every ending follows from the outputs and the stated physics.",
    "Ranges, deceleration and the delay of the brakes are model choices: the paper drove in CARLA and \
    does not state them.",
];

#[derive(clap::Args)]
#[command(after_help = "\
A vehicle approaches a standing motorcycle at constant speed, in virtual time.
Each frame of its camera is a message of an operator, and the shipped machine
makes every decision. The vehicle brakes once the outputs of three consecutive
frames report the obstacle (--frames). The obstacle stands at 8 places between
two frames, or at 40 with --local-serial. A cell avoids or collides if it does so
at all places; otherwise it is mixed.

Figures marked † are model choices: the paper drove in CARLA and does not state
them. Metres and seconds. A response counts from a frame's capture: it contains
the runtime and the round trip.

Exit code 0 when done, 2 if an option or a folder cannot be used.

Examples:
  fuseline scenario traffic-jam
  fuseline scenario traffic-jam --approach ours --deadline 500ms
  fuseline scenario traffic-jam --local-serial --cells-only --json
  fuseline scenario traffic-jam -o pictures --trace traces && fuseline check traces/*.jsonl")]
pub(crate) struct Args {
    /// Speeds, in m/s.
    #[arg(long, value_name = "V,V,…", value_delimiter = ',', default_value = "11,18,20,22,24", value_parser = speed)]
    speed: Vec<f64>,
    /// Responses of the cloud, from a frame's capture to its result.
    #[arg(long, value_name = "TIME,TIME,…", value_delimiter = ',', default_value = "500ms,750ms,1s,1.25s,1.5s,3s", value_parser = time)]
    response: Vec<f64>,
    /// The answering source.
    #[arg(
        long,
        value_name = "WHO,WHO,…",
        value_delimiter = ',',
        default_value = "local,cloud,ours"
    )]
    approach: Vec<Approach>,
    /// The deadline of ours: guard, expected, or a constant such as 500ms.
    #[arg(long, value_name = "HOW", default_value = "guard", value_parser = deadline)]
    deadline: DeadlineChoice,
    /// Only the cells: leave out how narrow they are, constant deadlines, and R101 on board.
    #[arg(long)]
    cells_only: bool,
    #[command(flatten)]
    vehicle: VehicleArgs,
    #[command(flatten)]
    leave: OutputOptions,
}

fn deadline(text: &str) -> Result<DeadlineChoice, String> {
    match text {
        "guard" => Ok(DeadlineChoice::Guard),
        "expected" => Ok(DeadlineChoice::Expected),
        text => match time(text) {
            Ok(seconds) => Ok(DeadlineChoice::Constant(Duration::from_secs_f64(seconds))),
            Err(wanted) => Err(format!("write guard, expected or a deadline: {wanted}")),
        },
    }
}

impl Args {
    fn parameters(&self) -> TrafficJamParameters {
        let deadline = match self.deadline {
            DeadlineChoice::Guard => "guard".to_owned(),
            DeadlineChoice::Expected => "expected".to_owned(),
            DeadlineChoice::Constant(deadline) => deadline.as_secs_f64().to_string(),
        };
        TrafficJamParameters {
            speed: self.speed.clone(),
            response: self.response.clone(),
            approach: self.approach.clone(),
            deadline,
            vehicle: self.vehicle.vehicle(),
        }
    }

    fn questions(&self) -> Vec<CellParameters> {
        let mut questions = Vec::new();
        for speed in &self.speed {
            for approach in &self.approach {
                for response in &self.response {
                    let (speed, approach, response) = (*speed, *approach, *response);
                    questions.push(CellParameters { speed, approach, response });
                }
            }
        }
        questions
    }
}

/// The parameters in force.
#[derive(Clone, Serialize)]
struct TrafficJamParameters {
    speed: Vec<f64>,
    response: Vec<f64>,
    approach: Vec<Approach>,
    deadline: String,
    vehicle: Vehicle,
}

/// Everything that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct TrafficJamResult {
    scenario: &'static str,
    parameters: TrafficJamParameters,
    /// The number of places of the obstacle between two frames.
    phases: usize,
    cells: Vec<Cell>,
    #[serde(flatten)]
    beside: Option<ExtraResults>,
}

/// The findings besides the cells.
#[derive(Clone, Serialize)]
struct ExtraResults {
    /// `None` if the paper's table is not reproduced.
    narrow: Option<Vec<Interval>>,
    constants: Constants,
    on_board: Vec<OnBoardCells>,
    only_cloud: Option<CloudOnlySpeeds>,
}

impl TrafficJamResult {
    /// Returns `true` if a cell of ours collides faster than local alone, which collides too.
    fn is_harder(&self, cell: &Cell) -> bool {
        let is_local = |other: &&Cell| {
            (other.approach, other.speed, other.response)
                == (Approach::Local, cell.speed, cell.response)
        };
        let local = self.cells.iter().find(is_local).and_then(|local| local.impact);
        let impacts = cell.impact.zip(local);
        cell.approach == Approach::Ours && impacts.is_some_and(|([_, own], [_, local])| own > local)
    }

    /// Returns the number of cells that are as in the paper, and how many it has.
    fn agreement(&self) -> (usize, usize) {
        let known = self.cells.iter().filter(|cell| cell.paper.is_some());
        (known.clone().filter(|cell| cell.is_as_in_paper()).count(), known.count())
    }
}

pub(crate) fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    let vehicle = args.vehicle.vehicle();
    let jam = Jam::new(vehicle, args.deadline)?;
    let [traces, page] = args.leave.folders()?;
    let result = TrafficJamResult {
        scenario: "traffic-jam",
        parameters: args.parameters(),
        phases: jam.phases().len(),
        cells: jam.cells(&args.questions(), traces.as_ref())?,
        beside: (!args.cells_only).then(|| beside(&jam)).transpose()?,
    };
    let shown = (&result, &*reports::reports(&result));
    args.leave.report(out, page, HEAD, shown, || plots::deadlines(&jam).into_iter().collect())
}

fn beside(jam: &Jam) -> Result<ExtraResults, ScenarioError> {
    Ok(ExtraResults {
        narrow: narrow::intervals(jam),
        constants: narrow::constants(jam.vehicle),
        on_board: narrow::on_board(jam.vehicle)?,
        only_cloud: narrow::only_cloud(jam.vehicle)?,
    })
}
