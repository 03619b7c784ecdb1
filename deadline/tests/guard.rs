//! What the guard allows: the specification's figures, its cases, and whatever figures it is made of.

mod vehicle;

use std::borrow::Borrow;
use std::time::Duration;

use fuseline_deadline::{
    Case, Classes, Constant, Figure, Guard, Hazard, Invalid, Parameters, Policy, Reason, Situation,
    Span,
};
use proptest::prelude::*;
use vehicle::{Drive, Frame};

fn guard(parameters: impl Borrow<Parameters>) -> Guard {
    Guard::new(*parameters.borrow()).unwrap()
}

fn hazard(range_local: f64, range_cloud: f64) -> Hazard {
    Hazard { weight: 1.0, range_local: range_local.into(), range_cloud: range_cloud.into() }
}

fn local_response() -> Duration {
    Duration::from_micros(301_700)
}

#[test]
fn the_default_vehicle_has_the_deadlines_of_the_specification() {
    let guard = guard(Parameters::default());
    let expected = [
        (11.0, Case::LocalStops, 2.4253),
        (18.0, Case::LocalStops, 0.6506),
        (20.0, Case::LocalStops, 0.3117),
        (22.0, Case::CloudAlone, 0.9192),
        (24.0, Case::CloudAlone, 0.5700),
    ];
    for (speed, case, deadline) in expected {
        let verdict = guard.judge(&Situation::at(speed));
        assert_eq!(verdict.case, case, "{speed} m/s");
        // Four digits are given, so a tenth of a millisecond, rounded.
        let off = verdict.deadline.as_secs_f64() - deadline;
        assert!(off.abs() <= 0.000_05, "{speed} m/s: {off} s off");
    }
}

/// T1.
#[test]
fn between_the_cases_nothing_is_later_than_local() {
    let guard = guard(Parameters::default());
    let cases = [20.0, 20.7, 20.8, 21.0].map(|speed| guard.judge(&Situation::at(speed)).case);
    assert_eq!(cases, [Case::LocalStops, Case::Unsure, Case::Unsure, Case::CloudAlone]);
    let unsure = guard.judge(&Situation::at(20.8));
    assert_eq!(unsure.deadline, local_response());
}

#[test]
fn a_cloud_that_cannot_help_either_leaves_locals_response() {
    let verdict = guard(Parameters::default()).judge(&Situation::at(40.0));
    assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()));
    assert!(verdict.budget_cloud < 0.0);
}

#[test]
fn a_speed_that_is_none_leaves_locals_response() {
    let guard = guard(Parameters::default());
    let speeds = [
        Span::exactly(f64::NAN),
        Span::exactly(f64::INFINITY),
        Span::exactly(-1.0),
        Span::new(21.0, 20.0),
        Span::new(f64::NEG_INFINITY, 20.0),
    ];
    for speed in speeds {
        let verdict = guard.judge(&Situation::at(speed));
        assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()), "{speed:?}");
    }
    for reveal in [f64::NAN, -1.0, 0.0] {
        let situation = Situation { reveal: Some(reveal), ..Situation::at(11.0) };
        assert_eq!(guard.judge(&situation).deadline, local_response(), "{reveal}");
    }
}

#[test]
fn a_vehicle_at_rest_waits_as_long_as_its_cap() {
    let mut policy = Constant(Duration::from_secs(2)).caps(guard(Parameters::default()));
    let decision = policy.decide(&Situation::at(0.0), Duration::MAX);
    assert_eq!((decision.deadline, decision.reason), (Duration::from_secs(2), Reason::Constant));
}

#[test]
fn a_vehicle_that_may_be_at_rest_is_so_with_either_sign_of_0() {
    let classes = Classes::new(&[hazard(20.0, 20.0), hazard(500.0, 500.0)]).unwrap();
    let guard = guard(Parameters { classes, ..Parameters::default() });
    for least in [0.0, -0.0] {
        let verdict = guard.judge(&Situation::at(Span::new(least, 30.0)));
        assert_eq!((verdict.case, verdict.deadline), (Case::Unsure, local_response()), "{least:?}");
    }
}

/// T1.
#[test]
fn one_class_between_the_cases_decides_for_all() {
    let classes = |hazards: &[Hazard]| {
        let classes = Classes::new(hazards).unwrap();
        guard(Parameters { classes, ..Parameters::default() }).judge(&Situation::at(22.0))
    };
    // At 22 m/s local needs 42.6 m in the best phase and 43.3 m in the worst; the cloud may come after 0.919 s with 57 m.
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
    let deadline = |parameters| guard(parameters).judge(&Situation::at(18.0)).deadline;
    let uncertain = [
        Parameters { deceleration: Span::new(7.3, 9.0), ..exact },
        Parameters { brake_delay: Span::new(0.0, 0.11), ..exact },
        Parameters { period_local: Span::new(0.01, 0.034), ..exact },
        Parameters {
            classes: Hazard { range_local: Span::new(38.0, 50.0), ..hazard(39.0, 57.0) }.into(),
            ..exact
        },
    ];
    for parameters in uncertain {
        assert!(deadline(parameters) < deadline(exact), "{parameters:?}");
    }
    let faster = guard(exact).judge(&Situation::at(Span::new(15.0, 18.5))).deadline;
    assert!(faster < deadline(exact));
    let slower = Parameters { local_response: Span::new(0.2, 0.7), ..exact };
    assert!(guard(slower).judge(&Situation::at(18.0)).case == Case::LocalStops);
    assert_eq!(deadline(slower).as_millis(), 700, "local itself may take that long");
}

#[test]
fn case_2_needs_that_local_collides_at_its_best() {
    let exact = Parameters::default();
    let case = |parameters| guard(parameters).judge(&Situation::at(22.0)).case;
    assert_eq!(case(exact), Case::CloudAlone);
    let range_local = Span::new(39.0, 43.5);
    let may_stop = [
        Parameters { deceleration: Span::new(7.5, 9.0), ..exact },
        Parameters { local_response: Span::new(0.1, 0.3017), ..exact },
        Parameters { classes: Hazard { range_local, ..hazard(39.0, 57.0) }.into(), ..exact },
    ];
    for parameters in may_stop {
        assert_eq!(case(parameters), Case::Unsure, "{parameters:?}");
    }
}

/// Local takes one frame in nine, so it reports the obstacle at once when it comes into sight, 38.8 m away, and again
/// 0.3 s later; it then brakes 0.6 s after the reveal, with 26.8 m left of the 26.67 m that it needs. For what came into
/// sight at the second frame only, local would surely be too late, but the cloud might not.
#[test]
fn t2_what_came_into_sight_a_frame_ago_is_not_given_up() {
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
        deceleration: Span::new(6.75, 8.25),
        brake_delay: 0.0.into(),
        frames: 2,
        period_local: 0.3.into(),
        period_cloud: period.into(),
        local_response: 0.3.into(),
        classes: hazard(60.0, 60.0).into(),
        ..Parameters::default()
    });
    let deadline = |frame: &Frame| {
        let situation = Situation { reveal: Some(frame.gap), ..Situation::at(20.0) };
        guard.judge(&situation).deadline.as_secs_f64()
    };
    assert!(!drive.collides(&drive.local_alone()));
    assert!(!drive.collides(&drive.fused(deadline)));
    assert!(drive.collides(&drive.fused(|frame| if frame.captured > 0.0 { 0.35 } else { 0.3 })));
}

/// T1: local takes one frame in two, and its three frames show the obstacle. A lorry that passes covers it on a frame that
/// local skips. The cloud truly answers that it sees nothing there.
fn passing_lorry() -> Drive {
    let frames = [0.0, 0.1, 0.2, 0.3, 0.4].map(|captured| Frame {
        captured,
        gap: 30.0 - 15.0 * captured,
        local: [0.0, 0.2, 0.4].contains(&captured).then_some(0.2),
        cloud: if captured == 0.3 { 0.1 } else { f64::INFINITY },
        lateness: 0.0,
        is_covered: captured == 0.3,
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
fn t1_an_output_for_a_frame_that_local_skips_breaks_no_row_of_locals() {
    let drive = passing_lorry();
    assert!(!drive.collides(&drive.local_alone()));
    assert!(!drive.collides(&drive.fused(|_| 0.2)));
}

#[test]
fn t4_a_planner_for_which_any_output_breaks_a_row_hits_what_local_alone_does_not() {
    let drive = passing_lorry();
    assert!(!drive.collides_where_any_output_counts(&drive.local_alone()));
    assert!(drive.collides_where_any_output_counts(&drive.fused(|_| 0.2)));
}

/// T7.
#[test]
fn figures_that_make_no_sense_are_refused() {
    let sound = Parameters::default();
    let with = |hazard: Hazard| Parameters { classes: hazard.into(), ..sound };
    let cases = [
        (
            Parameters { deceleration: 0.0.into(), ..sound },
            Invalid::NotAbove0(Figure::Deceleration),
        ),
        (
            Parameters { deceleration: Span::new(8.0, 7.0), ..sound },
            Invalid::Span(Figure::Deceleration),
        ),
        (Parameters { brake_delay: (-0.1).into(), ..sound }, Invalid::Below0(Figure::BrakeDelay)),
        (Parameters { brake_delay: f64::NAN.into(), ..sound }, Invalid::Span(Figure::BrakeDelay)),
        (Parameters { frames: 0, ..sound }, Invalid::NoFrames),
        (Parameters { period_local: 0.0.into(), ..sound }, Invalid::NotAbove0(Figure::PeriodLocal)),
        (
            Parameters { period_cloud: f64::INFINITY.into(), ..sound },
            Invalid::Span(Figure::PeriodCloud),
        ),
        (
            Parameters { local_response: 0.0.into(), ..sound },
            Invalid::NotAbove0(Figure::LocalResponse),
        ),
        (Parameters { lateness: -1.0, ..sound }, Invalid::Below0(Figure::Lateness)),
        (Parameters { margin: f64::NAN, ..sound }, Invalid::Span(Figure::Margin)),
        (with(Hazard { weight: 0.0, ..hazard(39.0, 57.0) }), Invalid::NotAbove0(Figure::Weight)),
        (with(hazard(-39.0, 57.0)), Invalid::Below0(Figure::RangeLocal)),
        (with(hazard(39.0, f64::NAN)), Invalid::Span(Figure::RangeCloud)),
        (with(hazard(39.0, 38.0)), Invalid::CloudSeesLess),
    ];
    for (parameters, refused) in cases {
        assert_eq!(Guard::new(parameters), Err(refused), "{parameters:?}");
    }
    assert_eq!(Classes::new(&[]), Err(Invalid::Classes(0)));
    assert_eq!(Classes::new(&[hazard(1.0, 1.0); 9]), Err(Invalid::Classes(9)));
}

/// Mostly from 0 to `most`, but any number at all.
fn figure(most: f64) -> impl Strategy<Value = f64> {
    let odd = vec![0.0, -0.0, -1.0, f64::MIN_POSITIVE, f64::MAX, f64::NAN, f64::INFINITY];
    prop_oneof![40 => 0.0..most, 1 => any::<f64>(), 1 => prop::sample::select(odd)]
}

fn span(most: f64) -> impl Strategy<Value = Span> {
    prop_oneof![
        4 => figure(most).prop_map(Span::exactly),
        1 => (figure(most), figure(most)).prop_map(|(one, other)| Span::new(one.min(other), one.max(other))),
        2 => (figure(most), 1.0..1.2).prop_map(|(least, part)| Span::new(least, least * part)),
    ]
}

prop_compose! {
    fn any_hazard()(weight in figure(1.0), range_local in span(90.0), more in figure(60.0)) -> Hazard {
        let range_cloud = Span::new(range_local.least + more, range_local.greatest + more);
        Hazard { weight, range_local, range_cloud }
    }
}

prop_compose! {
    fn any_parameters()(
        (deceleration, brake_delay, local_response) in (span(10.0), span(0.3), span(0.6)),
        (period_local, period_cloud) in (span(0.2), span(0.1)),
        frames in 0..5_u32,
        (lateness, margin) in (figure(0.02), figure(4.0)),
        hazards in prop::collection::vec(any_hazard(), 1..3),
    ) -> Parameters {
        let classes = Classes::new(&hazards).unwrap();
        Parameters {
            deceleration, brake_delay, frames, period_local, period_cloud, local_response, lateness, margin, classes,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 5000, failure_persistence: None, ..ProptestConfig::default() })]

    /// T2 as an inequality, with exact sums of time: if the truth lets local stop in the worst phase or in some phase,
    /// what the deadline allows is early enough or no later than local.
    #[test]
    fn t2_no_decision_exceeds_what_is_allowed(
        parameters in any_parameters(),
        speed in span(35.0),
        reveal in prop::option::of(figure(90.0)),
        at in prop::array::uniform6(0.0..=1.0),
    ) {
        let Ok(guard) = Guard::new(parameters) else { return Ok(()) };
        let situation = Situation { reveal, ..Situation::at(speed) };
        let deadline = guard.judge(&situation).deadline.as_secs_f64();
        let [deceleration, brake_delay, period, response, range, speed_at] = at;
        let within = |span: Span, at: f64| span.least + (span.greatest - span.least) * at;
        let response = within(parameters.local_response, response);
        let is_speed = speed.least >= 0.0 && speed.greatest.is_finite() && speed.least <= speed.greatest;
        let is_reveal = reveal.is_none_or(|reveal| reveal >= 0.0);
        // Rounding, relative to what is rounded.
        let within_rounding = |time: f64, allowed: f64, of: f64| time <= allowed + 1e-12 * of.abs();
        if within_rounding(deadline, parameters.local_response.least, deadline) {
            return Ok(());
        }
        prop_assert!(is_speed && is_reveal, "{deadline} s with nothing known");
        let speed = within(speed, speed_at);
        let braking = within(parameters.deceleration, deceleration);
        let brake_delay = within(parameters.brake_delay, brake_delay);
        let period = within(parameters.period_local, period);
        for hazard in parameters.classes.as_slice() {
            let range = within(hazard.range_local, range).min(reveal.unwrap_or(f64::INFINITY));
            // Metres driven until the vehicle rests, when the first frame comes `phase` after the range begins.
            let driven = |phase: f64, wait: f64| {
                let frames = f64::from(parameters.frames) - 1.0;
                speed * (phase + frames * period + wait + brake_delay) + speed * speed / (2.0 * braking)
            };
            let wait = response.max(deadline + parameters.lateness);
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
        prop_assert!(guard.decide(&Situation::at(speed), cap).deadline <= cap);
    }
}
