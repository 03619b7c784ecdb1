//! Tests the core's public surface beside its decisions: queries, equality, conversions and texts.

use std::collections::BTreeSet;
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};
use std::time::Duration;

use fuseline_core::{
    Admission, At, Cloud, Commit, ConfigError, Deadline, Fusion, Gate, Instant, InvalidSlot,
    OfferRefusal, Opening, Outcome, Priorities, Priority, Ready, Slot, Source, Sources, Timestamp,
};

type Machine = Fusion<3, 4>;

const NEAR: Cloud = Cloud::new(Priority::new(5), 31);
const FAR: Cloud = Cloud::new(Priority::new(9), 31);

fn machine() -> Machine {
    Machine::new(2, Commit::Patient, &[FAR, NEAR]).expect("a sound configuration")
}

fn ready(machine: &mut Machine, now: u64) -> Ready<'_, 3, 4> {
    match machine.at(Instant::from_nanos(now)) {
        At::Ready(ready) => ready,
        At::Fired(firing) => panic!("{firing:?}"),
    }
}

/// Returns a machine with timestamp 3 open and, if `requested` is given, requested of that cloud
/// at 10 ns.
fn opened(machine: Machine, requested: Option<Cloud>) -> Machine {
    let mut machine = machine;
    let mut ready = ready(&mut machine, 10);
    assert_eq!(ready.open(Timestamp::new(3), None), Opening::Accepted);
    if let Some(cloud) = requested {
        assert!(matches!(offered(&mut ready, cloud, 0), Admission::Admitted { .. }));
    }
    machine
}

/// Offers timestamp 3 to `cloud`, with a deadline of a millisecond.
fn offered(ready: &mut Ready<'_, 3, 4>, cloud: Cloud, backlog: u64) -> Admission {
    ready.offer(Timestamp::new(3), cloud.priority, Deadline::from_millis(1), backlog)
}

/// Gives `source`'s result for timestamp 3, which must be forwarded. Returns the clouds that it
/// cancels.
fn forwarded(machine: &mut Machine, source: Priority) -> Priorities<3> {
    match ready(machine, 10).result(Timestamp::new(3), source) {
        Outcome::Forwarded { by, cancelled } if by == source => cancelled,
        other => panic!("{other:?}"),
    }
}

fn sources(members: &[u8]) -> Sources {
    members.iter().filter_map(|index| Source::new(*index)).collect()
}

#[test]
fn machine_reports_its_configuration_and_state() {
    let fresh = machine();
    assert_eq!((fresh.window(), fresh.commit()), (2, Commit::Patient));
    assert_eq!(fresh.clouds(), sources(&[1, 2]));
    assert_eq!((fresh.now(), fresh.newest(), fresh.len()), (Instant::START, None, 0));
    assert!(fresh.is_empty());

    let machine = opened(fresh, Some(FAR));
    assert_eq!(machine.newest(), Some(Timestamp::new(3)));
    assert_eq!((machine.now(), machine.len()), (Instant::from_nanos(10), 1));
    assert!(!machine.is_empty());
    let due = Instant::from_nanos(1_000_010);
    assert_eq!(machine.due(Timestamp::new(3), FAR.priority), Some(due));
    assert_eq!(machine.due(Timestamp::new(3), NEAR.priority), None);
    assert_eq!(machine.due(Timestamp::new(3), Priority::new(6)), None);
    assert_eq!(machine.due(Timestamp::new(4), FAR.priority), None);
    let slot = machine.slot(Timestamp::new(3)).expect("it is open");
    assert_eq!(slot.requested(), sources(&[0, 2]));
    assert_eq!((slot.pending(), slot.armed()), (sources(&[0, 2]), sources(&[2])));
    assert_eq!(slot.cached(), Sources::EMPTY);
    assert_eq!(machine.open().collect::<Vec<_>>(), [(Timestamp::new(3), slot)]);
    assert_eq!(machine.gate(FAR.priority), Gate::new(31, 30));
    assert_eq!(machine.gate(Priority::LOCAL), None);
    assert_eq!(machine.gate(Priority::new(6)), None);
}

#[test]
fn machines_that_differ_in_anything_are_not_equal() {
    let clouds = [NEAR, FAR];
    let new = |window, commit, clouds: &[Cloud]| {
        Machine::new(window, commit, clouds).expect("a sound configuration")
    };
    let slower = Cloud { limit: 32, ..NEAR };
    // Equals `retired`, except that it never opened a timestamp.
    let mut later = machine();
    let _ = ready(&mut later, 10);
    let mut retired = opened(machine(), None);
    assert!(forwarded(&mut retired, Priority::LOCAL).is_empty());
    let mut shut = opened(machine(), None);
    assert!(matches!(offered(&mut ready(&mut shut, 10), FAR, 31), Admission::Refused(_)));
    let all = [
        machine(),
        new(3, Commit::Patient, &clouds),
        new(2, Commit::Eager, &clouds),
        new(2, Commit::Patient, &clouds[..1]),
        new(2, Commit::Patient, &[slower, FAR]),
        later,
        opened(machine(), None),
        opened(machine(), Some(NEAR)),
        opened(machine(), Some(FAR)),
        shut,
        retired,
    ];
    let build = BuildHasherDefault::<DefaultHasher>::default();
    let hashes: BTreeSet<u64> = all.iter().map(|machine| build.hash_one(machine)).collect();
    assert_eq!(hashes.len(), all.len());
    for (i, one) in all.iter().enumerate() {
        for (j, other) in all.iter().enumerate() {
            assert_eq!(one == other, i == j, "{one:?} and {other:?}");
        }
    }
}

#[test]
fn deadlines_convert_and_saturate() {
    assert_eq!(Deadline::from_millis(2).as_nanos(), 2_000_000);
    assert_eq!(Deadline::from_millis(u64::MAX).as_nanos(), u64::MAX);
    assert_eq!(Deadline::from(Duration::from_micros(3)).as_nanos(), 3_000);
    assert_eq!(Deadline::from(Duration::MAX).as_nanos(), u64::MAX);
}

#[test]
fn sets_of_sixteen_sources_report_their_members() {
    assert_eq!(Source::new(15).map(Source::index), Some(15));
    assert_eq!(Source::new(16), None);
    let set = sources(&[0, 2, 15]);
    assert_eq!(set.bits(), 0b1000_0000_0000_0101);
    assert_eq!(Sources::from_bits(set.bits()), set);
    assert_eq!(set.least(), Some(Source::LOCAL));
    assert_eq!(Sources::EMPTY.least(), None);
    assert_eq!(format!("{set:?}"), "{0, 2, 15}");
}

/// Compares all pairs of sets over the two ends of the range with a set of the standard library.
#[test]
fn sets_of_sources_do_as_sets_do() {
    let ends = [0, 1, 2, 14, 15];
    let subsets: Vec<BTreeSet<u8>> = (0..1_u32 << ends.len())
        .map(|chosen| {
            (0..).zip(ends).filter(|(i, _)| chosen >> i & 1 == 1).map(|(_, e)| e).collect()
        })
        .collect();
    let packed = |set: &BTreeSet<u8>| sources(&set.iter().copied().collect::<Vec<_>>());
    for one in &subsets {
        let set = packed(one);
        assert_eq!(set.iter().map(Source::index).collect::<BTreeSet<_>>(), *one);
        assert_eq!(set.greatest().map(Source::index), one.last().copied());
        assert_eq!(set.least().map(Source::index), one.first().copied());
        assert_eq!(set.is_empty(), one.is_empty());
        for index in ends {
            let source = Source::new(index).expect("within the range");
            assert_eq!(set.contains(source), one.contains(&index));
            assert_eq!(set.any_above(source), one.range(index + 1..).next().is_some());
            assert_eq!(set.with(source), packed(&(one | &BTreeSet::from([index]))));
            assert_eq!(set.without(source), packed(&(one - &BTreeSet::from([index]))));
        }
        for other in &subsets {
            let other_set = packed(other);
            assert_eq!(set.union(other_set), packed(&(one | other)));
            assert_eq!(set.intersection(other_set), packed(&(one & other)));
            assert_eq!(set.difference(other_set), packed(&(one - other)));
            assert_eq!(set.contains_all(other_set), other.is_subset(one));
        }
    }
}

#[test]
fn the_cancelled_are_a_set_of_priorities() {
    let beaten = || {
        let mut machine = opened(machine(), Some(NEAR));
        assert!(matches!(
            offered(&mut ready(&mut machine, 10), FAR, 0),
            Admission::Admitted { .. }
        ));
        forwarded(&mut machine, FAR.priority)
    };
    let cancelled = beaten();
    assert!(cancelled.contains(NEAR.priority) && !cancelled.contains(FAR.priority));
    assert!(!cancelled.is_empty());
    assert_eq!(cancelled.sources(), sources(&[1]));
    assert_eq!(cancelled, beaten());
    let alone = forwarded(&mut opened(machine(), None), Priority::LOCAL);
    assert!(alone.is_empty());
    assert_ne!(cancelled, alone);
    assert_eq!(format!("{cancelled:?} {alone:?}"), "{5} {}");
}

#[test]
fn errors_say_what_is_wrong() {
    let texts = [
        (ConfigError::Window { window: 0, capacity: 4 }, "a window of 0; it must be from 1 to 4"),
        (ConfigError::TooManyClouds { clouds: 4, capacity: 3 }, "4 clouds; there can be at most 3"),
        (ConfigError::LocalPriority, "a cloud with priority 0; that is local's"),
        (ConfigError::DuplicatePriority(Priority::new(7)), "two clouds with priority 7"),
        (ConfigError::Gate(Priority::new(5)), "cloud 5: its gate must resume below its limit"),
    ];
    for (error, text) in texts {
        assert_eq!(error.to_string(), text);
    }
    let texts = [
        (InvalidSlot::LocalNotRequested, "local is not requested"),
        (InvalidSlot::NotRequested, "a pending or cached source is not requested"),
        (InvalidSlot::PendingAndCached, "a source is both pending and cached"),
        (InvalidSlot::NothingPending, "nothing is pending"),
        (InvalidSlot::Unforwarded, "nothing pending outranks the best available result"),
        (
            InvalidSlot::Outranked,
            "the last output is not the only one, or outranks something pending",
        ),
        (InvalidSlot::Timers, "the armed timers are not those that the commit rule keeps"),
    ];
    for (error, text) in texts {
        assert_eq!(error.to_string(), text);
    }
}

#[test]
fn a_machine_shows_what_is_open() {
    let mut machine = opened(machine(), Some(NEAR));
    let slot = format!("{:?}", Slot::open(false).offer(Source::new(1).expect("a cloud")).0);
    let shown = format!(
        "Fusion {{ commit: Patient, window: 2, now: Instant(10), newest: Some(Timestamp(3)), \
         next_due: Some(Instant(1000010)), open: {{Timestamp(3): {slot}}}, .. }}"
    );
    assert_eq!(format!("{machine:?}"), shown);
    assert_eq!(format!("{:?}", ready(&mut machine, 10)), format!("Ready({shown})"));
}

/// Local has no gate, and an offer to it is unknown (A19).
#[test]
fn local_has_no_gate_and_its_offer_is_unknown() {
    let machine = opened(machine(), None);
    let (t, deadline) = (Timestamp::new(3), Deadline::from_millis(1));
    let refusal = |p| machine.offer_refusal(t, p, deadline, 0);
    assert_eq!(refusal(NEAR.priority), None);
    assert_eq!(refusal(Priority::LOCAL), Some(OfferRefusal::Unknown));
    assert_eq!(machine.gate(Priority::LOCAL), None);
}
