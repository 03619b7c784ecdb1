//! Computes the outcome from a trace's `emit` and `miss` lines and the parameters alone.

use std::collections::BTreeMap;

use fuseline_traces::judge;
use serde_json::Value;

use crate::approach::{Approach, ApproachRun};
use crate::braking::DriveOutcome;
use crate::operator::ScenarioOperator;
use crate::tests::{REFERENCE, drive};
use crate::traffic_jam::tests_of_cells;

/// Returns the output for each timestamp: its instant, and its source or `None` for a miss.
fn outputs(trace: &[u8]) -> BTreeMap<u64, (f64, Option<u64>)> {
    let lines = str::from_utf8(trace).unwrap().lines();
    let of = |line: &str| {
        let line: Value = serde_json::from_str(line).unwrap();
        let source = match line["ev"].as_str()? {
            "emit" => line["p"].as_u64(),
            "miss" => None,
            _ => return None,
        };
        Some((line["t"].as_u64()?, (line["at"].as_f64()? / 1e9, source)))
    };
    lines.filter_map(of).collect()
}

/// Returns when the vehicle decides: the earliest instant by which some three consecutive
/// timestamps with an output have all reported.
fn decided(drive: &ApproachRun<'_>, outputs: &BTreeMap<u64, (f64, Option<u64>)>) -> Option<f64> {
    let mut best: Option<f64> = None;
    for first in outputs.keys() {
        let (mut reports, mut latest, mut next) = (0, 0.0_f64, *first);
        for (t, (at, source)) in outputs.range(first..) {
            if *t != next {
                break;
            }
            next += 1;
            latest = latest.max(*at);
            let Some(source) = source else { continue };
            #[expect(clippy::cast_precision_loss, reason = "some hundreds of frames")]
            let gap = drive.start() - drive.speed * *t as f64 / 30.0;
            let range = if *source == 0 { 39.0 } else { 57.0 };
            if !(0.0 < gap && gap <= range) {
                break;
            }
            reports += 1;
            if reports == 3 {
                best = Some(best.map_or(latest, |best| best.min(latest)));
                break;
            }
        }
    }
    best
}

#[test]
fn the_outcome_follows_from_what_was_emitted_and_the_strict_judge_accepts_it() {
    let mut hits = 0;
    for speed in [11.0, 18.0, 20.0, 22.0, 24.0] {
        for approach in [Approach::Local, Approach::Cloud, Approach::First, Approach::Ours] {
            for response in [500_000_000, 1_000_000_000, 3_000_000_000] {
                let deadline = tests_of_cells::guard(&REFERENCE, speed);
                let drive = ApproachRun { deadline, ..drive(&REFERENCE, speed, 0.4375, approach) };
                let mut operator = ScenarioOperator::new("a run", drive.frames(), true);
                let (end, _) = drive.run(&mut operator, |_| Some(response));
                let trace = operator.into_trace().unwrap();
                let verdict = judge("a run", &trace[..]).unwrap();
                assert!(verdict.violations.is_empty() && verdict.judged > 2, "{verdict:?}");
                // By hand: 0.1 s until the brakes bite, then 7.5 m/s².
                let braked = decided(&drive, &outputs(&trace))
                    .map_or(f64::NEG_INFINITY, |at| drive.start() - speed * (at + 0.1));
                let remaining = braked - speed * speed / 15.0;
                match end {
                    DriveOutcome::Stops { gap } => assert!((gap - remaining).abs() < 1e-6),
                    DriveOutcome::Hits { impact } => {
                        hits += 1;
                        let by_hand =
                            if braked <= 0.0 { speed } else { (-15.0 * remaining).sqrt() };
                        assert!((impact - by_hand).abs() < 1e-6, "{impact}, not {by_hand}");
                    }
                }
            }
        }
    }
    assert!((10..50).contains(&hits), "{hits}");
}
