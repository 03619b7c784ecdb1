//! The options that scenarios share.

use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;

use crate::ScenarioError;
use crate::approach::Vehicle;
use crate::duration::{SHORTEST, duration, seconds};
use crate::plot::{Folder, FolderError, PageContent, Plot, page_of, show};
use crate::report::{self, Report};

/// The heading of a scenario's page, its caption, and the limits of the model.
pub(crate) type PageHead = [&'static str; 3];

/// The output options of a scenario.
#[derive(clap::Args)]
pub(crate) struct OutputOptions {
    /// Print one JSON object with every figure and the parameters in force.
    #[arg(long)]
    json: bool,
    /// Print the tables and notes as Markdown.
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// Leave the trace of each run in this folder, for fuseline check.
    #[arg(long, value_name = "DIR")]
    pub(crate) trace: Option<PathBuf>,
    /// Write plots to this folder, as SVG and PNG on light and dark ground, and a page that holds
    /// them.
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Replace files that exist. Without it a folder that is not empty is refused.
    #[arg(long)]
    force: bool,
}

impl OutputOptions {
    /// Returns the folders for traces and for plots, or `None` for a folder that is not wanted.
    ///
    /// # Errors
    /// Returns an error if a folder cannot be created.
    pub(crate) fn folders(&self) -> Result<[Option<Folder>; 2], FolderError> {
        let open = |path: &Option<PathBuf>| Folder::open(path.as_deref(), self.force);
        Ok([open(&self.trace)?, open(&self.output)?])
    }

    /// Writes the page if its folder is wanted. Prints the result as one JSON object with the
    /// page's path, or the reports as Markdown, or as text with the path, in colour on a terminal.
    /// Only the page needs `plots`.
    ///
    /// # Errors
    /// Returns an error if the folder or standard output cannot be written.
    pub(crate) fn report(
        &self,
        mut out: &mut dyn Write,
        page: Option<Folder>,
        [title, words @ ..]: PageHead,
        (result, reports): (&impl Serialize, &[Report]),
        plots: impl FnOnce() -> Vec<Plot>,
    ) -> Result<(), ScenarioError> {
        if let Some(folder) = page {
            let reported = &report::text(reports);
            let content = PageContent { title, words: &words, plots: plots(), reported };
            show(&folder, &content)?;
        }
        let page = self.output.as_deref().map(page_of);
        let written = if self.json {
            let written = serde_json::to_writer(&mut out, &WithPage { result, page });
            written.map_err(io::Error::from).and_then(|()| writeln!(out))
        } else if self.markdown {
            out.write_all(report::markdown(reports).as_bytes())
        } else {
            let page = page.map(|page| format!("\n{page}: the page\n")).unwrap_or_default();
            write!(out, "{}{page}", report::text(reports))
        };
        written.map_err(ScenarioError::Output)
    }
}

/// A result, and the page that shows it.
#[derive(Serialize)]
struct WithPage<'a, R> {
    #[serde(flatten)]
    result: &'a R,
    page: Option<String>,
}

/// The vehicle; figures marked † are model choices, not the paper's.
#[derive(clap::Args)]
pub(crate) struct VehicleArgs {
    /// Full braking, in m/s² †.
    #[arg(long, value_name = "A", default_value = "7.5", value_parser = above_0)]
    deceleration: f64,
    /// The time from the decision until the brakes bite †.
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = time)]
    brake_delay: f64,
    /// The number of frames that the camera captures a second, in Hz.
    #[arg(long, value_name = "HZ", default_value = "30", value_parser = rate)]
    rate: f64,
    /// The number of consecutive frames that must report the obstacle before the vehicle brakes.
    #[arg(long, value_name = "N", default_value = "3", value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// The distance at which local begins to report the obstacle, in m † [default: 39, with
    /// --local-serial 55.2].
    #[arg(
        long,
        value_name = "M",
        default_value = "39",
        default_value_if("local_serial", "true", "55.2"),
        hide_default_value = true,
        value_parser = not_below_0
    )]
    range_local: f64,
    /// The distance at which the cloud begins to report the obstacle, in m †.
    #[arg(long, value_name = "M", default_value = "57", value_parser = not_below_0)]
    range_cloud: f64,
    /// From a frame's capture until local's result.
    #[arg(long, value_name = "TIME", default_value = "301.7ms", value_parser = time_above_0)]
    local_response: f64,
    /// Local computes one frame at a time and skips those that come meanwhile.
    #[arg(long)]
    local_serial: bool,
    /// The obstacle comes into sight only at this distance, in m, and the guard knows it [default:
    /// none].
    #[arg(long, value_name = "M", value_parser = not_below_0)]
    reveal: Option<f64>,
}

impl VehicleArgs {
    pub(crate) const fn vehicle(&self) -> Vehicle {
        Vehicle {
            deceleration: self.deceleration,
            brake_delay: self.brake_delay,
            rate: self.rate,
            frames: self.frames,
            range_local: self.range_local,
            range_cloud: self.range_cloud,
            local_response: self.local_response,
            local_serial: self.local_serial,
            reveal: self.reveal,
        }
    }
}

/// The longest time that an option takes: a day.
const LONGEST: Duration = Duration::from_secs(86_400);
/// The greatest figure that an option takes. A greater one is a mistaken unit.
const GREATEST: f64 = 1e5;

fn number(text: &str, is_wanted: impl Fn(f64) -> bool, wanted: &str) -> Result<f64, String> {
    let number: Option<f64> = text.trim().parse().ok();
    number.filter(|number| is_wanted(*number)).ok_or_else(|| format!("write a number {wanted}"))
}

pub(crate) fn above_0(text: &str) -> Result<f64, String> {
    number(text, |number| number > 0.0 && number <= GREATEST, "above 0 and up to 100000")
}

pub(crate) fn not_below_0(text: &str) -> Result<f64, String> {
    number(text, |number| (0.0..=GREATEST).contains(&number), "from 0 to 100000")
}

/// Reads a time, in s.
pub(crate) fn time(text: &str) -> Result<f64, String> {
    duration(text, "0.5s", &(Duration::ZERO..=LONGEST)).map(seconds)
}

pub(crate) fn time_above_0(text: &str) -> Result<f64, String> {
    duration(text, "0.5s", &(SHORTEST..=LONGEST)).map(seconds)
}

/// Reads a time that may be negative, in s.
pub(crate) fn signed_time(text: &str) -> Result<f64, String> {
    text.trim().strip_prefix('-').map_or_else(|| time(text), |text| time(text).map(|time| -time))
}

pub(crate) fn speed(text: &str) -> Result<f64, String> {
    number(text, |number| (0.1..=150.0).contains(&number), "of m/s from 0.1 to 150")
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, |number| (0.1..=1000.0).contains(&number), "of Hz from 0.1 to 1000")
}
