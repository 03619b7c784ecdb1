//! Messages with values, on one thread.

use std::sync::Arc;

use fuseline_core::{Cloud, Commit, ConfigError, Deadline, Instant, Outcome, Priority, Timestamp};
use fuseline_threads::{Shared, ValueOwner};

const WEST: Priority = Priority::new(1);
const START: Instant = Instant::START;
const TEN: Instant = Instant::from_nanos(10);

fn shared() -> Shared<1, 1> {
    Shared::new(1, Commit::Eager, &[Cloud::new(WEST, 31)]).expect("a sound configuration")
}

#[test]
fn timers_that_fire_hand_out_the_value_that_is_held() {
    let mut shared = shared();
    let mut intake = ValueOwner::<&str, 1, 1>::new(&mut shared);
    let (message, local) = intake.open(START, Timestamp::new(0), None).expect("it is new");
    let (_, asked) = intake.offer(START, &message, WEST, Deadline::from_nanos(10), 0);
    let (_west, due) = asked.expect("the gate is open");
    assert_eq!((message.next_due(), due), (Some(TEN), TEN));
    assert_eq!(local.result(START, "local").outcome, Outcome::Held);
    assert_eq!(message.expire(Instant::from_nanos(9)), None);
    let (firing, value) = message.expire(TEN).expect("it is due");
    assert_eq!((firing.due, value, message.next_due()), (TEN, Some("local"), None));
}

/// Timers that are due fire before the offer is decided (F5).
#[test]
fn offer_hands_out_what_its_timers_forward() {
    let mut shared = shared();
    let mut intake = ValueOwner::<&str, 1, 1>::new(&mut shared);
    let (message, local) = intake.open(START, Timestamp::new(0), None).expect("it is new");
    let (_, asked) = intake.offer(START, &message, WEST, Deadline::from_nanos(10), 0);
    assert!(asked.is_ok() && local.result(START, "local").outcome == Outcome::Held);
    let (fired, asked) = intake.offer(TEN, &message, WEST, Deadline::from_nanos(10), 0);
    let (firing, value) = fired.expect("it is due");
    assert_eq!((firing.due, value), (TEN, Some("local")));
    assert!(asked.is_err(), "the message is retired");
}

/// Two clouds with the same priority are refused (A10).
#[test]
fn two_clouds_of_one_priority_are_refused() {
    let clouds = [Cloud::new(WEST, 31); 2];
    let refused = Shared::<2, 1>::new(1, Commit::Eager, &clouds).err();
    assert_eq!(refused, Some(ConfigError::DuplicatePriority(WEST)));
}

#[test]
fn drops_discarded_value_when_place_is_reused() {
    let mut shared = shared();
    let mut intake = ValueOwner::<Arc<str>, 1, 1>::new(&mut shared);
    let discarded: Arc<str> = "local".into();
    let (message, local) = intake.open(START, Timestamp::new(0), None).expect("it is new");
    let (_, asked) = intake.offer(START, &message, WEST, Deadline::from_nanos(10), 0);
    let (west, _) = asked.expect("the gate is open");
    assert_eq!(local.result(START, Arc::clone(&discarded)).outcome, Outcome::Held);
    assert_eq!(west.result(START, "west".into()).forwarded.as_deref(), Some("west"));
    drop(message);
    assert_eq!(Arc::strong_count(&discarded), 2);
    let opened = intake.open(START, Timestamp::new(1), None);
    assert!(opened.is_ok() && Arc::strong_count(&discarded) == 1, "it is still kept");
}

/// A late value is superseded and does not replace the next message's value (F3).
#[test]
fn late_value_does_not_replace_the_next_one() {
    let mut shared = shared();
    let mut intake = ValueOwner::<&str, 1, 1>::new(&mut shared);
    let (message, late) = intake.open(START, Timestamp::new(0), None).expect("it is new");
    let (_, asked) = intake.offer(START, &message, WEST, Deadline::from_nanos(10), 0);
    let (west, _) = asked.expect("the gate is open");
    assert_eq!(west.result(START, "west").forwarded, Some("west"));
    let (message, local) = intake.open(START, Timestamp::new(1), None).expect("it is new");
    let (_, asked) = intake.offer(START, &message, WEST, Deadline::from_nanos(10), 0);
    assert!(asked.is_ok() && local.result(START, "local").outcome == Outcome::Held);
    assert_eq!(late.result(START, "late").unused, Some("late"));
    let (_, value) = message.expire(TEN).expect("it is due");
    assert_eq!(value, Some("local"));
}

#[test]
fn messages_and_calls_are_printed_by_their_tickets() {
    let mut shared = shared();
    let mut intake = ValueOwner::<(), 1, 1>::new(&mut shared);
    let (message, local) = intake.open(START, Timestamp::new(7), None).expect("it is new");
    for printed in [format!("{message:?}"), format!("{local:?}")] {
        assert!(printed.contains("MessageId") && printed.contains('7'), "{printed}");
    }
    assert!(format!("{intake:?}").starts_with("ValueOwner(Owner"), "{intake:?}");
}
