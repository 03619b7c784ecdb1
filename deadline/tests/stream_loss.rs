//! Tests the deadline of least loss in a stream of outputs.

use std::time::Duration;

use fuseline_deadline::{
    BoxDetector, End, Figure, Invalid, Loss, Policy, Situation, Source, StreamLoss, Streaming,
};
use proptest::prelude::*;

const LOCAL: BoxDetector = BoxDetector { accuracy: 70.0, overlap: 0.7 };
const CLOUD: BoxDetector = BoxDetector { accuracy: 95.0, overlap: 0.85 };
const PERIOD_MS: u32 = 140;

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

fn loss_of(speeds: &[f64]) -> StreamLoss<8> {
    let mut loss = StreamLoss::new(LOCAL, CLOUD, ms(PERIOD_MS.into()));
    for speed in speeds {
        loss.moved(*speed);
    }
    loss
}

/// Returns the deadline, in ms, in a world of these speeds, with a cloud whose results take
/// `response` ms.
fn deadline_ms(speeds: &[f64], response: u64) -> u128 {
    let mut policy = Streaming::<8>::new(loss_of(&[]), ms(15), None).unwrap();
    for speed in speeds {
        policy.moved(*speed);
    }
    (0..8).for_each(|_| policy.ended(End::Answered(ms(response))));
    policy.decide(&Situation::UNKNOWN, ms(500)).deadline.as_millis()
}

/// Finds by trial how far a box may move until it no longer counts, from the overlap of two boxes
/// of width 1.
fn slack_by_trying(overlap: f64) -> f64 {
    let offset = |least: f64| {
        (0..=1_000_000)
            .map(|it| f64::from(it) * 1e-6)
            .take_while(move |q| (1.0 - q) / (1.0 + q) >= least)
    };
    offset(0.5).last().unwrap() - offset(overlap).last().unwrap()
}

/// Waiting pays only while nothing moves (T3).
#[test]
fn waits_only_if_nothing_moves() {
    assert_eq!(deadline_ms(&[0.0], 300), 300);
    assert_eq!(deadline_ms(&[2.0], 300), 15);
    assert_eq!(deadline_ms(&[], 300), 300, "nothing is known to move");
    assert_eq!(deadline_ms(&[0.8], 60), 60, "what comes soon is worth it all the same");
}

#[test]
fn forgets_old_speeds_and_ignores_invalid_ones() {
    let change = |from, to| deadline_ms(&[[from; 8], [to; 8]].concat(), 300);
    assert_eq!(change(2.0, 0.0), 300);
    assert_eq!(change(0.0, 2.0), 15);
    assert_eq!(deadline_ms(&[0.0, f64::NAN, -3.0, f64::INFINITY], 300), 300);
    assert_eq!(loss_of(&[0.4, f64::NAN]), loss_of(&[0.4]));
}

#[test]
fn a_box_counts_until_it_has_moved_on_by_its_slack() {
    for (source, detector) in [(Source::Local, LOCAL), (Source::Cloud, CLOUD)] {
        let slack = slack_by_trying(detector.overlap);
        for speed in [0.1, 0.3, 0.7, 1.5] {
            for response in [10, 80, 200, 450_u32] {
                // Computes the share by its definition: the part of the instants in force at which
                // the box still counts.
                let counts = |at: &u32| speed * f64::from(response + at) / 1e3 <= slack;
                let count: f64 = (0..PERIOD_MS).filter(counts).map(|_| 1.0).sum();
                let share = count / f64::from(PERIOD_MS);
                let loss = loss_of(&[speed]).loss(&Situation::UNKNOWN, source, ms(response.into()));
                let expected = CLOUD.accuracy - detector.accuracy * share;
                assert!(
                    (loss - expected).abs() < 1.0,
                    "{source:?} {speed} {response}: {loss}, {expected}"
                );
            }
        }
    }
}

/// An impossible detector is refused (T7).
#[test]
fn a_detector_that_could_not_be_is_refused() {
    let made = |local: BoxDetector, period| {
        Streaming::<8>::new(StreamLoss::new(local, CLOUD, period), ms(15), None).err()
    };
    let implausible = |figure, value| Some(Invalid::Implausible { figure, value });
    assert_eq!(made(LOCAL, ms(140)), None);
    let overlap = BoxDetector { overlap: 0.4, ..LOCAL };
    assert_eq!(made(overlap, ms(140)), implausible(Figure::Overlap, 0.4));
    let accuracy = BoxDetector { accuracy: f64::INFINITY, ..LOCAL };
    assert_eq!(made(accuracy, ms(140)), implausible(Figure::AccuracyLocal, f64::INFINITY));
    assert_eq!(made(LOCAL, Duration::ZERO), implausible(Figure::PeriodLocal, 0.0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn waiting_never_costs_less_nor_does_a_faster_world(
        speeds in prop::collection::vec(0.0..3.0_f64, 0..12),
        (response, more) in (0..600_u64, 0..600_u64),
        faster in 1.0..3.0_f64,
    ) {
        let cost = |speeds: &[f64], response| {
            loss_of(speeds).loss(&Situation::UNKNOWN, Source::Cloud, ms(response))
        };
        let now = cost(&speeds, response);
        prop_assert!((0.0..=CLOUD.accuracy).contains(&now));
        prop_assert!(cost(&speeds, response + more) >= now);
        let scaled: Vec<f64> = speeds.iter().map(|speed| speed * faster).collect();
        prop_assert!(cost(&scaled, response) >= now - 1e-9);
    }
}
