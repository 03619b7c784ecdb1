//! Prints which cars collide.

use std::fmt::Write;

use crate::paint::{BAD, GOOD, paint, written};
use crate::paper::PAPER;
use crate::red_light::crossing::WarningSource;
use crate::red_light::{RedLightResult, RedLightRun};

/// The width of a cell.
const CELL: usize = 8;

pub(crate) fn text(result: &RedLightResult) -> String {
    written(|text| {
        table(text, result)?;
        beside(text, result)
    })
}

fn table(text: &mut String, result: &RedLightResult) -> std::fmt::Result {
    let mut deltas: Vec<f64> = Vec::new();
    for run in &result.runs {
        if !deltas.contains(&run.delta) {
            deltas.push(run.delta);
        }
    }
    write!(text, "{:<14}{:>10}", "intersection", "round trip")?;
    for delta in &deltas {
        write!(text, "{:>CELL$}", signed(*delta))?;
    }
    writeln!(text, "  the paper")?;
    writeln!(text, "{}", "─".repeat(24 + CELL * deltas.len() + 12))?;
    let mut rows: Vec<Vec<&RedLightRun>> = Vec::new();
    for run in &result.runs {
        let is_row = |row: &&mut Vec<&RedLightRun>| {
            (row[0].variant, row[0].approach, row[0].round_trip)
                == (run.variant, run.approach, run.round_trip)
        };
        match rows.iter_mut().find(is_row) {
            Some(row) => row.push(run),
            None => rows.push(vec![run]),
        }
    }
    let mut before = None;
    for row in rows {
        let first = row[0];
        if before.replace(first.variant) != Some(first.variant) {
            writeln!(text, "{}", first.variant.intersection().name)?;
        }
        let trip = first.round_trip.map_or("–".to_owned(), |trip| format!("{trip} s"));
        write!(text, "  {:<12}{trip:>10}", first.approach.word())?;
        for run in &row {
            text.push_str(&cell(run));
        }
        writeln!(text, "  {}", paper(first))?;
    }
    writeln!(
        text,
        "\nThe columns say how much later than ego the other car is at its place. A cell\n\
         says how long before 6 s the brakes bite, in s (below 0: after); x if the cars\n\
         touch, and x alone if ego has not braked by then. The paper does not say at\n\
         which round trip shared locations avoid."
    )
}

/// Returns a delta with its sign, if it has one.
fn signed(delta: f64) -> String {
    let delta = if delta == 0.0 { "0".to_owned() } else { format!("{delta:+}") };
    format!("{} s", delta.replace('-', "−"))
}

fn cell(run: &RedLightRun) -> String {
    let (colour, text) = match (run.collides, run.brakes_before) {
        (true, None) => (BAD, "x".to_owned()),
        (true, Some(before)) => (BAD, format!("x {before:.2}")),
        (false, None) => (GOOD, "–".to_owned()),
        (false, Some(before)) => (GOOD, format!("{before:.2}")),
    };
    let text = text.replace('-', "−");
    paint(colour, &format!("{text:>CELL$}"))
}

fn paper(run: &RedLightRun) -> String {
    let printed = &PAPER.red_light.collides;
    let collides = match run.approach {
        WarningSource::Local => printed.local_detector,
        WarningSource::Cloud => printed.cloud_detector,
        WarningSource::Sharing => printed.shared_locations,
    };
    if collides { paint(BAD, "x collides") } else { paint(GOOD, "avoids") }
}

fn beside(text: &mut String, result: &RedLightResult) -> std::fmt::Result {
    let sum = |runs: &[RedLightRun]| {
        let collide = runs.iter().filter(|run| run.collides).count();
        format!("{collide} of {}", runs.len())
    };
    writeln!(
        text,
        "\nIf the detector in the cloud answered at once, {} runs would collide.\n\
         If nothing hid the other car, {} runs with a detector would collide\n\
         (with the cloud's at the shortest round trip).",
        sum(&result.at_once),
        sum(&result.without_occluder)
    )
}
