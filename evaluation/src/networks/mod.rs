//! `fuseline scenario networks`: the same vehicle over recorded drives.

mod linked;
mod plots;
mod policy;
mod reports;

use std::time::Duration;

use fuseline_deadline::{Guard, Observation};
use fuseline_testkit::networks::Drive;
use rayon::prelude::*;
use std::io::Write;

use serde::Serialize;

use crate::ScenarioError;
use crate::approach::{self, Vehicle, whole};
use crate::braking::DriveOutcome;
use crate::link::{LinkArgs, LinkWidth, RecordedLink};
use crate::networks::linked::LinkedResponses;
use crate::networks::policy::{OBSERVED, ResponsePolicy, before, deadline, observe};
use crate::operator::ScenarioOperator;
use crate::options::{OutputOptions, PageHead, VehicleArgs, above_0, speed, time};
use crate::plot::Folder;

/// All recorded networks except the wifi, which was hardly ever there.
pub(crate) const DRIVES: &str = "cicv5g/arterial_n78_v80,cicv5g/rural_n8_v0,cicv5g/rural_n8_v10,\
    cicv5g/strong_to_weak_n8_v30,cicv5g/urban_n78_v40,cicv5g/weak_to_strong_n8_v50,\
    vnperf/downtown:verizon,vnperf/downtown:sprint,vnperf/highway:verizon,vnperf/highway:sprint";
/// Spreads the obstacle's place between two captures evenly, however many starts there are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// The greatest number of traces. A user who asks for more has probably made a mistake.
const TRACES: usize = 10_000;

const HEAD: PageHead = [
    "Recorded networks",
    "The vehicle of the traffic jam meets its obstacle at moments all over recorded drives. The cloud's \
    response is its runtime plus the round trip that the drive had when the frame was captured. The policies differ in \
    the source that they wait for, and in how long they wait.",
    "The round trips were measured with small messages, not with frames of 33.3 KB. Ranges, deceleration \
    and the delay of the brakes are model choices. expected looks at the calls of the 30 s before.",
];

#[derive(clap::Args)]
#[command(after_help = "\
The vehicle of the traffic jam meets its obstacle at moments all over recorded
drives. Ten networks are built in: all recorded ones except a wifi that was hardly
ever available. A policy decides who answers: local alone, the cloud alone,
whichever is first, or both with a deadline. The deadline is a constant, the
guard's, or the deadline with the least expected cost, judged by the calls of the
last 30 s.

With --uplink or --downlink frames take time on a link: each waits for the frames
before it, even for those of the 30 s before the start. All frames are sent. A
request that finds no room in the queue is never answered.

Figures marked † are model choices. In JSON, energy is the mean square of the
speed at impact, in m²/s²; a start without a collision counts as 0.

Exit code 0 when done, 2 if an option, a drive or a folder cannot be used.

Examples:
  fuseline scenario networks
  fuseline scenario networks --drive cicv5g/rural_n8_v10 --speed 20,22 --policy local,500ms,guard
  fuseline scenario networks --uplink 10 --downlink 50 --request-kb 33.3
  fuseline scenario networks --drive my-drive.csv --json")]
pub(crate) struct Args {
    /// Recorded drives, or CSV files like them, as fuseline run takes them [default: the ten
    /// networks].
    #[arg(long, value_name = "DRIVE,…", value_delimiter = ',', default_value = DRIVES, hide_default_value = true)]
    drive: Vec<String>,
    /// Speeds, in m/s [default: 11 to 30 in steps of 1].
    #[arg(long, value_name = "V,V,…", value_delimiter = ',', default_value = "11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30", hide_default_value = true, value_parser = speed)]
    speed: Vec<f64>,
    /// The policies: local, cloud, first, a constant deadline such as 500ms, guard, expected.
    #[arg(long, value_name = "WHO,WHO,…", value_delimiter = ',', default_value = "local,cloud,first,500ms,760ms,guard,expected", value_parser = ResponsePolicy::parse)]
    policy: Vec<ResponsePolicy>,
    /// The number of moments, evenly over each drive, at which the obstacle comes into sight.
    #[arg(long, value_name = "N", default_value = "400", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    starts: u32,
    /// The runtime in the cloud; its response is that plus the drive's round trip.
    #[arg(long, value_name = "TIME", default_value = "118.2ms", value_parser = time)]
    cloud_runtime: f64,
    #[command(flatten)]
    link: LinkArgs,
    /// The size of a frame's request, in KB, on a link that has a rate.
    #[arg(long, value_name = "KB", default_value = "33.3", value_parser = above_0)]
    request_kb: f64,
    #[command(flatten)]
    vehicle: VehicleArgs,
    #[command(flatten)]
    leave: OutputOptions,
}

/// The results of a drive, a speed and a policy.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct DriveRow {
    drive: String,
    speed: f64,
    policy: ResponsePolicy,
    starts: u32,
    /// The number of starts that end in a collision.
    collisions: u32,
    /// The mean square of the speed at impact, in m²/s².
    energy: f64,
}

/// A start of the vehicle in a drive, before its speed and policy are chosen.
struct DriveStart<'a> {
    drive: &'a Drive,
    /// The responses of the cloud over a link that has a rate.
    linked: Option<LinkedResponses>,
    start_index: u32,
    at: Duration,
    phase: f64,
    observed: Vec<Observation>,
}

/// The settings that all runs share.
struct Setting<'a> {
    args: &'a Args,
    vehicle: Vehicle,
    guard: Option<Guard>,
    runtime: Duration,
    traces: Option<Folder>,
}

/// The parameters in force.
#[derive(Clone, Serialize)]
struct NetworksParameters {
    drive: Vec<String>,
    speed: Vec<f64>,
    policy: Vec<ResponsePolicy>,
    starts: u32,
    cloud_runtime: f64,
    link: LinkWidth,
    request_kb: f64,
    vehicle: Vehicle,
}

/// Everything that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct NetworksResult {
    scenario: &'static str,
    parameters: NetworksParameters,
    rows: Vec<DriveRow>,
}

pub(crate) fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    let runs = args.drive.len() * args.speed.len() * args.policy.len() * args.starts as usize;
    if args.leave.trace.is_some() && runs > TRACES {
        return Err(ScenarioError::Traces { runs, most: TRACES });
    }
    let drives: Result<Vec<Drive>, _> = args.drive.iter().map(|name| Drive::load(name)).collect();
    let drives = drives?;
    let vehicle = args.vehicle.vehicle();
    let needs_guard = args.policy.iter().any(|mode| mode.is_guarded());
    let guard = needs_guard.then(|| vehicle.guard()).transpose()?;
    let [traces, page] = args.leave.folders()?;
    let runtime = Duration::from_secs_f64(args.cloud_runtime);
    let setting = Setting { args, vehicle, guard, runtime, traces };
    let result = NetworksResult {
        scenario: "networks",
        parameters: args.parameters(),
        rows: setting.rows(&drives)?,
    };
    let shown = (&result, &*reports::reports(&result));
    args.leave.report(out, page, HEAD, shown, || plots::plots(&result))
}

impl Args {
    fn parameters(&self) -> NetworksParameters {
        NetworksParameters {
            drive: self.drive.clone(),
            speed: self.speed.clone(),
            policy: self.policy.clone(),
            starts: self.starts,
            cloud_runtime: self.cloud_runtime,
            link: self.link.width(),
            request_kb: self.request_kb,
            vehicle: self.vehicle.vehicle(),
        }
    }
}

impl Setting<'_> {
    /// Returns each drive's rows, speed by speed and policy by policy.
    fn rows(&self, drives: &[Drive]) -> Result<Vec<DriveRow>, ScenarioError> {
        let mut rows = Vec::new();
        for drive in drives {
            let starts = 0..self.args.starts;
            let ends: Result<Vec<Vec<DriveOutcome>>, ScenarioError> = starts
                .into_par_iter()
                .map(|start_index| self.start(drive, start_index).ends(self))
                .collect();
            let ends = ends?;
            for (column, (speed, policy)) in self.pairs().enumerate() {
                let ends = ends.iter().map(|ends| ends[column]);
                let starts = self.args.starts;
                let collisions = ends.clone().map(|end| u32::from(end.hits())).sum();
                let energy = ends.map(DriveOutcome::energy).sum::<f64>() / f64::from(starts);
                let drive = drive.name().to_owned();
                rows.push(DriveRow { drive, speed, policy, starts, collisions, energy });
            }
        }
        Ok(rows)
    }

    /// Returns each speed with each policy.
    fn pairs(&self) -> impl Iterator<Item = (f64, ResponsePolicy)> {
        let policies = |speed| self.args.policy.iter().map(move |policy| (speed, *policy));
        self.args.speed.iter().copied().flat_map(policies)
    }

    fn start<'a>(&self, drive: &'a Drive, start_index: u32) -> DriveStart<'a> {
        let at = drive.length() * start_index / self.args.starts;
        let phase = (GOLDEN * f64::from(start_index)).fract();
        let linked = self.linked(drive, at);
        let needs = self.args.policy.contains(&ResponsePolicy::Expected);
        let observed = if needs {
            observe(&self.vehicle, |age| match &linked {
                Some(linked) => linked.before(age),
                None => Some(self.runtime + drive.round_trip(before(drive, at, age))?),
            })
        } else {
            Vec::new()
        };
        DriveStart { drive, linked, start_index, at, phase, observed }
    }

    /// Returns the responses of the frames around this start over a link with a rate.
    fn linked(&self, drive: &Drive, at: Duration) -> Option<LinkedResponses> {
        let origin = before(drive, at, OBSERVED);
        let width = self.args.link.width();
        let link = RecordedLink { width, drive: Some((drive, origin)) };
        let slowest = self.args.speed.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = self.vehicle.range_local.max(self.vehicle.range_cloud) / slowest;
        link.is_limited().then(|| {
            LinkedResponses::new(&link, self.vehicle.period(), longest, self.bytes(), |at| {
                Some(whole(self.runtime + drive.round_trip(origin + Duration::from_nanos(at))?))
            })
        })
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10^8")]
    fn bytes(&self) -> u64 {
        (self.args.request_kb * 1e3).round() as u64
    }
}

impl DriveStart<'_> {
    /// Returns how the runs from here end, speed by speed and policy by policy.
    fn ends(&self, setting: &Setting<'_>) -> Result<Vec<DriveOutcome>, ScenarioError> {
        setting.pairs().map(|(speed, mode)| self.end(setting, speed, mode)).collect()
    }

    fn end(
        &self,
        setting: &Setting<'_>,
        speed: f64,
        mode: ResponsePolicy,
    ) -> Result<DriveOutcome, ScenarioError> {
        let situation = setting.vehicle.situation(speed);
        let deadline = deadline(mode, setting.guard.as_ref(), &situation, &self.observed);
        let run = approach::ApproachRun {
            vehicle: &setting.vehicle,
            speed,
            phase: self.phase,
            approach: mode.approach(),
            deadline,
        };
        let traced = setting.traces.as_ref();
        let name = match traced {
            Some(_) => {
                format!(
                    "{mode}, {speed} m/s, {} from start {}",
                    self.drive.name(),
                    self.start_index
                )
            }
            None => String::new(),
        };
        let mut operator = ScenarioOperator::new(&name, run.frames(), traced.is_some());
        let (end, _) = run.run(&mut operator, |at| {
            if let Some(linked) = &self.linked {
                return linked.after(at);
            }
            let trip = self.drive.round_trip(self.at + Duration::from_nanos(at))?;
            Some(whole(setting.runtime + trip))
        });
        if operator.is_full() {
            return Err(ScenarioError::Full { speed });
        }
        if let (Some(folder), Some(trace)) = (traced, operator.into_trace()) {
            let drive: String = self.drive.name().replace(['/', '\\', ':'], "-");
            folder
                .put(&format!("{drive}-v{speed}-{mode}-{:05}.jsonl", self.start_index), &trace)?;
        }
        Ok(end)
    }
}
