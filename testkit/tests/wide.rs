//! Tests runs with many clouds and unusual numbers.

use fuseline_testkit::{Generator, Run, RunContext};

const GENERATOR: Generator = Generator { seed: 1, commit: None, clouds: 15 };

fn runs() -> impl Iterator<Item = Run> {
    (0..300).map(|number| GENERATOR.wide(number))
}

#[test]
fn a_number_always_makes_the_same_wide_run() {
    assert_eq!(GENERATOR.wide(17), GENERATOR.wide(17));
    assert_ne!(GENERATOR.wide(17), GENERATOR.wide(18));
    assert_ne!(GENERATOR.wide(17), GENERATOR.run(17));
}

#[test]
fn wide_runs_have_every_count_and_neighbours() {
    let counts: std::collections::BTreeSet<usize> =
        runs().map(|run| run.header.clouds.len()).collect();
    assert!(counts.into_iter().eq(1..=15));
    let has = |p: u16| {
        runs().any(|run| {
            let has = |p| run.header.clouds.iter().any(|cloud| cloud.p == p);
            has(p) && has(p + 1)
        })
    };
    assert!([1, 9, 99, 255, 999, 9_999, 32_767, u16::MAX - 1].into_iter().all(has));
}

#[test]
fn no_two_clouds_of_a_wide_run_have_one_priority() {
    for run in runs() {
        let clouds = &run.header.clouds;
        let all: std::collections::BTreeSet<u16> = clouds.iter().map(|it| it.p).collect();
        assert_eq!(all.len(), clouds.len());
        assert!(clouds.iter().all(|it| it.p > 0 && it.resume < it.limit));
    }
}

#[test]
fn long_wide_runs_make_requests_to_the_end() {
    let longs = runs().filter(|run| run.inputs.len() > 1_000);
    let requests_late = |run: Run| {
        let (mut context, mut count) = (RunContext::new(&run.header), 0);
        for (i, input) in run.inputs.iter().enumerate() {
            let before = context.requested().len();
            context.apply(input);
            count += usize::from(i > 600 && context.requested().len() > before);
        }
        assert!(context.now() < u64::from(u32::MAX), "the clock is at {}", context.now());
        count
    };
    let counts: Vec<usize> = longs.map(requests_late).collect();
    assert!((15..25).contains(&counts.len()), "{counts:?}");
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
}
