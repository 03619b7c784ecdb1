//! Compares the estimate, the deadlines and the checks with their definitions, for calls and
//! figures drawn at random.

use std::time::Duration;

use fuseline_deadline::{
    Case, Choice, End, Expected, Guard, Hazard, Loss, Metres, MetresPerSecond,
    MetresPerSecondSquared, Observation, Observations, Parameters, Policy as _, Reason, Situation,
    Span, least_loss, mean_loss,
};
use proptest::prelude::*;

use crate::expected::{ACCURACY, ms, observation, survival};

fn observations() -> impl Strategy<Value = Vec<Observation>> {
    let some = (1..40_u64, any::<bool>(), 0..4_u64);
    prop::collection::vec(
        some.prop_map(|(ms, answered, count)| observation(ms * 10, answered, count)),
        0..30,
    )
}

/// Returns a number that cannot be a size: NaN, negative or infinite.
fn nonsense() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(f64::from_bits).prop_filter("it makes sense", |number| {
        number.is_nan() || number.is_infinite() || *number < 0.0
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Compares the estimate with its definition (T5): the product, over the distinct responses, of
    /// the share of calls without a result then, among the calls that were seen for that long.
    #[test]
    fn estimate_is_the_product_over_all_seen_so_long(
        calls in observations(),
        mut ages in prop::collection::vec(1..40_u64, 0..10),
    ) {
        ages.sort_unstable_by(|one, other| other.cmp(one));
        let under_way: Vec<_> = ages.iter().map(|age| ms(age * 10)).collect();
        for step in survival(&calls, &under_way) {
            let mut product = 1.0;
            for millis in (10..400).step_by(10).take_while(|millis| ms(*millis) <= step.response) {
                let at = |call: &&Observation| call.response == ms(millis) && call.is_answered;
                let answered: u64 = calls.iter().filter(at).map(|call| call.count).sum();
                let at_risk = calls.iter().filter(|call| call.response >= ms(millis));
                let at_risk: u64 = at_risk.map(|call| call.count).sum();
                let young = under_way.iter().filter(|age| **age >= ms(millis)).count() as u64;
                if answered > 0 {
                    let number = |calls| f64::from(u32::try_from(calls).unwrap());
                    product *= 1.0 - number(answered) / number(at_risk + young);
                }
            }
            prop_assert!((step.survival - product).abs() < 1e-12, "{step:?}, not {product}");
        }
    }

    /// The chosen deadline costs no more than any other, and is the shortest if all cost the same
    /// (T3).
    #[test]
    fn no_deadline_costs_less_than_the_one_chosen(calls in observations(), cap in 250..450_u64) {
        let loss = |source, response| ACCURACY.loss(&Situation::at(MetresPerSecond(10.0)), source, response);
        let steps = || survival(&calls, &[]);
        let Choice { deadline, loss: least } = least_loss(steps(), (ms(200), ms(260)), ms(cap), loss);
        prop_assert!(deadline >= ms(200) && deadline <= ms(cap));
        prop_assert!((mean_loss(steps(), ms(260), deadline, loss) - least).abs() < 1e-9);
        for millis in 200..=cap {
            for candidate in [ms(millis), ms(millis) + Duration::from_nanos(1)] {
                if candidate <= ms(cap) {
                    let other = mean_loss(steps(), ms(260), candidate, loss);
                    prop_assert!(least <= other + 1e-9, "{other} at {candidate:?}, {least} at {deadline:?}");
                }
            }
        }
        let free = least_loss(steps(), (ms(200), ms(260)), ms(cap), |_, _| 0.0);
        prop_assert_eq!(free.deadline, ms(200));
    }

    /// One message in `probe_every` waits as long as the cap allows, whatever the calls did (T6).
    #[test]
    fn one_message_in_probe_every_waits_for_the_cap(every in 1..9_u32, calls in observations()) {
        let mut policy = Expected::<_, 8>::new(ACCURACY, ms(200), Some(every)).unwrap();
        for (message, Observation { response, is_answered, .. }) in (0..).zip(calls) {
            let chosen = policy.decide(&Situation::at(MetresPerSecond(10.0)), ms(500));
            prop_assert_eq!(chosen.reason == Reason::Probe, message % every == 0);
            prop_assert!(chosen.reason != Reason::Probe || chosen.deadline == ms(500));
            policy.ended(if is_answered { End::Answered(response) } else { End::Censored(response) });
        }
    }

    /// Exactly the last calls are remembered (T6).
    #[test]
    fn the_last_calls_are_remembered_and_no_other(ends in prop::collection::vec((0..3, 1..50_u64), 0..40)) {
        let mut observations = Observations::<7>::new();
        let mut all = Vec::new();
        for (kind, millis) in ends {
            let (end, observation) = match kind {
                0 => (End::Answered(ms(millis)), observation(millis, true, 1)),
                1 => (End::Censored(ms(millis)), observation(millis, false, 1)),
                _ => {
                    let never = Observation { response: Duration::MAX, is_answered: false, count: 1 };
                    (End::Failed(ms(millis)), never)
                }
            };
            observations.add(end);
            all.push(observation);
            let mut last = all[all.len().saturating_sub(7)..].to_vec();
            last.sort_by_key(Observation::key);
            prop_assert_eq!(observations.sorted().collect::<Vec<_>>(), last);
        }
    }

    /// Figures that make no sense are refused (T7).
    #[test]
    fn figures_that_make_no_sense_are_refused(figure in 0..6, number in nonsense()) {
        let mut parameters = Parameters::default();
        let hazard = parameters.classes.as_slice()[0];
        match figure {
            0 => parameters.deceleration = Span::exactly(MetresPerSecondSquared(number)),
            1 => parameters.margin = Metres(number),
            2 => parameters.classes = Hazard { weight: number, ..hazard }.into(),
            3 => parameters.classes = Hazard { range_local: Metres(number).into(), ..hazard }.into(),
            4 => parameters.classes = Hazard { range_cloud: Metres(number).into(), ..hazard }.into(),
            _ => parameters.frames = 0,
        }
        prop_assert!(Guard::new(parameters).is_err(), "{parameters:?}");
    }

    /// In a situation that makes no sense, local keeps its time (T7).
    #[test]
    fn a_situation_without_sense_leaves_local_its_time(number in nonsense(), is_speed in any::<bool>()) {
        let guard = Guard::new(Parameters::default()).unwrap();
        let at = |speed| Situation::at(MetresPerSecond(speed));
        let situation = if is_speed { at(number) } else { Situation { reveal: Some(Metres(-number.abs())), ..at(11.0) } };
        let judged = guard.judge(&situation);
        prop_assert_eq!((judged.case, judged.deadline), (Case::Unsure, guard.local_response().0));
    }
}
