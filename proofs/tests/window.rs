//! Compares the window of the proofs with the shipped window.

use fuseline_proofs::Sources;
use fuseline_proofs::comparison::{cells_do_what_arrays_do, has_its_levels};

/// The cells of `src/cells.rs` do what the arrays of the shipped window do, and meet the conditions
/// that harnesses start from.
#[test]
fn cells_do_what_arrays_do_on_random_windows() {
    let report = kani::native::random(cells_do_what_arrays_do, 1, 100_000)
        .unwrap_or_else(|failure| panic!("{}: {:?}", failure.message, failure.location));
    assert_eq!(report.accepted, 100_000);
    assert!(report.rejected < report.accepted / 2, "most runs are left out: {}", report.rejected);
    for ((_, cover), times) in &report.covers {
        assert!(*times > 0, "it never happened: {cover}");
    }
}

/// The harnesses of the window have a few capacities. This test checks, for all capacities, what
/// the code derives from a capacity.
#[test]
fn every_capacity_has_its_levels() {
    macro_rules! have_levels {
        ($($high:literal)+; $low:tt) => { $(have_levels!(@ $high $low);)+ };
        (@ $high:literal ($($low:literal)+)) => {
            $(assert!(const { has_its_levels::<{ $high * 32 + $low + 1 }>() }, "{}", $high * 32 + $low + 1);)+
        };
    }
    have_levels!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31;
        (0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31));
}

/// The earliest due instant of a timestamp is the least of its armed timers, because each of them
/// is looked at exactly once.
#[test]
fn every_set_has_its_members_once_in_ascending_order() {
    for bits in 0..=u16::MAX {
        let mut members = Sources::from_bits(bits).iter().map(|source| usize::from(source.index()));
        assert!((0..16).filter(|bit| bits >> bit & 1 != 0).eq(&mut members), "{bits:#b}");
        assert_eq!(members.next(), None);
    }
}
