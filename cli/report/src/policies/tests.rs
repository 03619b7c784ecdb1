//! Tests each policy's figures, and that the bounds hold for everything that is not known.

use proptest::prelude::*;

use super::*;

const APS: [Option<f64>; 3] = [Some(40.0), Some(44.0), Some(52.0)];
const DEADLINE: Duration = ms(500);

const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn message(arrivals: [ArrivalTime; 3], forwarded: Option<(usize, u64)>) -> MessageRecord {
    let forwarded =
        forwarded.map(|(source, response)| ForwardedOutput { source, response: ms(response) });
    MessageRecord { arrivals: arrivals.to_vec(), forwarded }
}

fn at(millis: u64) -> ArrivalTime {
    ArrivalTime::At(ms(millis))
}

fn constant() -> ComparedPolicy {
    let (deadline, priorities) = (DEADLINE, vec![1, 2]);
    ComparedPolicy::Constant(ConstantPolicy { deadline, priorities })
}

fn score(policy: &ComparedPolicy, messages: &[MessageRecord]) -> PolicyScore {
    policy.score(messages, &APS, DEADLINE)
}

/// Returns a message that the best cloud wins, and a message for which both networks fail.
fn two() -> [MessageRecord; 2] {
    [
        message([at(300), at(150), at(170)], Some((2, 170))),
        message([at(310), at(9_000), ArrivalTime::Never], Some((0, 500))),
    ]
}

fn close(found: Option<BoundedFigure<f64>>, expected: f64) -> bool {
    between(found, expected, expected)
}

fn between(found: Option<BoundedFigure<f64>>, least: f64, most: f64) -> bool {
    let is_close = |(found, expected): (f64, f64)| (found - expected).abs() < 1e-9;
    found.is_some_and(|it| is_close((it.at_least, least)) && is_close((it.at_most, most)))
}

/// The result that is available at its due instant is the first response or a better one. So if the
/// first response is not in time, no result is.
#[test]
fn one_deadline_is_in_time_wherever_the_first_response_is() {
    let failed = |millis| ArrivalTime::Failed(ms(millis));
    let all = [
        at(100),
        at(300),
        at(499),
        at(500),
        at(9_000),
        failed(0),
        failed(300),
        failed(600),
        ArrivalTime::Never,
    ];
    for (local, west, east) in (0..all.len().pow(3)).map(|i| (i / 81, i / 9 % 9, i % 9)) {
        let one = [message([all[local], all[west], all[east]], None)];
        let (constant, first) = (score(&constant(), &one), score(&ComparedPolicy::FirstWins, &one));
        assert!(constant.in_time.at_least >= first.in_time.at_most, "{one:?}");
        let (of_constant, of_first) = (constant.ap.unwrap(), first.ap.unwrap());
        assert!(of_constant.at_least >= of_first.at_most, "{one:?}");
    }
}

#[test]
fn each_policy_takes_its_own_result() {
    for (policy, ap, in_time) in [
        (ComparedPolicy::Fusion, 46.0, 2),
        (constant(), 46.0, 2),
        (ComparedPolicy::LocalOnly, 40.0, 2),
        (ComparedPolicy::CloudOnly(1), 22.0, 1),
        (ComparedPolicy::CloudOnly(2), 26.0, 1),
        (ComparedPolicy::FirstWins, 42.0, 2),
    ] {
        let score = score(&policy, &two());
        assert!(close(score.ap, ap), "{policy:?}: {score:?}");
        assert_eq!(score.in_time, BoundedFigure::exactly(in_time), "{policy:?}");
    }
}

#[test]
fn a_result_at_the_deadline_counts_as_late() {
    let late = [message([at(500), at(499), at(501)], Some((0, 500)))];
    assert_eq!(score(&ComparedPolicy::LocalOnly, &late).in_time, BoundedFigure::exactly(0));
    assert_eq!(score(&ComparedPolicy::CloudOnly(1), &late).in_time, BoundedFigure::exactly(1));
    assert_eq!(score(&ComparedPolicy::Fusion, &late).in_time, BoundedFigure::exactly(0));
}

#[test]
fn fusion_is_in_time_by_its_results_arrival_though_it_leaves_at_the_deadline() {
    let held = [message([at(300), at(9_000), at(9_000)], Some((0, 501)))];
    let score = score(&ComparedPolicy::Fusion, &held);
    assert_eq!(
        (score.in_time.exact(), score.quantiles[0]),
        (Some(1), Some(Quantile::Exactly(ms(501))))
    );
}

#[test]
fn a_missed_message_counts_zero_and_never_responds() {
    let missed = [message([ArrivalTime::Never; 3], None), message([at(1); 3], Some((2, 1)))];
    let score = score(&ComparedPolicy::Fusion, &missed);
    assert!(close(score.ap, 26.0), "{score:?}");
    assert_eq!(score.quantiles[1], Some(Quantile::Never));
}

#[test]
fn an_ended_call_leaves_the_ap_open_only_before_the_deadline() {
    let ended =
        |bound| [message([at(300), at(150), ArrivalTime::After(ms(bound))], Some((0, 500)))];
    assert!(close(score(&ComparedPolicy::CloudOnly(2), &ended(500)).ap, 0.0));
    let open = score(&ComparedPolicy::CloudOnly(2), &ended(499));
    assert!(between(open.ap, 0.0, 52.0), "{open:?}");
    assert_eq!(open.in_time, BoundedFigure { at_least: 0, at_most: 1 });
    // The first source is known if the unknown result came later.
    assert!(close(score(&ComparedPolicy::FirstWins, &ended(150)).ap, 44.0));
    let open = score(&ComparedPolicy::FirstWins, &ended(149));
    assert!(between(open.ap, 44.0, 52.0), "{open:?}");
    assert_eq!(open.quantiles[0], Some(Quantile::AtLeast(ms(149))));
}

/// The better of two clouds is always first, and its result ends the other's call.
#[test]
fn what_is_known_to_come_first_is_in_time_whatever_would_have_followed() {
    let won = [message([at(209), at(94), ArrivalTime::After(ms(94))], Some((1, 94)))];
    let first = score(&ComparedPolicy::FirstWins, &won);
    assert_eq!(first.in_time, BoundedFigure::exactly(1));
    assert_eq!(first.quantiles, [Some(Quantile::Exactly(ms(94))); 3]);
    let ended =
        [message([at(209), ArrivalTime::After(ms(152)), ArrivalTime::After(ms(152))], None)];
    assert_eq!(score(&ComparedPolicy::FirstWins, &ended).in_time, BoundedFigure::exactly(1));
    let cloud = score(&ComparedPolicy::CloudOnly(1), &ended);
    assert_eq!(cloud.in_time, BoundedFigure { at_least: 0, at_most: 1 });
}

#[test]
fn with_a_constant_what_is_unknown_leaves_open_what_may_depend_on_it() {
    let unknown = |bound| {
        let arrivals = [at(300), at(150), ArrivalTime::After(ms(bound))];
        score(&constant(), &[message(arrivals, Some((1, 287)))])
    };
    assert!(between(unknown(287).ap, 44.0, 52.0) && close(unknown(500).ap, 44.0));
    assert_eq!(unknown(287).in_time, BoundedFigure::exactly(1));
    assert_eq!(unknown(287).quantiles[0], Some(Quantile::AtLeast(ms(287))));
    assert_eq!(unknown(500).quantiles[0], Some(Quantile::Exactly(ms(500))));
}

#[test]
fn the_median_of_outages_is_that_of_messages_without_a_result_in_time() {
    let refused = ArrivalTime::Failed(Duration::ZERO);
    let messages = [
        message([at(300), at(150), at(170)], Some((2, 170))),
        message([at(310), at(9_000), at(100)], Some((2, 100))),
        message([at(320), at(150), ArrivalTime::Never], Some((1, 290))),
        message([at(330), at(500), refused], Some((0, 330))),
        message([at(340), ArrivalTime::Failed(ms(9)), refused], Some((0, 340))),
    ];
    let outage = |policy: ComparedPolicy| score(&policy, &messages).outage;
    assert_eq!(outage(ComparedPolicy::Fusion), Some(Quantile::Exactly(ms(290))));
    assert_eq!(outage(constant()), Some(Quantile::Exactly(ms(500))));
    assert_eq!(score(&ComparedPolicy::Fusion, &messages[..1]).outage, None);
}

#[test]
fn a_model_without_figure_leaves_the_ap_open() {
    let score = ComparedPolicy::Fusion.score(&two(), &[Some(40.0), None, None], DEADLINE);
    assert_eq!(score.ap, None);
}

#[test]
fn requests_are_what_each_policy_needs_of_those_admitted() {
    let requests = |policy: ComparedPolicy| policy.needs(&[300, 250, 200]);
    assert_eq!(requests(ComparedPolicy::Fusion), None);
    assert_eq!(requests(ComparedPolicy::LocalOnly), Some(0));
    assert_eq!(requests(ComparedPolicy::CloudOnly(1)), Some(250));
    assert_eq!(requests(ComparedPolicy::FirstWins), Some(450));
}

/// Draws a source's true arrival. If its call was ended early, also draws when.
fn arrivals() -> impl Strategy<Value = [(ArrivalTime, Option<u64>); 3]> {
    // There are few instants, so that many are equal and many are around the deadline.
    let instant = || prop_oneof![0..12_u64, 480..520_u64, 0..900_u64];
    let arrival = prop_oneof![
        6 => instant().prop_map(at),
        1 => instant().prop_map(|millis| ArrivalTime::Failed(ms(millis))),
        1 => Just(ArrivalTime::Never),
    ];
    let source = (arrival, prop::option::weighted(0.5, instant()));
    [source.clone(), source.clone(), source]
}

/// Returns the part of an arrival that a trace shows: nothing after the instant when the call was
/// ended.
fn censored_arrival((arrival, ended): (ArrivalTime, Option<u64>)) -> ArrivalTime {
    let bound = ended.map_or(Duration::MAX, ms);
    match arrival {
        ArrivalTime::At(at) | ArrivalTime::Failed(at) if at <= bound => arrival,
        ArrivalTime::Never if ended.is_none() => arrival,
        ArrivalTime::At(_) | ArrivalTime::Failed(_) | ArrivalTime::Never => {
            ArrivalTime::After(bound)
        }
        ArrivalTime::After(_) => unreachable!("a true arrival is known"),
    }
}

fn holds(bound: Option<Quantile>, exact: Option<Quantile>) -> bool {
    let least = |quantile| match quantile {
        Quantile::Exactly(at) | Quantile::AtLeast(at) => at,
        Quantile::Never => NEVER,
    };
    match (bound, exact) {
        (Some(Quantile::AtLeast(bound)), Some(exact)) => bound <= least(exact),
        // There may be no outage.
        (Some(Quantile::AtLeast(_) | Quantile::Never), None) => true,
        (bound, exact) => bound == exact,
    }
}

#[test]
fn progressive_answers_with_the_first_result_and_ends_with_the_best() {
    let progressive = ComparedPolicy::Progressive(vec![1, 2]);
    let found = score(&progressive, &two());
    assert!(close(found.ap, f64::midpoint(52.0, 40.0)));
    assert_eq!(found.in_time.exact(), Some(2));
    assert_eq!(found.quantiles[0], Some(Quantile::Exactly(ms(150))));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..Default::default() })]

    /// Each figure's bounds contain the figure that results if every arrival is known.
    #[test]
    fn no_figure_says_more_than_is_known(
        messages in prop::collection::vec(arrivals(), 1..12),
        order in prop::bool::ANY,
    ) {
        let with = |arrival: fn((ArrivalTime, Option<u64>)) -> ArrivalTime| -> Vec<MessageRecord> {
            messages.iter().map(|sources| message(sources.map(arrival), None)).collect()
        };
        let (censored, known) = (with(censored_arrival), with(|(arrival, _)| arrival));
        let priorities = if order { vec![1, 2] } else { vec![2, 1] };
        let progressive = ComparedPolicy::Progressive(priorities.clone());
        let constant = ComparedPolicy::Constant(ConstantPolicy { deadline: DEADLINE, priorities });
        let others = [ComparedPolicy::LocalOnly, ComparedPolicy::CloudOnly(1), ComparedPolicy::CloudOnly(2)];
        for policy in others.into_iter().chain([ComparedPolicy::FirstWins, progressive, constant]) {
            let [bound, exact] = [&censored, &known].map(|messages| score(&policy, messages));
            let reported = format!("{policy:?}: {bound:?} does not hold {exact:?}");
            let (ap, exact_ap) = (bound.ap.unwrap(), exact.ap.unwrap());
            prop_assert_eq!(exact_ap.exact().is_some(), true);
            prop_assert!(ap.at_least <= exact_ap.at_least + 1e-9, "{}", reported);
            prop_assert!(ap.at_most >= exact_ap.at_most - 1e-9, "{}", reported);
            let in_time = exact.in_time.exact().expect("all is known");
            let BoundedFigure { at_least, at_most } = bound.in_time;
            prop_assert!((at_least..=at_most).contains(&in_time), "{}", reported);
            for (bound, exact) in bound.quantiles.into_iter().zip(exact.quantiles) {
                prop_assert!(holds(bound, exact), "{}", reported);
            }
            prop_assert!(holds(bound.outage, exact.outage), "{}", reported);
        }
    }

    /// The bounds for known arrivals are exact. They are what the machine would do with one
    /// deadline.
    #[test]
    fn the_bounds_of_a_constant_are_exact_where_all_is_known(sources in arrivals()) {
        let arrivals = sources.map(|(arrival, _)| arrival);
        let constant = ConstantPolicy { deadline: DEADLINE, priorities: vec![2, 1] };
        let forwarded = constant.forwarded(&arrivals);
        let response = Response::exactly(forwarded.map(|forwarded| forwarded.response));
        prop_assert_eq!(constant.bounds(&arrivals, DEADLINE).0, response);
    }
}

/// A result counts as possibly in time exactly if some arrival that the trace allows puts it in
/// time (D11).
#[test]
fn what_may_be_in_time_is_what_some_arrival_makes_so() {
    const TIMES: [u64; 3] = [300, 500, 700];
    let known = TIMES.map(at).into_iter().chain([ArrivalTime::Never]);
    let all = known.chain(TIMES.map(|time| ArrivalTime::After(ms(time)))).collect::<Vec<_>>();
    let possible = |arrival: ArrivalTime| match arrival {
        // Just later, between the other times, and never.
        ArrivalTime::After(bound) => {
            let later = [301, 400, 501, 600, 701].map(ms).into_iter().filter(|it| *it > bound);
            later.map(ArrivalTime::At).chain([ArrivalTime::Never]).collect()
        }
        arrival => vec![arrival],
    };
    let policies = [
        ComparedPolicy::LocalOnly,
        ComparedPolicy::CloudOnly(1),
        ComparedPolicy::CloudOnly(2),
        ComparedPolicy::FirstWins,
        ComparedPolicy::Progressive(vec![1, 2]),
        ComparedPolicy::Progressive(vec![2, 1]),
        ComparedPolicy::Constant(ConstantPolicy { deadline: ms(350), priorities: vec![1, 2] }),
        ComparedPolicy::Constant(ConstantPolicy { deadline: ms(650), priorities: vec![2, 1] }),
    ];
    let chosen = |policy: &ComparedPolicy, arrivals| {
        let PolicyChoice { in_time, .. } = policy.choose(&message(arrivals, None), DEADLINE);
        in_time.into_iter().collect::<std::collections::BTreeSet<_>>()
    };
    for [a, b, c] in all.iter().flat_map(|a| {
        let pairs = all.iter().flat_map(|b| all.iter().map(move |c| [*b, *c]));
        pairs.map(move |[b, c]| [*a, b, c]).collect::<Vec<_>>()
    }) {
        for policy in &policies {
            let mut expected = std::collections::BTreeSet::new();
            for a in possible(a) {
                for b in possible(b) {
                    expected
                        .extend(possible(c).into_iter().flat_map(|c| chosen(policy, [a, b, c])));
                }
            }
            assert_eq!(chosen(policy, [a, b, c]), expected, "{policy:?} of {a:?}, {b:?}, {c:?}");
        }
    }
}
