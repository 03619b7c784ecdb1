//! Tests what the guard allows, with the specification's figures, in each case, and with any
//! figures.

use std::borrow::Borrow;
use std::time::Duration;

use crate::vehicle::{Drive, Frame};
use fuseline_deadline::{
    Case, Classes, Constant, Guard, Hazard, Invalid, Metres, MetresPerSecond,
    MetresPerSecondSquared, Parameters, Policy, Reason, Situation, Span,
};
use proptest::prelude::*;

fn guard(parameters: impl Borrow<Parameters>) -> Guard {
    Guard::new(*parameters.borrow()).unwrap()
}

fn hazard(range_local: f64, range_cloud: f64) -> Hazard {
    let (range_local, range_cloud) = (Metres(range_local).into(), Metres(range_cloud).into());
    Hazard { weight: 1.0, range_local, range_cloud }
}

fn at(speed: f64) -> Situation<'static> {
    Situation::at(MetresPerSecond(speed))
}

fn secs(least: f64, greatest: f64) -> Span<Duration> {
    Span::new(least, greatest).map(Duration::from_secs_f64)
}

fn braking(least: f64, greatest: f64) -> Span<MetresPerSecondSquared> {
    Span::new(least, greatest).map(MetresPerSecondSquared)
}

fn metres(least: f64, greatest: f64) -> Span<Metres> {
    Span::new(least, greatest).map(Metres)
}

fn local_response() -> Duration {
    Duration::from_micros(301_700)
}

#[test]
fn default_vehicle_has_the_specified_deadlines() {
    let guard = guard(Parameters::default());
    let expected = [
        (11.0, Case::LocalStops, 2.4253),
        (18.0, Case::LocalStops, 0.6506),
        (20.0, Case::LocalStops, 0.3117),
        (22.0, Case::CloudAlone, 0.9192),
        (24.0, Case::CloudAlone, 0.5700),
    ];
    for (speed, case, deadline) in expected {
        let verdict = guard.judge(&at(speed));
        assert_eq!(verdict.case, case, "{speed} m/s");
        // The expected deadlines have four digits, so the difference is rounded to a tenth of a
        // millisecond.
        let off = verdict.deadline.as_secs_f64() - deadline;
        assert!(off.abs() <= 0.000_05, "{speed} m/s: {off} s off");
    }
}

/// If no case is sure, no output may be later than local's (T1).
#[test]
fn between_the_cases_nothing_is_later_than_local() {
    let guard = guard(Parameters::default());
    let cases = [20.0, 20.7, 20.8, 21.0].map(|speed| guard.judge(&at(speed)).case);
    assert_eq!(cases, [Case::LocalStops, Case::Unsure, Case::Unsure, Case::CloudAlone]);
    let unsure = guard.judge(&at(20.8));
    assert_eq!(unsure.deadline, local_response());
}

#[test]
fn useless_cloud_leaves_locals_response() {
    let verdict = guard(Parameters::default()).judge(&at(40.0));
    assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()));
    assert!(verdict.budget_cloud < 0.0);
}

/// A speed that makes no sense leaves only local's response (T7).
#[test]
fn a_speed_that_is_none_leaves_locals_response() {
    let guard = guard(Parameters::default());
    let speeds = [
        Span::exactly(f64::NAN),
        Span::exactly(f64::INFINITY),
        Span::exactly(-1.0),
        Span::exactly(150.1),
        Span::new(21.0, 20.0),
        Span::new(f64::NEG_INFINITY, 20.0),
    ];
    for speed in speeds.map(|speed| speed.map(MetresPerSecond)) {
        let situation = Situation::at(speed);
        assert!(situation.check().is_err(), "{speed:?}");
        let verdict = guard.judge(&situation);
        assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()), "{speed:?}");
    }
    for reveal in [f64::NAN, -1.0, 0.0] {
        let situation = Situation { reveal: Some(Metres(reveal)), ..at(11.0) };
        assert_eq!(guard.judge(&situation).deadline, local_response(), "{reveal}");
    }
}

#[test]
fn a_vehicle_at_rest_waits_as_long_as_its_cap() {
    let mut policy = Constant(Duration::from_secs(2)).cap(guard(Parameters::default()));
    let decision = policy.decide(&at(0.0), Duration::MAX);
    assert_eq!((decision.deadline, decision.reason), (Duration::from_secs(2), Reason::Constant));
}

#[test]
fn negative_zero_speed_is_rest() {
    let classes = Classes::new(&[hazard(20.0, 20.0), hazard(500.0, 500.0)]).unwrap();
    let guard = guard(Parameters { classes, ..Parameters::default() });
    for least in [0.0, -0.0] {
        let verdict = guard.judge(&Situation::at(Span::new(least, 30.0).map(MetresPerSecond)));
        assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()), "{least:?}");
    }
}

/// One unsure class makes the whole situation unsure (T1).
#[test]
fn one_class_between_the_cases_decides_for_all() {
    let classes = |hazards: &[Hazard]| {
        let classes = Classes::new(hazards).unwrap();
        guard(Parameters { classes, ..Parameters::default() }).judge(&at(22.0))
    };
    // At 22 m/s local needs 42.6 m in the best phase and 43.3 m in the worst; the cloud, with 57 m,
    // may take 0.919 s.
    let (stops, collides, unsure) = (hazard(60.0, 60.0), hazard(39.0, 57.0), hazard(43.0, 57.0));
    assert_eq!(classes(&[stops, collides, unsure]).case, Case::Unsure);
    let further = classes(&[stops, collides, hazard(70.0, 70.0)]);
    assert_eq!((further.case, further.deadline), (Case::LocalStops, classes(&[stops]).deadline));
    let lost = classes(&[collides, hazard(30.0, 50.0)]);
    assert_eq!((lost.case, lost.deadline), (Case::CloudAlone, classes(&[collides]).deadline));
}

#[test]
fn case_1_takes_the_side_on_which_less_time_is_left() {
    let exact = Parameters::default();
    let deadline = |parameters| guard(parameters).judge(&at(18.0)).deadline;
    let uncertain = [
        Parameters { deceleration: braking(7.3, 9.0), ..exact },
        Parameters { brake_delay: secs(0.0, 0.11), ..exact },
        Parameters { period_local: secs(0.01, 0.034), ..exact },
        Parameters {
            classes: Hazard { range_local: metres(38.0, 50.0), ..hazard(39.0, 57.0) }.into(),
            ..exact
        },
    ];
    for parameters in uncertain {
        assert!(deadline(parameters) < deadline(exact), "{parameters:?}");
    }
    let faster =
        guard(exact).judge(&Situation::at(Span::new(15.0, 18.5).map(MetresPerSecond))).deadline;
    assert!(faster < deadline(exact));
    let slower = Parameters { local_response: secs(0.2, 0.7), ..exact };
    assert!(guard(slower).judge(&at(18.0)).case == Case::LocalStops);
    assert_eq!(deadline(slower).as_millis(), 700, "local itself may take that long");
}

#[test]
fn case_2_needs_that_local_collides_at_its_best() {
    let exact = Parameters::default();
    let case = |parameters| guard(parameters).judge(&at(22.0)).case;
    assert_eq!(case(exact), Case::CloudAlone);
    let range_local = metres(39.0, 43.5);
    let may_stop = [
        Parameters { deceleration: braking(7.5, 9.0), ..exact },
        Parameters { local_response: secs(0.1, 0.3017), ..exact },
        Parameters { classes: Hazard { range_local, ..hazard(39.0, 57.0) }.into(), ..exact },
    ];
    for parameters in may_stop {
        assert_eq!(case(parameters), Case::Unsure, "{parameters:?}");
    }
}

/// Local takes one frame in nine. It reports the obstacle as soon as it comes into sight, 38.8 m
/// away, and again 0.3 s later. It brakes 0.6 s after the reveal, with 26.8 m left of the 26.67 m
/// that it needs. If the obstacle came into sight only at the second frame, local would surely be
/// too late, but the cloud might not.
#[test]
fn t2_obstacle_revealed_a_frame_ago_still_counts() {
    let period = 1.0 / 30.0;
    let frames = [0.0, 0.3].map(|captured| Frame {
        captured,
        gap: 38.8 - 20.0 * captured,
        local: Some(0.3),
        cloud: f64::INFINITY,
        lateness: 0.0,
        is_covered: false,
    });
    let drive = Drive {
        speed: 20.0,
        deceleration: 7.5,
        brake_delay: 0.0,
        reports: 2,
        range_local: 60.0,
        range_cloud: 60.0,
        hidden_beyond: 38.8,
        frames: frames.to_vec(),
    };
    let guard = guard(Parameters {
        deceleration: braking(6.75, 8.25),
        brake_delay: secs(0.0, 0.0),
        frames: 2,
        period_local: secs(0.3, 0.3),
        period_cloud: secs(period, period),
        local_response: secs(0.3, 0.3),
        classes: hazard(60.0, 60.0).into(),
        ..Parameters::default()
    });
    let deadline = |frame: &Frame| {
        let situation = Situation { reveal: Some(Metres(frame.gap)), ..at(20.0) };
        guard.judge(&situation).deadline.as_secs_f64()
    };
    assert!(!drive.collides(&drive.local_alone()));
    assert!(!drive.collides(&drive.fused(deadline)));
    assert!(drive.collides(&drive.fused(|frame| if frame.captured > 0.0 { 0.35 } else { 0.3 })));
}

/// Local takes one frame in two, and its three frames show the obstacle. A lorry passes and covers
/// the obstacle on a frame that local skips, and the cloud truthfully reports nothing for it (T1).
fn passing_lorry() -> Drive {
    let frames = [0, 1, 2, 3, 4_u32].map(|number| Frame {
        captured: 0.1 * f64::from(number),
        gap: 30.0 - 1.5 * f64::from(number),
        local: number.is_multiple_of(2).then_some(0.2),
        cloud: if number == 3 { 0.1 } else { f64::INFINITY },
        lateness: 0.0,
        is_covered: number == 3,
    });
    Drive {
        speed: 15.0,
        deceleration: 7.5,
        brake_delay: 0.0,
        reports: 3,
        range_local: 40.0,
        range_cloud: 60.0,
        hidden_beyond: f64::INFINITY,
        frames: frames.to_vec(),
    }
}

#[test]
fn t1_output_for_skipped_frame_breaks_no_row() {
    let drive = passing_lorry();
    assert!(!drive.collides(&drive.local_alone()));
    assert!(!drive.collides(&drive.fused(|_| 0.2)));
}

#[test]
fn t4_planner_that_counts_any_output_collides() {
    let drive = passing_lorry();
    assert!(!drive.collides_where_any_output_counts(&drive.local_alone()));
    assert!(drive.collides_where_any_output_counts(&drive.fused(|_| 0.2)));
}

/// An implausible figure is refused with its name, value and range (T7).
#[test]
fn refuses_implausible_figures_with_their_range() {
    let sound = Parameters::default();
    let with = |hazard: Hazard| Parameters { classes: hazard.into(), ..sound };
    let exactly = |seconds: f64| secs(seconds, seconds);
    let cases = [
        (
            Parameters { deceleration: braking(0.0, 0.0), ..sound },
            "deceleration: 0 m/s²; it must be from 0.1 to 20 m/s²",
        ),
        (
            Parameters { deceleration: braking(8.0, 7.0), ..sound },
            "deceleration: the least value is above the greatest",
        ),
        (
            Parameters { deceleration: braking(7.0, f64::NAN), ..sound },
            "deceleration: NaN m/s²; it must be from 0.1 to 20 m/s²",
        ),
        (
            Parameters { brake_delay: exactly(100.0), ..sound },
            "delay of the brakes: 100 s; it must be from 0 to 5 s",
        ),
        (Parameters { frames: 0, ..sound }, "0 frames to brake; the planner needs at least 1"),
        (
            Parameters { period_local: exactly(0.0), ..sound },
            "time between local's frames: 0 s; it must be from 0.00001 to 60 s",
        ),
        (
            Parameters { period_cloud: Span::of_rate(0.0), ..sound },
            "time between the cloud's frames: 18446744073.709553 s; it must be from 0.00001 to 60 \
             s",
        ),
        // Milliseconds given as seconds.
        (
            Parameters { local_response: exactly(301.7), ..sound },
            "local's response: 301.7 s; it must be from 0.000001 to 60 s",
        ),
        (
            Parameters { lateness: Duration::from_secs(5), ..sound },
            "lateness: 5 s; it must be from 0 to 1 s",
        ),
        (Parameters { margin: Metres(-1.0), ..sound }, "margin: -1 m; it must be from 0 to 100 m"),
        (
            with(Hazard { weight: 0.0, ..hazard(39.0, 57.0) }),
            "weight of a class: 0; it must be from 0.000001 to 1000000",
        ),
        // Millimetres given as metres.
        (with(hazard(39e3, 57e3)), "local's range: 39000 m; it must be from 0.01 to 10000 m"),
        (
            with(hazard(39.0, f64::INFINITY)),
            "the cloud's range: inf m; it must be from 0.01 to 10000 m",
        ),
        (
            with(hazard(39.0, 38.0)),
            "the cloud's range is shorter than local's: a result in time would hide what local \
             reports, so no deadline is safe",
        ),
    ];
    for (parameters, refused) in cases {
        let reported = Guard::new(parameters).unwrap_err().to_string();
        assert_eq!(reported, refused, "{parameters:?}");
    }
    assert_eq!(Classes::new(&[]), Err(Invalid::Classes(0)));
    assert_eq!(Classes::new(&[hazard(1.0, 1.0); 9]), Err(Invalid::Classes(9)));
}

#[test]
fn both_ends_of_a_range_are_plausible() {
    for (least, greatest) in [(0.1, 0.1), (20.0, 20.0), (0.1, 20.0)] {
        let deceleration = braking(least, greatest);
        guard(Parameters { deceleration, ..Parameters::default() });
    }
    assert_eq!(at(150.0).check(), Ok(()));
}

#[test]
fn the_time_between_frames_is_rounded_to_both_sides() {
    let nanos = |rate| Span::of_rate(rate).map(|period| period.as_nanos());
    assert_eq!(nanos(30.0), Span::new(33_333_333, 33_333_334));
    assert_eq!(nanos(25.0), Span::exactly(40_000_000));
    assert_eq!(nanos(f64::NAN), Span::exactly(0));
}

/// Returns a number, mostly from 0 to `most`, but sometimes any number at all.
fn figure(most: f64) -> impl Strategy<Value = f64> {
    let odd = vec![0.0, -0.0, -1.0, f64::MIN_POSITIVE, f64::MAX, f64::NAN, f64::INFINITY];
    prop_oneof![40 => 0.0..most, 1 => any::<f64>(), 1 => prop::sample::select(odd)]
}

fn span(most: f64) -> impl Strategy<Value = Span<f64>> {
    prop_oneof![
        4 => figure(most).prop_map(Span::exactly),
        1 => (figure(most), figure(most)).prop_map(|(one, other)| Span::new(one.min(other), one.max(other))),
        2 => (figure(most), 1.0..1.2).prop_map(|(least, part)| Span::new(least, least * part)),
    ]
}

/// Returns a span of times, mostly from 0 to `most`, but sometimes any times at all.
fn times(most: f64) -> impl Strategy<Value = Span<Duration>> {
    span(most).prop_map(|span| {
        span.map(|seconds| Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX))
    })
}

prop_compose! {
    fn any_hazard()(weight in figure(1.0), range_local in span(90.0), more in figure(60.0)) -> Hazard {
        let range_cloud = range_local.map(|range| Metres(range + more));
        Hazard { weight, range_local: range_local.map(Metres), range_cloud }
    }
}

prop_compose! {
    fn any_parameters()(
        (deceleration, brake_delay, local_response) in (span(10.0), times(0.3), times(0.6)),
        (period_local, period_cloud) in (times(0.2), times(0.1)),
        frames in 0..5_u32,
        (lateness, margin) in (times(0.02), figure(4.0)),
        hazards in prop::collection::vec(any_hazard(), 1..3),
    ) -> Parameters {
        let classes = Classes::new(&hazards).unwrap();
        Parameters {
            deceleration: deceleration.map(MetresPerSecondSquared),
            brake_delay,
            frames,
            period_local,
            period_cloud,
            local_response,
            lateness: lateness.least,
            margin: Metres(margin),
            classes,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 5000, failure_persistence: None, ..ProptestConfig::default() })]

    /// States T2 as an inequality over exact sums of times. If local can stop in the worst phase,
    /// or in some phase, then every output that the deadline allows is early enough or no later
    /// than local's.
    #[test]
    fn t2_no_decision_exceeds_what_is_allowed(
        parameters in any_parameters(),
        speed in span(35.0),
        reveal in prop::option::of(figure(90.0)),
        at in prop::array::uniform6(0.0..=1.0_f64),
    ) {
        let Ok(guard) = Guard::new(parameters) else { return Ok(()) };
        let situation =
            Situation { reveal: reveal.map(Metres), ..Situation::at(speed.map(MetresPerSecond)) };
        let deadline = guard.judge(&situation).deadline.as_secs_f64();
        let [deceleration, brake_delay, period, response, range, speed_at] = at;
        let within = |span: Span<f64>, at: f64| span.least + (span.greatest - span.least) * at;
        let seconds = |span: Span<Duration>, at| within(span.map(|time| time.as_secs_f64()), at);
        let response = seconds(parameters.local_response, response);
        let is_speed = speed.least >= 0.0 && speed.greatest <= 150.0 && speed.least <= speed.greatest;
        let is_reveal = reveal.is_none_or(|reveal| reveal >= 0.0);
        // Allows a rounding error in proportion to the rounded number.
        let within_rounding = |time: f64, allowed: f64, of: f64| time <= allowed + 1e-12 * of.abs();
        if within_rounding(deadline, parameters.local_response.least.as_secs_f64(), deadline) {
            return Ok(());
        }
        prop_assert!(is_speed && is_reveal, "{deadline} s with nothing known");
        let speed = within(speed, speed_at);
        let braking = within(parameters.deceleration.map(|braking| braking.0), deceleration);
        let brake_delay = seconds(parameters.brake_delay, brake_delay);
        let period = seconds(parameters.period_local, period);
        for hazard in parameters.classes.as_slice() {
            let range = within(hazard.range_local.map(|range| range.0), range).min(reveal.unwrap_or(f64::INFINITY));
            // The metres driven until the vehicle rests, if the first frame comes `phase` after the
            // range begins.
            let driven = |phase: f64, wait: f64| {
                let frames = f64::from(parameters.frames) - 1.0;
                speed * (phase + frames * period + wait + brake_delay) + speed * speed / (2.0 * braking)
            };
            let wait = response.max(deadline + parameters.lateness.as_secs_f64());
            if !driven(period, wait).is_finite() {
                continue;
            }
            let local_stops = driven(0.0, response) < range * (1.0 - 1e-12);
            let fusion_stops = within_rounding(driven(period, wait), range, driven(period, wait).max(range));
            prop_assert!(!local_stops || fusion_stops, "{deadline} s at {speed} m/s, {hazard:?}");
        }
    }

    #[test]
    fn a_cap_is_never_exceeded(parameters in any_parameters(), speed in span(35.0), cap in any::<u64>()) {
        let Ok(mut guard) = Guard::new(parameters) else { return Ok(()) };
        let cap = Duration::from_nanos(cap);
        prop_assert!(guard.decide(&Situation::at(speed.map(MetresPerSecond)), cap).deadline <= cap);
    }
}
