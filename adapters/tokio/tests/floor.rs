//! Tests in virtual time that clouds never cost a pipeline a result that it has without them (E11).
//! `FLOOR_SEED=N` repeats one pair of runs, and `FLOORS=N` plays N pairs.

use tokio::runtime::Builder;

use crate::drawn_floor::{Breach, COUNTEREXAMPLES, lost};

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|number| number.parse().expect("a number"))
}

fn play(seed: u64, breach: Breach) -> (Vec<String>, usize) {
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
    runtime.unwrap().block_on(lost(seed, breach))
}

/// A message that is answered in time on board alone is also answered with clouds (E11).
#[test]
fn clouds_take_no_result_from_a_pipeline() {
    let seeds = match number("FLOOR_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("FLOORS").unwrap_or(300),
    };
    let mut answered = 0;
    for seed in seeds {
        let (lost, count) = play(seed, Breach::None);
        answered += count;
        assert!(lost.is_empty(), "FLOOR_SEED={seed}: {lost:#?}");
    }
    assert!(answered > 0, "no message was answered on board");
}

/// If any one condition of E11 is broken, clouds can cost a result.
#[test]
fn each_condition_of_the_floor_is_needed() {
    for (breach, seed) in COUNTEREXAMPLES {
        let (lost, _) = play(seed, breach);
        let other = || (0..2_000).find(|seed| !play(*seed, breach).0.is_empty());
        assert!(!lost.is_empty(), "{breach:?}: {seed} loses nothing, but {:?} does", other());
    }
}
