//! Tests the observations, the estimate from them, and the deadline of least loss.

use std::cell::Cell;
use std::time::Duration;

use fuseline_deadline::{
    Accuracy, Chosen, Constant, End, Expected, Figure, Guard, Impact, Invalid, Loss,
    MetresPerSecond, Observation, Observations, Parameters, Policy, Reason, Situation, Source,
    Survival, least_loss,
};

const LOCAL_MS: u64 = 300;
/// Four points of accuracy are worth 200 ms of waiting.
pub(crate) const ACCURACY: Accuracy = Accuracy { local: 42.0, cloud: 46.0, price_per_ms: 0.02 };

pub(crate) fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

pub(crate) fn observation(millis: u64, is_answered: bool, count: u64) -> Observation {
    Observation { response: ms(millis), is_answered, count }
}

pub(crate) fn survival<'a>(
    observations: &[Observation],
    under_way: &'a [Duration],
) -> Survival<'a, impl Iterator<Item = Observation> + Clone + use<'a>> {
    let mut sorted = observations.to_vec();
    sorted.sort_by_key(Observation::key);
    Survival::new(sorted.into_iter(), under_way)
}

fn policy<const WINDOW: usize>(probe_every: Option<u32>) -> Expected<Accuracy, WINDOW> {
    Expected::new(ACCURACY, ms(300), probe_every).unwrap()
}

/// Plays the next message: the cloud's result would come after `response` ms, or never if that is
/// `None`.
fn message(policy: &mut impl Policy, response: Option<u64>) -> Chosen {
    let decision = policy.decide(&Situation::at(MetresPerSecond(10.0)), ms(500));
    let answered = response.map(ms).filter(|response| *response < decision.deadline);
    policy.ended(answered.map_or(End::Censored(decision.deadline), End::Answered));
    decision
}

#[test]
fn the_estimate_of_a_small_sample() {
    let calls = [
        observation(1, true, 1),
        observation(2, false, 1),
        observation(3, true, 1),
        observation(3, false, 1),
        observation(5, true, 1),
        observation(9, false, 1),
    ];
    let steps: Vec<_> = survival(&calls, &[]).map(|step| (step.response, step.survival)).collect();
    let expected = [(ms(1), 5.0 / 6.0), (ms(3), 5.0 / 6.0 * 0.75), (ms(5), 5.0 / 6.0 * 0.75 * 0.5)];
    assert_eq!(steps, expected);
}

/// A call that was given up says only that its result took longer (T5).
#[test]
fn a_call_that_was_given_up_is_not_fast() {
    assert_eq!(survival(&[observation(310, false, 20)], &[]).next(), None);
    let mut lost = policy::<32>(None);
    (0..32).for_each(|_| lost.ended(End::Censored(ms(310))));
    assert_eq!(message(&mut lost, None).deadline, ms(LOCAL_MS));
}

#[test]
fn a_call_that_was_given_up_is_not_lost_either() {
    let calls =
        [observation(310, false, 1000), observation(340, true, 3), observation(500, false, 1)];
    let last = survival(&calls, &[]).last().unwrap();
    assert!((last.survival - 0.25).abs() < 1e-12, "only four calls were seen so long: {last:?}");
}

/// A call that failed will never have a result (T5).
#[test]
fn a_call_that_failed_is_never_answered() {
    let mut observations = Observations::<8>::new();
    observations.add(End::Failed(ms(1)));
    observations.add(End::Answered(ms(200)));
    let steps: Vec<_> = Survival::new(observations.sorted(), &[]).collect();
    assert_eq!((steps.len(), steps[0].survival), (1, 0.5));
}

#[test]
fn calls_under_way_show_an_outage_before_they_end() {
    let calls = [observation(320, true, 10)];
    let choose = |under_way: &[Duration]| {
        let loss = |source, response| {
            ACCURACY.loss(&Situation::at(MetresPerSecond(10.0)), source, response)
        };
        least_loss(survival(&calls, under_way), (ms(LOCAL_MS), ms(LOCAL_MS)), ms(500), loss)
            .deadline
    };
    assert_eq!(choose(&[]), ms(320) + Duration::from_nanos(1));
    assert_eq!(choose(&[ms(400); 90]), ms(LOCAL_MS));
    assert_eq!(choose(&[ms(10); 90]), choose(&[]), "too young to tell");
}

#[test]
fn waits_only_for_a_cloud_that_is_worth_it() {
    let mut policy = policy::<64>(Some(16));
    let first = message(&mut policy, Some(340));
    assert_eq!((first.deadline, first.reason), (ms(500), Reason::Probe));
    let second = message(&mut policy, Some(340));
    assert_eq!(second.deadline, ms(340) + Duration::from_nanos(1));
    assert!(
        matches!(second.reason, Reason::Expected { loss } if (loss - 6.8).abs() < 1e-9),
        "{second:?}"
    );
}

/// A cloud that is slower than local comes and goes. When a window of calls has passed since a
/// change, only calls since the change count (T6).
#[test]
fn returned_cloud_is_found_within_a_window() {
    const WINDOW: u32 = 64;
    let mut policy = policy::<{ WINDOW as usize }>(Some(16));
    let mut last_change = |response, deadline| {
        let mut changed = 0;
        for number in 1..=405 {
            let decision = message(&mut policy, response);
            if decision.reason != Reason::Probe && decision.deadline != deadline {
                changed = number;
            }
        }
        changed
    };
    let worth_it = ms(340) + Duration::from_nanos(1);
    for _ in 0..3 {
        let found = last_change(Some(340), worth_it);
        let left = last_change(None, ms(LOCAL_MS));
        println!("found after {found} messages, left after {left}");
        assert!(found <= WINDOW && left <= WINDOW, "{found}, {left}");
    }
}

/// Calls that are given up at the deadline hide how late their results would have been, but probes
/// show it.
#[test]
fn probes_keep_the_deadline_from_creeping_down() {
    let mut policy = policy::<64>(Some(16));
    let responses = (0..2000_u64).map(|number| 320 + number * 7919 % 60);
    let deadlines: Vec<_> =
        responses.map(|response| message(&mut policy, Some(response))).collect();
    let late = deadlines[100..].iter().filter(|decision| decision.deadline < ms(370)).count();
    assert!(late < 190, "{late} of 1900 deadlines leave out a sixth of the results");
}

#[test]
fn lost_cloud_costs_time_only_in_probes() {
    let mut policy = policy::<64>(None);
    for number in 0..1000 {
        let response = (number / 100 % 2 == 0).then_some(186);
        assert_eq!(message(&mut policy, response).deadline, ms(LOCAL_MS));
    }
}

/// The least loss may be far below the cap (T3).
#[test]
fn the_best_below_a_cap_is_not_the_cap() {
    let mut policy = policy::<4>(None);
    for millis in [400, 460, 460, 460] {
        policy.ended(End::Answered(ms(millis)));
    }
    let mut deadline = |cap| policy.decide(&Situation::at(MetresPerSecond(10.0)), ms(cap)).deadline;
    assert_eq!(deadline(500), ms(460) + Duration::from_nanos(1));
    assert_eq!(deadline(450), ms(LOCAL_MS), "a share of a quarter is not worth the wait");
    assert_eq!(deadline(250), ms(250));
}

#[test]
fn a_constant_caps_a_guard_that_caps_what_is_expected() {
    let guard = Guard::new(Parameters::default()).unwrap();
    let expected =
        Expected::<_, 16>::new(Impact::from(&guard), Duration::from_micros(301_700), None).unwrap();
    let mut policy = Constant(ms(800)).cap(guard.cap(expected));
    (0..16).for_each(|_| policy.ended(End::Answered(ms(600))));
    let mut at = |speed: f64| policy.decide(&Situation::at(MetresPerSecond(speed)), Duration::MAX);
    let rho = Duration::from_micros(301_700);
    assert_eq!(at(20.0).deadline, rho, "the guard allows too little to reach 600 ms");
    assert_eq!(at(22.0).deadline, ms(600) + Duration::from_nanos(1));
    assert_eq!(at(18.0).deadline, rho, "local alone stops as well, so waiting buys nothing");
    // A probe waits exactly as long as is allowed.
    let probing =
        Expected::<_, 16>::new(Impact::from(&guard), Duration::from_micros(301_700), Some(1))
            .unwrap();
    let mut policy = Constant(ms(800)).cap(guard.cap(probing));
    let decision = policy.decide(&Situation::at(MetresPerSecond(22.0)), Duration::MAX);
    assert_eq!((decision.deadline, decision.reason), (ms(800), Reason::Probe));
}

/// A cap that learns gets a report of each end (T3).
#[test]
fn a_cap_learns_from_the_calls_that_it_caps() {
    let learns = || Expected::<_, 16>::new(ACCURACY, ms(LOCAL_MS), None).unwrap();
    let (mut alone, mut capped) = (learns(), learns().cap(Constant(ms(800))));
    let decide = |policy: &mut dyn Policy| policy.decide(&Situation::UNKNOWN, ms(1000)).deadline;
    let before = decide(&mut capped);
    for policy in [&mut alone as &mut dyn Policy, &mut capped] {
        (0..16).for_each(|_| policy.ended(End::Answered(ms(400))));
    }
    assert_eq!(decide(&mut capped), decide(&mut alone));
    assert_ne!(decide(&mut capped), before);
}

#[test]
fn a_loss_that_is_no_number_decides_nothing() {
    let calls = [observation(200, true, 3), observation(350, true, 3)];
    for odd in [f64::NAN, f64::INFINITY] {
        let local = (ms(LOCAL_MS), ms(LOCAL_MS));
        let choice = least_loss(survival(&calls, &[]), local, ms(500), |_, _| odd);
        assert_eq!(choice.deadline, ms(LOCAL_MS));
    }
}

/// A policy that could not work is refused when it is made (T7).
#[test]
fn a_policy_that_could_not_work_is_refused() {
    let made =
        |local: Duration, probe_every| Expected::<_, 8>::new(ACCURACY, local, probe_every).err();
    assert_eq!(made(ms(300), Some(8)), None);
    assert_eq!(made(ms(300), Some(9)), Some(Invalid::Probes { every: 9, window: 8 }));
    assert_eq!(made(ms(300), Some(0)), Some(Invalid::Probes { every: 0, window: 8 }));
    let implausible = |figure, value| Some(Invalid::Implausible { figure, value });
    assert_eq!(made(ms(0), None), implausible(Figure::LocalResponse, 0.0));
    assert_eq!(made(ms(301_700), None), implausible(Figure::LocalResponse, 301.7));
    let price = Accuracy { price_per_ms: -0.1, ..ACCURACY };
    let refused = Expected::<_, 8>::new(price, ms(300), None).err();
    assert_eq!(refused, implausible(Figure::Price, -0.1));
    let share = Accuracy { cloud: f64::NAN, ..ACCURACY };
    assert!(Expected::<_, 8>::new(share, ms(300), None).is_err());
}

/// The loss is computed at most twice for each remembered call, and twice more. The test counts
/// instead of measuring time.
#[test]
fn a_decision_costs_no_more_after_a_million_calls() {
    let requested = Cell::new(0_u64);
    let loss = |situation: &Situation<'_>, source: Source, response: Duration| {
        requested.set(requested.get() + 1);
        ACCURACY.loss(situation, source, response)
    };
    let mut policy = Expected::<_, 128>::new(&loss, ms(300), None).unwrap();
    for number in 1..=1_000_000_u64 {
        policy.ended(End::Answered(Duration::from_micros(300_000 + number * 7919 % 190_000)));
        if [1000, 10_000, 1_000_000].contains(&number) {
            requested.set(0);
            policy.decide(&Situation::at(MetresPerSecond(10.0)), ms(500));
            assert!(
                (128..=2 * 128 + 1).contains(&requested.get()),
                "{} after {number}",
                requested.get()
            );
        }
    }
}
