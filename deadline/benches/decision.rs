//! Measures the time of one decision, and of reporting one call's end, after ever longer runs. It
//! shows that old calls cost nothing.

use std::hint::black_box;
use std::time::{Duration, Instant};

use fuseline_deadline::{
    End, Expected, Guard, Impact, MetresPerSecond, Parameters, Policy, Situation,
};

/// The number of measurements of each figure. The least is reported, because other programs only
/// ever add time.
const TIMES: u32 = 300;
/// The number of decisions in a measurement.
const DECISIONS: u32 = 100;

fn main() {
    println!("window    after calls    ns/decision    ns/end    decision, of the first");
    row::<64>();
    row::<256>();
    row::<1024>();
}

fn row<const WINDOW: usize>() {
    let guard = Guard::new(Parameters::default()).expect("the default is sound");
    let impact = Impact::from(&guard);
    let expected = Expected::<_, WINDOW>::new(impact, Duration::from_micros(301_700), None)
        .expect("a sound response");
    let mut policy = guard.cap(expected);
    // At 22 m/s waiting may pay, so the policy looks at every observation.
    let situation = Situation::at(MetresPerSecond(22.0));
    let (mut calls, mut first) = (0_u64, None);
    for after in [10_000, 100_000, 1_000_000, 10_000_000] {
        while calls < after {
            policy.ended(end(calls));
            calls += 1;
        }
        let decision = least(|_| decide(&mut policy, &situation));
        let reported = least(|number| policy.ended(black_box(end(u64::from(number)))));
        let ratio = decision / *first.get_or_insert(decision);
        println!("{WINDOW:6} {after:14} {decision:14.0} {reported:9.0} {ratio:25.2}");
    }
}

/// Makes one decision. It is a function of its own so that an instruction counter can point at it.
#[inline(never)]
fn decide(policy: &mut dyn Policy, situation: &Situation<'_>) {
    black_box(policy.decide(black_box(situation), Duration::MAX));
}

/// Returns the end of a call: a result after 100 to 900 ms or, one time in eight, a call that was
/// given up.
fn end(number: u64) -> End {
    let response = Duration::from_micros(100_000 + number * 7919 % 800_000);
    if number.is_multiple_of(8) { End::Censored(response) } else { End::Answered(response) }
}

/// Returns the least mean time in nanoseconds.
fn least(mut step: impl FnMut(u32)) -> f64 {
    let measure = |_| {
        let start = Instant::now();
        (0..DECISIONS).for_each(&mut step);
        start.elapsed().as_secs_f64() * 1e9 / f64::from(DECISIONS)
    };
    (0..TIMES).map(measure).fold(f64::INFINITY, f64::min)
}
