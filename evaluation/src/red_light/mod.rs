//! `fuseline scenario red-light`: a car runs a red light and is hidden until late. `crossing` is
//! one run.

mod crossing;
mod geometry;
mod plots;
mod reports;
mod sharing;

use rayon::prelude::*;
use std::io::Write;

use serde::Serialize;

use crate::ScenarioError;
use crate::options::{OutputOptions, PageHead, above_0, not_below_0, signed_time, speed, time};
use crate::plot::Folder;
use crate::red_light::crossing::{Crossing, Ego, WarningSource};
pub(crate) use crate::red_light::geometry::{CrossingGeometry, Variant};

const HEAD: PageHead = [
    "Running a red light",
    "A car runs a red light, and something hides it until it is late. No detector sees it in time, \
    neither on board nor in the cloud. If both cars send their locations to a service in the cloud, ego knows of the \
    other car before it can see it, and brakes.",
    "Intersections, speeds and occluders are model choices, and so is the rule by which ego brakes for a \
    neighbour. The paper drove three intersections in CARLA and does not state them.",
];

#[derive(clap::Args)]
#[command(after_help = "\
A car runs a red light and keeps its speed. Something hides it from ego until it
is late. Ego brakes once a detector, on board or in the cloud, has shown the car
on three consecutive frames. With shared locations ego also brakes once the
service's answer says that the car will not stop at its line and that both would
meet. Each car sends its location ten times a second, and the service keeps each
one's last report.

Figures marked † are model choices, and so are the intersections: the paper does
not state its own. In JSON, brakes_before is how long before 6 s the brakes
bite, in s; null if they never do.

Exit code 0 when done, 2 if an option or a folder cannot be used.

Examples:
  fuseline scenario red-light
  fuseline scenario red-light --variant skewed --no-occluder
  fuseline scenario red-light --delta 0s --round-trip 68ms,500ms --json")]
pub(crate) struct Args {
    /// The intersections †.
    #[arg(
        long,
        value_name = "WHICH,…",
        value_delimiter = ',',
        default_value = "corner-building,queue-in-turning-lane,skewed"
    )]
    variant: Vec<Variant>,
    /// Ego's speed, in m/s † [default: the intersection's, 12 or 13].
    #[arg(long, value_name = "V", value_parser = speed)]
    ego_speed: Option<f64>,
    /// The speed of the car that runs the light, in m/s † [default: 14].
    #[arg(long, value_name = "V", value_parser = speed)]
    runner_speed: Option<f64>,
    /// The time by which the other car reaches its place later than ego; below 0 it is earlier.
    #[arg(long, value_name = "TIME,TIME,…", value_delimiter = ',', allow_hyphen_values = true, default_value = "-200ms,-100ms,0s,100ms,200ms", value_parser = signed_time)]
    delta: Vec<f64>,
    /// Round trips between ego and the cloud.
    #[arg(long, value_name = "TIME,TIME,…", value_delimiter = ',', default_value = "68ms,336ms,3.027s", value_parser = time)]
    round_trip: Vec<f64>,
    /// Nothing hides the car.
    #[arg(long)]
    no_occluder: bool,
    /// The range of the detector on board, in m †.
    #[arg(long, value_name = "M", default_value = "39", value_parser = not_below_0)]
    range_local: f64,
    /// The range of the detector in the cloud, in m †.
    #[arg(long, value_name = "M", default_value = "57", value_parser = not_below_0)]
    range_cloud: f64,
    /// From a frame's capture until the result on board.
    #[arg(long, value_name = "TIME", default_value = "301.7ms", value_parser = time)]
    local_response: f64,
    /// The runtime of the detector in the cloud.
    #[arg(long, value_name = "TIME", default_value = "118.2ms", value_parser = time)]
    cloud_runtime: f64,
    /// Full braking, in m/s² †.
    #[arg(long, value_name = "A", default_value = "7.5", value_parser = above_0)]
    deceleration: f64,
    /// The time from the decision until the brakes bite †.
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = time)]
    brake_delay: f64,
    #[command(flatten)]
    leave: OutputOptions,
}

/// A run, as it is shown.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct RedLightRun {
    variant: Variant,
    delta: f64,
    approach: WarningSource,
    /// `None` if there is no cloud.
    round_trip: Option<f64>,
    collides: bool,
    brakes_before: Option<f64>,
    /// The instant at which the cars touch, in s.
    contact: Option<f64>,
}

impl Args {
    const fn ego(&self) -> Ego {
        Ego {
            range_local: self.range_local,
            range_cloud: self.range_cloud,
            local_response: self.local_response,
            cloud_runtime: self.cloud_runtime,
            deceleration: self.deceleration,
            brake_delay: self.brake_delay,
        }
    }

    fn geometry(&self, variant: Variant, delta: f64, has_occluder: bool) -> CrossingGeometry {
        let intersection = variant.intersection();
        CrossingGeometry {
            intersection,
            ego_speed: self.ego_speed.unwrap_or(intersection.ego_speed),
            runner_speed: self.runner_speed.unwrap_or(intersection.runner_speed),
            delta,
            has_occluder,
        }
    }
}

/// The parameters in force.
#[derive(Clone, Serialize)]
struct RedLightParameters {
    variant: Vec<Variant>,
    /// The speed of ego in each variant.
    ego_speed: Vec<f64>,
    /// The speed of the runner in each variant.
    runner_speed: Vec<f64>,
    delta: Vec<f64>,
    round_trip: Vec<f64>,
    no_occluder: bool,
    ego: Ego,
}

/// Everything that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct RedLightResult {
    scenario: &'static str,
    parameters: RedLightParameters,
    runs: Vec<RedLightRun>,
    /// The runs with the detector in the cloud if it answered in no time.
    at_once: Vec<RedLightRun>,
    /// The runs with both detectors if nothing hid the runner. The cloud's runs have the shortest
    /// round trip.
    without_occluder: Vec<RedLightRun>,
}

pub(crate) fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    let [traces, page] = args.leave.folders()?;
    let (ego, has_occluder) = (args.ego(), !args.no_occluder);
    let at_once = Ego { cloud_runtime: 0.0, local_response: 0.0, ..ego };
    let detectors = [WarningSource::Local, WarningSource::Cloud];
    let all = [WarningSource::Local, WarningSource::Cloud, WarningSource::Sharing];
    let trips = &args.round_trip[..];
    let shortest: Vec<f64> = trips.iter().copied().min_by(f64::total_cmp).into_iter().collect();
    let result = RedLightResult {
        scenario: "red-light",
        parameters: args.parameters(),
        runs: args.runs(&ego, &all, trips, has_occluder, traces.as_ref())?,
        at_once: args.runs(&at_once, &[WarningSource::Cloud], &[0.0], has_occluder, None)?,
        without_occluder: args.runs(&ego, &detectors, &shortest, false, None)?,
    };
    let shown = (&result, &*reports::reports(&result));
    args.leave.report(out, page, HEAD, shown, || plots::plots(args, &result))
}

impl Args {
    fn parameters(&self) -> RedLightParameters {
        let geometries = || self.variant.iter().map(|which| self.geometry(*which, 0.0, true));
        RedLightParameters {
            variant: self.variant.clone(),
            ego_speed: geometries().map(|geometry| geometry.ego_speed).collect(),
            runner_speed: geometries().map(|geometry| geometry.runner_speed).collect(),
            delta: self.delta.clone(),
            round_trip: self.round_trip.clone(),
            no_occluder: self.no_occluder,
            ego: self.ego(),
        }
    }

    /// Returns the runs of each variant and delta, approach by approach. An approach with a cloud
    /// runs with each round trip.
    fn runs(
        &self,
        ego: &Ego,
        approaches: &[WarningSource],
        trips: &[f64],
        has_occluder: bool,
        traces: Option<&Folder>,
    ) -> Result<Vec<RedLightRun>, ScenarioError> {
        let mut requested = Vec::new();
        for variant in &self.variant {
            for delta in &self.delta {
                for approach in approaches {
                    let trips = if *approach == WarningSource::Local { None } else { Some(trips) };
                    let trips =
                        trips.map_or(vec![None], |trips| trips.iter().copied().map(Some).collect());
                    requested
                        .extend(trips.into_iter().map(|trip| (*variant, *delta, *approach, trip)));
                }
            }
        }
        let run =
            |(variant, delta, approach, round_trip): (Variant, f64, WarningSource, Option<f64>)| {
                let geometry = self.geometry(variant, delta, has_occluder);
                let trip = round_trip.unwrap_or_default();
                let crossing = Crossing { geometry, ego, approach, round_trip: trip };
                let crossed = crossing.run(&name(&crossing, round_trip), traces)?;
                let (contact, brakes_before) = (crossed.contact, crossed.brakes_before);
                let collides = contact.is_some();
                Ok(RedLightRun {
                    variant,
                    delta,
                    approach,
                    round_trip,
                    collides,
                    brakes_before,
                    contact,
                })
            };
        requested.into_par_iter().map(run).collect()
    }
}

/// Returns the name of a run's files.
fn name(crossing: &Crossing<'_>, round_trip: Option<f64>) -> String {
    let intersection = crossing.geometry.intersection.name.replace(' ', "-");
    let trip = round_trip.map(|trip| format!("-r{trip}")).unwrap_or_default();
    format!("{intersection}-d{}-{}{trip}", crossing.geometry.delta, crossing.approach.word())
}
