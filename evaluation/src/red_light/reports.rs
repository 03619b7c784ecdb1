//! Reports which cars collide, intersection by intersection.

use crate::paper::PAPER;
use crate::red_light::crossing::WarningSource;
use crate::red_light::{RedLightResult, RedLightRun};
use crate::report::{Cell, Report};

pub(crate) fn reports(result: &RedLightResult) -> Vec<Report> {
    let of_variant = result.runs.len() / result.parameters.variant.len();
    let mut reports: Vec<Report> =
        result.runs.chunks(of_variant).map(|runs| intersection(result, runs)).collect();
    let sum = |runs: &[RedLightRun]| {
        let collide = runs.iter().filter(|run| run.collides).count();
        format!("{collide} of {}", runs.len())
    };
    let notes = [
        "The columns say how much later than ego the other car is at its place. A cell says how \
        long before 6 s the brakes bite, in s (below 0: after). A cell with x says that the cars \
        touch, and x alone that ego has not braked by then. The paper does not say at which round \
        trip shared locations avoid."
            .to_owned(),
        format!(
            "If the detector in the cloud answered at once, {} runs would collide. If nothing hid \
            the other car, {} runs with a detector would collide (with the cloud's at the \
            shortest round trip).",
            sum(&result.at_once),
            sum(&result.without_occluder)
        ),
    ];
    if let Some(last) = reports.last_mut() {
        last.notes.extend(notes);
    }
    reports
}

/// Reports the runs of one intersection, which come delta by delta.
fn intersection(result: &RedLightResult, runs: &[RedLightRun]) -> Report {
    let deltas = &result.parameters.delta;
    let of_delta = runs.len() / deltas.len();
    let rows = runs[..of_delta].iter().enumerate().map(|(index, run)| {
        let trip = run.round_trip.map_or("–".to_owned(), |trip| format!("{trip} s"));
        let mut row = vec![run.approach.word().into(), trip.into()];
        row.extend(runs.iter().skip(index).step_by(of_delta).map(cell));
        row.push(paper(run));
        row
    });
    let mut columns = vec!["source".into(), "round trip".into()];
    columns.extend(deltas.iter().map(|delta| Cell::from(signed(*delta))));
    columns.push("the paper".into());
    let title = Some(runs[0].variant.intersection().name.to_owned());
    Report { title, columns, rows: rows.collect(), notes: Vec::new() }
}

/// Returns a delta with its sign, if it has one.
fn signed(delta: f64) -> String {
    let delta = if delta == 0.0 { "0".to_owned() } else { format!("{delta:+}") };
    format!("{} s", delta.replace('-', "−"))
}

fn cell(run: &RedLightRun) -> Cell {
    let text = match (run.collides, run.brakes_before) {
        (true, None) => "x".to_owned(),
        (true, Some(before)) => format!("x {before:.2}"),
        (false, None) => "–".to_owned(),
        (false, Some(before)) => format!("{before:.2}"),
    };
    Cell::rated(!run.collides, text.replace('-', "−"))
}

fn paper(run: &RedLightRun) -> Cell {
    let printed = &PAPER.red_light.collides;
    let collides = match run.approach {
        WarningSource::Local => printed.local_detector,
        WarningSource::Cloud => printed.cloud_detector,
        WarningSource::Sharing => printed.shared_locations,
    };
    Cell::rated(!collides, if collides { "collides" } else { "avoids" })
}
