//! `fuseline scenario jaywalking`: a person steps onto the road, and a plan for that may be cached.

mod contingency;
mod geometry;
mod hypotheses;
mod planning;
mod plots;
mod reports;
mod swerve;

use std::io::Write;

use serde::Serialize;

use crate::ScenarioError;
pub(crate) use crate::jaywalking::geometry::{Manoeuvre, SwerveGeometry};
use crate::jaywalking::hypotheses::{HypothesisRow, UnlikelyEvent};
use crate::jaywalking::planning::{PlanCallOutcome, Planning};
use crate::options::{OutputOptions, PageHead, above_0, not_below_0, speed, time};
use crate::plot::Folder;

const HEAD: PageHead = [
    "Person jaywalking",
    "A person walks onto the road just before a car. The planner on board is slow. A plan that the cloud \
    made for this case is ready sooner, from a cache. The plan came by a side request: a gate admitted it, a deadline \
    bounded it, and the machine does not know of it.",
    "The car's and the person's speed, how hard the car swerves and brakes, how fast it steers, and when the \
    side request is made are model choices. The paper states the distance and both responses.",
];

#[derive(clap::Args)]
#[command(after_help = "\
A person walks onto the road just before a car. The planner on board takes the
first response. If a cache has a plan for this case, the car takes the last
response. The cloud makes that plan for a side request: a gate admits it, a
deadline bounds it, and the machine does not know of it. The cache stores the
plan's case and how long it is valid. The car uses the plan only if both match.
The plan is never an output. If it is late, has expired, is for another case or
never comes, the plan on board leaves exactly when it would without a cloud.

Figures marked † are model choices: the paper does not state them. The person
is a disc of radius 0.3 m, starts 1.75 m right of the middle of the car's lane,
and walks to the left. The car that swerves is CommonRoad's single track with
the figures of its vehicle 2, at constant speed. With --steering-rate 100000 its
wheels turn at once.

Exit code 0 when done, 2 if an option or a folder cannot be used.

Examples:
  fuseline scenario jaywalking
  fuseline scenario jaywalking --speed 9,10,11 --distance 12
  fuseline scenario jaywalking --hypothesis car-pulls-out=0.2,person-enters=0.01 --plans-at-once 2
  fuseline scenario jaywalking -o pictures")]
pub(crate) struct Args {
    /// The distance from the car's front to the person's line when the person enters the road, in
    /// m.
    #[arg(long, value_name = "M", default_value = "10", value_parser = above_0)]
    distance: f64,
    /// The speed at which the person walks to the left, in m/s †.
    #[arg(long, value_name = "V", default_value = "1.5", value_parser = not_below_0)]
    person_speed: f64,
    /// The greatest acceleration of the car to the left, in m/s² †.
    #[arg(long, value_name = "A", default_value = "7", value_parser = above_0)]
    lateral: f64,
    /// The speed at which the wheels turn until it swerves so hard, in rad/s †.
    #[arg(long, value_name = "R", default_value = "0.4", value_parser = above_0)]
    steering_rate: f64,
    /// Full braking, in m/s² †.
    #[arg(long, value_name = "A", default_value = "7.5", value_parser = above_0)]
    deceleration: f64,
    /// Responses: the first is that of the planner on board, the last that of a cached plan.
    #[arg(long, value_name = "TIME,TIME,…", value_delimiter = ',', default_value = "500ms,400ms", value_parser = time)]
    response: Vec<f64>,
    /// Speeds of the car, in m/s †.
    #[arg(long, value_name = "V,V,…", value_delimiter = ',', default_value = "9", value_parser = speed)]
    speed: Vec<f64>,
    /// Another event that may happen, for which the plan on board is not made, with its
    /// probability; the likeliest is planned first †.
    #[arg(
        long,
        value_name = "NAME=P,…",
        value_delimiter = ',',
        default_value = "car-pulls-out=0.15,person-enters=0.1,cyclist-swerves=0.06,door-opens=0.04"
    )]
    hypothesis: Vec<UnlikelyEvent>,
    /// The number of plans that may be requested of the cloud at once †.
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u16).range(1..=64))]
    plans_at_once: u16,
    #[command(flatten)]
    leave: OutputOptions,
}

/// The greatest speeds without contact, in m/s.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct Greatest {
    response: f64,
    swerve: Option<f64>,
    brake: Option<f64>,
}

/// A run.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct JaywalkingRun {
    speed: f64,
    /// The outcome of the call for a contingency plan.
    cloud: PlanCallOutcome,
    /// `true` if the cached plan was used.
    cached: bool,
    /// The time from the person's step onto the road until the planner sent the plan for it, in s.
    response: f64,
    manoeuvre: Manoeuvre,
    collides: bool,
}

impl Args {
    const fn geometry(&self) -> SwerveGeometry {
        SwerveGeometry {
            distance: self.distance,
            person_speed: self.person_speed,
            lateral: self.lateral,
            steering_rate: self.steering_rate,
            deceleration: self.deceleration,
        }
    }
}

/// The parameters in force.
#[derive(Clone, Serialize)]
struct JaywalkingParameters {
    speed: Vec<f64>,
    response: Vec<f64>,
    scene: SwerveGeometry,
}

/// Everything that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct JaywalkingResult {
    scenario: &'static str,
    parameters: JaywalkingParameters,
    greatest: Vec<Greatest>,
    runs: Vec<JaywalkingRun>,
    /// The likeliest first.
    hypotheses: Vec<HypothesisRow>,
    /// The mean response to the unlikely events, weighted by probability, in s.
    mean_response: Option<f64>,
}

pub(crate) fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    let [traces, page] = args.leave.folders()?;
    let geometry = args.geometry();
    let greatest = args.response.iter().map(|at| greatest(&geometry, *at)).collect();
    let runs = runs(args, &geometry, traces.as_ref())?;
    let (speed, response) = (args.speed.clone(), args.response.clone());
    let parameters = JaywalkingParameters { speed, response, scene: geometry };
    let hypotheses = hypotheses::rows(args);
    let mean_response = hypotheses::mean_response(&hypotheses);
    let result = JaywalkingResult {
        scenario: "jaywalking",
        parameters,
        greatest,
        runs,
        hypotheses,
        mean_response,
    };
    let shown = (&result, &*reports::reports(&result));
    args.leave.report(out, page, HEAD, shown, || plots::plots(&result, geometry))
}

fn greatest(geometry: &SwerveGeometry, response: f64) -> Greatest {
    Greatest {
        response,
        swerve: geometry.greatest(Manoeuvre::Swerve, response),
        brake: geometry.greatest(Manoeuvre::Brake, response),
    }
}

/// Runs each way in which the side request may end, at each speed.
fn runs(
    args: &Args,
    geometry: &SwerveGeometry,
    traces: Option<&Folder>,
) -> Result<Vec<JaywalkingRun>, ScenarioError> {
    let (Some(planner), Some(cached)) = (args.response.first(), args.response.last()) else {
        return Ok(Vec::new());
    };
    let mut runs = Vec::new();
    for cloud in PlanCallOutcome::ALL {
        let planning = Planning { cloud, planner: *planner, cached: *cached };
        let outcome = planning.run(traces.is_some());
        if let (Some(folder), Some(trace)) = (traces, &outcome.trace) {
            folder.put(&format!("{}.jsonl", cloud.word()), trace)?;
        }
        for speed in &args.speed {
            for manoeuvre in [Manoeuvre::Swerve, Manoeuvre::Brake] {
                let response = outcome.response;
                let collides = geometry.contact(*speed, manoeuvre, response).is_some();
                let cached = outcome.is_cached;
                runs.push(JaywalkingRun {
                    speed: *speed,
                    cloud,
                    cached,
                    response,
                    manoeuvre,
                    collides,
                });
            }
        }
    }
    Ok(runs)
}
