//! `fuseline deadline`: shows which deadline is safe at a speed, and which one is worth the wait.
//!
//! `fuseline-deadline` has the policies. This module has the options, the observations and the
//! table.

use std::fmt;
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

use csv::{ReaderBuilder, Trim};
use fuseline_deadline::{
    Assessment, Case, Choice, Classes, Guard, Hazard, Impact, Invalid, Loss, Metres,
    MetresPerSecond, MetresPerSecondSquared, Observation, Parameters, Situation, Source, Span,
    Survival, least_loss, mean_loss,
};
use fuseline_traces::rows::{TableError, TableReader};
use serde::Serialize;
use thiserror::Error;

use crate::diagnostics::options_at_fault;
use crate::duration::{ANY, duration};
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::sink::OutputSink;
use crate::table::table;

/// The columns of a file of observations. The last one is optional.
const COLUMNS: [&str; 3] = ["response_s", "answered", "count"];

#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "\
Figures are in metres and seconds. Give a figure that is not known exactly as LEAST..GREATEST; the end
that keeps the guarantee is used. The vehicle brakes when three frames in a row report an obstacle at
rest. Every frame goes to local and to the cloud, outputs leave at most 5 ms after they are due, and the
vehicle keeps 2 m from the obstacle if local alone stops.

guard is the longest safe deadline: the vehicle hits no obstacle that it would not hit with local
alone. This assumes that local sees the obstacle from its range on, and that the cloud reports whatever
local would:
  case 1  local alone certainly stops: as long as that remains true
  case 2  local alone certainly does not stop: as long as the cloud might
  case 3  neither is certain: no later than local alone
expected is the deadline of least mean loss up to guard. The loss is the square of the speed at impact,
in m²/s². With --class it is the mean over the classes, by weight.

--calls is CSV with the columns response_s, answered and, optionally, count. If answered is 1, the
result came after response_s. If it is 0, the call was given up then, or failed if response_s is inf.
Without --calls every call counts as late.

Exit code 0 when done, 2 if a figure is not plausible.

Examples:
  fuseline deadline --speed 11,18,20,22,24
  fuseline deadline --speed 22 --deceleration 7..8 --local-response 280ms..320ms
  fuseline deadline --speed 18,22 --policy expected --calls calls.csv --json"
)]
pub(crate) struct Args {
    /// The speeds, in m/s.
    #[arg(long, required = true, value_name = "V,V,…", value_delimiter = ',', value_parser = speed)]
    speed: Vec<f64>,
    /// The policy that chooses the deadline.
    #[arg(long, default_value = "guard")]
    policy: PolicyArgument,
    /// A file with the outcomes of the cloud's calls; - is standard input.
    #[arg(long, value_name = "FILE")]
    calls: Option<PathBuf>,
    /// The deceleration of full braking, in m/s².
    #[arg(long, value_name = "A", default_value = "7.5", value_parser = deceleration)]
    deceleration: Span<MetresPerSecondSquared>,
    /// The time from the decision to brake until the brakes act.
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = time)]
    brake_delay: Span<Duration>,
    /// The rate of the camera's frames, in Hz.
    #[arg(long, value_name = "HZ", default_value = "30", value_parser = rate)]
    rate: Span<f64>,
    /// The distance from which local begins to report an obstacle, in m.
    #[arg(long, value_name = "M", default_value = "39", value_parser = distance)]
    range_local: Span<Metres>,
    /// The distance from which the cloud begins to report an obstacle, in m.
    #[arg(long, value_name = "M", default_value = "57", value_parser = distance)]
    range_cloud: Span<Metres>,
    /// The time from a frame's capture until local's result.
    #[arg(long, value_name = "TIME", default_value = "301.7ms", value_parser = time)]
    local_response: Span<Duration>,
    /// The nearest place from which something may come into sight, in m [default: none].
    #[arg(long, value_name = "M", value_parser = reveal)]
    reveal: Option<Metres>,
    /// A class of hazards, with its weight and both ranges in m, instead of the two ranges;
    /// repeatable.
    #[arg(
        long,
        value_name = "WEIGHT,RL,RC",
        conflicts_with_all = ["range_local", "range_cloud"],
        value_parser = hazard
    )]
    class: Vec<Hazard>,
    /// Print one JSON object for each speed, a line each, in seconds: speed, `budget_local`,
    /// `budget_cloud`, case, guard, deadline, loss.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum PolicyArgument {
    /// The longest deadline that is safe.
    Guard,
    /// The safe deadline of least mean loss.
    Expected,
}

/// The reason why there is no deadline to show.
#[derive(Debug, Error)]
enum DeadlineError {
    #[error("{invalid}; change {options}")]
    Invalid { invalid: Invalid, options: &'static str },
    #[error("{file}: there are no calls below the first row; give some, or omit --calls")]
    Nothing { file: String },
    #[error("{file}:{line}: {message}")]
    Row { file: String, line: u64, message: String },
}

impl From<DeadlineError> for Fault {
    fn from(error: DeadlineError) -> Self {
        Self::own(error)
    }
}

/// The figures for one speed.
#[derive(Serialize)]
struct SpeedRow {
    speed: f64,
    budget_local: f64,
    budget_cloud: f64,
    case: u8,
    guard: f64,
    deadline: f64,
    loss: f64,
    #[serde(skip)]
    why: Case,
}

/// Shows a deadline for each speed.
pub(crate) fn print_report(args: &Args) -> Result<Exit, Fault> {
    let guard = guard(args).map_err(|invalid| {
        let options = options_at_fault(invalid);
        // If there are classes, the ranges come from them.
        let is_class = !args.class.is_empty() && options.starts_with("--range");
        DeadlineError::Invalid { invalid, options: if is_class { "--class" } else { options } }
    })?;
    for speed in &args.speed {
        let implausible =
            |invalid| DeadlineError::Invalid { invalid, options: options_at_fault(invalid) };
        args.situation(*speed).check().map_err(implausible)?;
    }
    let observed = match &args.calls {
        Some(path) => {
            let (name, file) = open(path)?;
            read(&name, file)?
        }
        None => Vec::new(),
    };
    let rows = args.speed.iter().map(|speed| SpeedRow::new(args, &guard, &observed, *speed));
    let mut out = OutputSink::new(anstream::stdout());
    if args.json {
        for row in rows {
            serde_json::to_writer(&mut out, &row)
                .map_err(io::Error::from)
                .and_then(|()| writeln!(out))
                .map_err(Fault::Output)?;
        }
    } else {
        let rows: Vec<SpeedRow> = rows.collect();
        writeln!(out, "{}", DeadlineTable { args, rows: &rows }).map_err(Fault::Output)?;
    }
    Ok(Exit::Conforms)
}

impl Args {
    fn situation(&self, speed: f64) -> Situation<'static> {
        Situation { reveal: self.reveal, ..Situation::at(MetresPerSecond(speed)) }
    }
}

fn guard(args: &Args) -> Result<Guard, Invalid> {
    let Args { deceleration, brake_delay, range_local, range_cloud, local_response, .. } = *args;
    let [shortest, longest] = [args.rate.greatest, args.rate.least].map(Span::of_rate);
    let period = Span::new(shortest.least, longest.greatest);
    let classes = match &args.class[..] {
        [] => Hazard { weight: 1.0, range_local, range_cloud }.into(),
        classes => Classes::new(classes)?,
    };
    Guard::new(Parameters {
        deceleration,
        brake_delay,
        period_local: period,
        period_cloud: period,
        local_response,
        classes,
        ..Parameters::default()
    })
}

impl SpeedRow {
    fn new(args: &Args, guard: &Guard, observed: &[Observation], speed: f64) -> Self {
        let situation = args.situation(speed);
        let Assessment { budget_local, budget_cloud, case, deadline: cap } =
            guard.judge(&situation);
        let impact = Impact::from(guard);
        let loss = |source: Source, response| impact.loss(&situation, source, response);
        let steps = Survival::new(observed.iter().copied(), &[]);
        let Choice { deadline, loss } = match args.policy {
            PolicyArgument::Guard => {
                let (_, local_response) = guard.local_response();
                Choice { deadline: cap, loss: mean_loss(steps, local_response, cap, loss) }
            }
            PolicyArgument::Expected => least_loss(steps, guard.local_response(), cap, loss),
        };
        Self {
            speed,
            budget_local,
            budget_cloud,
            case: case.number(),
            guard: cap.as_secs_f64(),
            deadline: deadline.as_secs_f64(),
            loss,
            why: case,
        }
    }
}

struct DeadlineTable<'a> {
    args: &'a Args,
    rows: &'a [SpeedRow],
}

impl fmt::Display for DeadlineTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let header = ["speed", "local until", "cloud until", "guard", "deadline", "loss", "case"];
        let cells = |row: &SpeedRow| {
            let case = match row.why {
                Case::LocalStops => "1: local alone stops",
                Case::CloudAlone => "2: the cloud alone might",
                Case::Unsure => "3: no later than local",
            };
            let [local, cloud, guard, deadline] =
                [row.budget_local, row.budget_cloud, row.guard, row.deadline]
                    .map(|seconds| format!("{seconds:.4} s"));
            let (speed, loss) = (format!("{} m/s", row.speed), format!("{:.1}", row.loss));
            [speed, local, cloud, guard, deadline, loss, case.to_owned()]
        };
        writeln!(f, "{}\n", table(header, self.rows.iter().map(cells), 0..6))?;
        f.write_str(
            "Until: how long after capture a result of local or of the cloud still suffices to stop. Guard is\n\
            the longest safe deadline. The loss is the mean square of the speed at impact, in m²/s².",
        )?;
        if self.args.calls.is_none() {
            f.write_str(
                "\nNothing was observed, so every call counts as late; give --calls FILE.",
            )?;
        }
        Ok(())
    }
}

/// Returns the observations in a file, sorted.
pub(crate) fn read(file: &str, inner: impl Read) -> Result<Vec<Observation>, Fault> {
    let fault = |line, message| DeadlineError::Row { file: file.to_owned(), line, message };
    let broken = |error: TableError| fault(error.line, error.to_string());
    let mut rows = TableReader::new(inner, ReaderBuilder::new().trim(Trim::All));
    let names = rows.names().map_err(broken)?;
    let places = COLUMNS.map(|column| names.iter().position(|name| name == column));
    let [Some(response), Some(answered), count] = places else {
        let missing = if places[0].is_none() { COLUMNS[0] } else { COLUMNS[1] };
        let message = format!("there is no column {missing:?}; name it in the first row");
        return Err(fault(1, message).into());
    };
    let mut observed = Vec::new();
    while let Some((line, row)) = rows.next_row().map_err(broken)? {
        let cell = |index: usize| row.get(index).unwrap_or_default();
        let wrong = |column, text: &str, wanted| {
            fault(line, format!("column {column:?}: {text:?} is {wanted}"))
        };
        let is_answered = match cell(answered) {
            "1" => true,
            "0" => false,
            text => return Err(wrong(COLUMNS[1], text, "neither 1 nor 0").into()),
        };
        let text = cell(response);
        let wanted = "not a time in seconds that a call could take";
        let response = match text.parse() {
            Ok(f64::INFINITY) if !is_answered => Ok(Duration::MAX),
            Ok(seconds) => Duration::try_from_secs_f64(seconds).map_err(|_| wanted),
            Err(_) => Err(wanted),
        };
        let response = response.map_err(|wanted| wrong(COLUMNS[0], text, wanted))?;
        let count = match count.map(cell) {
            None | Some("") => 1,
            Some(text) => {
                text.parse().map_err(|_| wrong(COLUMNS[2], text, "not a number of calls"))?
            }
        };
        observed.push(Observation { response, is_answered, count });
    }
    if observed.iter().all(|observation| observation.count == 0) {
        return Err(DeadlineError::Nothing { file: file.to_owned() }.into());
    }
    observed.sort_by_key(Observation::key);
    Ok(observed)
}

/// Reads `FIGURE` or `LEAST..GREATEST`.
fn span(text: &str) -> Result<Span<f64>, String> {
    let (least, greatest) = text.split_once("..").unwrap_or((text, text));
    match (least.parse(), greatest.parse()) {
        (Ok(least), Ok(greatest)) => Ok(Span::new(least, greatest)),
        _ => Err("write a number, or LEAST..GREATEST such as 7.2..7.7".to_owned()),
    }
}

fn deceleration(text: &str) -> Result<Span<MetresPerSecondSquared>, String> {
    Ok(span(text)?.map(MetresPerSecondSquared))
}

fn distance(text: &str) -> Result<Span<Metres>, String> {
    Ok(span(text)?.map(Metres))
}

/// Reads `TIME` or `LEAST..GREATEST`.
fn time(text: &str) -> Result<Span<Duration>, String> {
    let (least, greatest) = text.split_once("..").unwrap_or((text, text));
    let read = |text| duration(text, "0.3s", &ANY);
    Ok(Span::new(read(least)?, read(greatest)?))
}

/// Reads `WEIGHT,RL,RC`.
fn hazard(text: &str) -> Result<Hazard, String> {
    let wrong = "write WEIGHT,RL,RC such as 1,39,57";
    let cells: Vec<&str> = text.split(',').collect();
    let [weight, local, cloud] = cells[..] else { return Err(wrong.to_owned()) };
    let weight = weight.parse().map_err(|_| wrong)?;
    Ok(Hazard { weight, range_local: distance(local)?, range_cloud: distance(cloud)? })
}

fn rate(text: &str) -> Result<Span<f64>, String> {
    let rate = span(text)?;
    let is_rate = rate.least > 0.0 && rate.greatest.is_finite();
    is_rate.then_some(rate).ok_or_else(|| "write a number of Hz above 0".to_owned())
}

fn speed(text: &str) -> Result<f64, String> {
    let speed: Option<f64> = text.parse().ok();
    let speed = speed.filter(|speed| speed.is_finite() && *speed > 0.0);
    speed.ok_or_else(|| "write a number of m/s above 0".to_owned())
}

fn reveal(text: &str) -> Result<Metres, String> {
    let reveal: Option<f64> = text.parse().ok();
    let reveal = reveal.filter(|reveal| reveal.is_finite() && *reveal >= 0.0);
    reveal.map(Metres).ok_or_else(|| "write a number of metres, 0 or more".to_owned())
}
