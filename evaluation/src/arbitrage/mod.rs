//! `fuseline scenario arbitrage`: the paper's runtimes on board, against round trip and runtime in
//! the cloud.

mod plots;
mod reports;

use std::io::Write;

use serde::Serialize;

use crate::ScenarioError;
use crate::networks::DRIVES;
use crate::options::{OutputOptions, PageHead};
use crate::paper::{PAPER, TripQuantiles};
use fuseline_testkit::networks::Drive;

const HEAD: PageHead = [
    "Arbitrage",
    "The same model runs on the vehicle's computer, and in the cloud behind a round trip. Where the cloud is \
    first, it could even run a larger model.",
    "The runtimes and the quantiles of the round trip are the paper's. The shares come from ten recorded \
    networks, whose messages were small.",
];

#[derive(clap::Args)]
#[command(after_help = "\
For each of the paper's models: its runtime on board, its runtime in the cloud,
how many times faster that is, and the longest round trip at which the cloud still
has its result first. The last column is the share of the recorded networks, by
time, for which that holds; p50, p90 and p99 are the paper's round trips.

Exit code 0 when done, 2 if an option, a drive or a folder cannot be used.

Examples:
  fuseline scenario arbitrage
  fuseline scenario arbitrage --drive my-drive.csv -o pictures")]
pub(crate) struct Args {
    /// Recorded drives, or CSV files like them, as fuseline run takes them [default: ten networks].
    #[arg(long, value_name = "DRIVE,…", value_delimiter = ',', default_value = DRIVES, hide_default_value = true)]
    drive: Vec<String>,
    #[command(flatten)]
    leave: OutputOptions,
}

/// A model on board and in the cloud. All times are in milliseconds.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct ArbitrageRow {
    model: String,
    on_board: f64,
    in_cloud: f64,
    speedup: f64,
    /// The round trip at which both are equally fast.
    break_even: f64,
    /// Round trip and runtime at the paper's quantiles.
    at_p50: f64,
    at_p90: f64,
    at_p99: f64,
    /// The share of a drive in which the cloud is first, as a mean over the drives.
    first: f64,
}

/// Everything that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct ArbitrageResult {
    scenario: &'static str,
    drives: Vec<String>,
    rows: Vec<ArbitrageRow>,
    /// The least and the greatest human reaction time that the paper cites, in ms.
    human_reaction: [f64; 2],
}

pub(crate) fn play(args: &Args, out: &mut dyn Write) -> Result<(), ScenarioError> {
    let drives: Result<Vec<Drive>, _> = args.drive.iter().map(|name| Drive::load(name)).collect();
    let drives = drives?;
    let [_, page] = args.leave.folders()?;
    let result = result(&drives);
    let shown = (&result, &*reports::reports(&result));
    args.leave.report(out, page, HEAD, shown, || plots::plots(&result))
}

fn result(drives: &[Drive]) -> ArbitrageResult {
    let TripQuantiles { p50, p90, p99 } = PAPER.drive_5g_san_francisco.rtt_ms;
    let rows = PAPER.runtime_ms.iter().map(|row| {
        let (on_board, in_cloud) = (row.orin, row.a100);
        let break_even = on_board - in_cloud;
        let shares: f64 = drives.iter().map(|drive| drive.share_below(break_even / 1e3)).sum();
        #[expect(clippy::cast_precision_loss, reason = "a few drives")]
        let first = shares / drives.len() as f64;
        ArbitrageRow {
            model: row.model.clone(),
            on_board,
            in_cloud,
            speedup: on_board / in_cloud,
            break_even,
            at_p50: p50 + in_cloud,
            at_p90: p90 + in_cloud,
            at_p99: p99 + in_cloud,
            first,
        }
    });
    ArbitrageResult {
        scenario: "arbitrage",
        drives: drives.iter().map(|drive| drive.name().to_owned()).collect(),
        rows: rows.collect(),
        human_reaction: PAPER.human_reaction_s.map(|seconds| seconds * 1e3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speedups_are_those_that_the_paper_prints() {
        let result = result(&[Drive::direct()]);
        let printed = [2.95, 3.45, 5.86, 8.01, 8.43, 8.46];
        for (row, printed) in result.rows.iter().zip(printed) {
            assert!((row.speedup - printed).abs() < 0.0101, "{}: {}", row.model, row.speedup);
            assert!((row.first - 1.0).abs() < 1e-12, "a network that takes no time");
        }
        assert_eq!(result.rows.len(), printed.len());
    }

    #[test]
    fn the_larger_detector_in_the_cloud_is_222_ms_before_it_on_board_at_the_median() {
        let result = result(&[Drive::direct()]);
        let row = result.rows.iter().find(|row| row.model == "DETR-ResNet-101").unwrap();
        assert!((row.on_board - row.at_p50 - 221.5).abs() < 1e-9, "{row:?}");
    }
}
