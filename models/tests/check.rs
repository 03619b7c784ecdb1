//! Checks small configurations completely, and tests which faults make a check fail.

use std::collections::BTreeSet;

use fuseline_models::{CheckOptions, Exploration, Sighting, Size, WORLDS, World, check};

const EFFORT: CheckOptions = CheckOptions { threads: 2, all: false };

fn verdict(config: &'static World) -> Exploration {
    check(config, EFFORT, |_| {}).expect("a verdict")
}

fn named(name: &str) -> World {
    *World::named(name).expect("a configuration")
}

/// Returns the verdict on a configuration that a test makes.
fn verdict_of(config: World) -> Exploration {
    verdict(Box::leak(Box::new(config)))
}

#[track_caller]
fn assert_holds(name: &str) {
    let verdict = verdict(World::named(name).expect("a configuration"));
    assert!(verdict.violations.is_empty(), "{:#?}", verdict.violations);
    assert!(verdict.unmet.is_empty(), "{:#?}", verdict.unmet);
    assert_eq!(verdict.states, verdict.config.states, "{name}");
}

#[test]
fn one_cloud_and_two_timestamps_hold_eagerly() {
    assert_holds("1x2w1-eager");
}

#[test]
fn one_cloud_and_two_timestamps_hold_patiently() {
    assert_holds("1x2w1-patient");
}

#[test]
fn two_clouds_hold_eagerly() {
    assert_holds("2x1-eager");
}

#[test]
fn two_clouds_hold_patiently() {
    assert_holds("2x1-patient");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute unless it is built with --release")]
fn three_clouds_hold_eagerly() {
    assert_holds("3x1-short-eager");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute unless it is built with --release")]
fn three_clouds_hold_patiently() {
    assert_holds("3x1-short-patient");
}

#[test]
fn gates_hold() {
    assert_holds("gate");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute unless it is built with --release")]
fn the_ends_of_every_range_hold_eagerly() {
    assert_holds("edges-eager");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute unless it is built with --release")]
fn the_ends_of_every_range_hold_patiently() {
    assert_holds("edges-patient");
}

#[test]
fn environment_without_backlog_shows_no_shut_gate() {
    let verdict = verdict_of(World { backlogs: &[0], ..named("gate") });
    assert_eq!(verdict.unmet, [Sighting::GateShuts, Sighting::GateStays, Sighting::GateOpens]);
    assert!(!verdict.holds());
}

#[test]
fn one_instant_less_changes_the_states() {
    let verdict = verdict_of(World { clock: &[0, 1, 2, 3], ..named("1x2w1-eager") });
    assert_eq!(verdict.unmet, []);
    assert!(!verdict.holds());
}

#[test]
fn the_quick_configurations_show_every_sighting() {
    let quick = WORLDS.iter().filter(|config| config.size == Size::Quick);
    let shown: BTreeSet<Sighting> = quick.flat_map(World::sightings).collect();
    assert_eq!(shown, Sighting::ALL.iter().copied().collect());
}

#[test]
fn the_table_is_sound() {
    for (index, config) in WORLDS.iter().enumerate() {
        let name = config.name;
        assert!(WORLDS.iter().skip(index + 1).all(|other| other.name != name), "{name}");
        assert!(config.timestamps.is_sorted() && config.clock.is_sorted(), "{name}");
        assert!(config.states > 0, "{name}: state how many states there are");
    }
}
