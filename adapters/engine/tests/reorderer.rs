//! Checks that items come in the order of their timestamps, and that none waits longer than its
//! bound (E8, E9).

use std::time::{Duration, Instant};

use fuseline_engine::{Ordered, Reorderer};
use proptest::prelude::*;

const MS: Duration = Duration::from_millis(1);

fn ready<T>(orderer: &mut Reorderer<T>) -> Vec<Ordered<T>> {
    std::iter::from_fn(|| orderer.next_ready()).collect()
}

/// An item waits for earlier ones until it is due (E9).
#[test]
fn an_item_waits_for_earlier_ones_until_it_is_due() {
    let mut orderer = Reorderer::new(50 * MS, 10 * MS);
    let start = Instant::now();
    orderer.arrive(start, (0, true), None, "zero");
    orderer.arrive(start, (2, true), None, "two");
    assert_eq!(ready(&mut orderer), [Ordered::Item("zero")]);
    orderer.arrive(start + 20 * MS, (1, true), None, "one");
    assert_eq!(ready(&mut orderer), [Ordered::Item("one"), Ordered::Item("two")]);
    assert_eq!(orderer.next_due(), None);
    // Items 3 to 5 never come. At 60 ms, only the reserve is left of item 7's end-to-end deadline.
    orderer.arrive(start + 30 * MS, (6, true), None, "six");
    orderer.arrive(start + 30 * MS, (7, true), Some(start + 70 * MS), "seven");
    assert_eq!(orderer.next_due(), Some(start + 60 * MS));
    orderer.tick(start + Duration::from_nanos(59_999_999));
    assert_eq!(ready(&mut orderer), []);
    orderer.tick(start + 60 * MS);
    let expected = [Ordered::PassedOver(3..6), Ordered::Item("six"), Ordered::Item("seven")];
    assert_eq!(ready(&mut orderer), expected);
    orderer.arrive(start + 61 * MS, (4, true), None, "four");
    assert_eq!(ready(&mut orderer), [Ordered::Late("four")]);
}

/// Under progressive a timestamp's turn lasts until its last item (E9).
#[test]
fn revisions_go_at_once_while_it_is_their_turn() {
    let mut orderer = Reorderer::new(50 * MS, Duration::ZERO);
    let start = Instant::now();
    orderer.arrive(start, (0, false), None, "0 a");
    orderer.arrive(start, (1, false), None, "1 a");
    orderer.arrive(start, (1, true), None, "1 b");
    orderer.arrive(start + MS, (0, false), None, "0 b");
    assert_eq!(ready(&mut orderer), [Ordered::Item("0 a"), Ordered::Item("0 b")]);
    orderer.arrive(start + 2 * MS, (0, true), None, "0 c");
    let expected = [Ordered::Item("0 c"), Ordered::Item("1 a"), Ordered::Item("1 b")];
    assert_eq!(ready(&mut orderer), expected);
    orderer.arrive(start, (3, true), None, "3");
    orderer.end();
    assert_eq!(ready(&mut orderer), [Ordered::PassedOver(2..3), Ordered::Item("3")]);
}

/// The number of waiting items is bounded (E8).
#[test]
fn no_more_items_wait_than_there_is_room_for() {
    let mut orderer = Reorderer::new(Duration::MAX, Duration::ZERO);
    let now = Instant::now();
    for t in 1..=1025 {
        orderer.arrive(now, (2 * t, true), Some(now + MS), t);
    }
    assert_eq!(ready(&mut orderer), [Ordered::PassedOver(0..2), Ordered::Item(1)]);
}

proptest! {
    /// Items come out in order and once, and none waits beyond its bound (E9).
    #[test]
    fn whatever_comes_is_in_order_and_in_time(
        items in prop::collection::vec((0_u32..9, 0_u64..40), 1..200),
    ) {
        let mut orderer = Reorderer::new(20 * MS, Duration::ZERO);
        let mut now = Instant::now();
        let mut next = 0;
        let (mut came, mut went) = (0, 0);
        let mut last = std::collections::BTreeSet::new();
        for (wait, t) in items {
            now += wait * MS;
            came += 1;
            orderer.arrive(now, (t, last.insert(t)), None, (t, now));
            for ordered in ready(&mut orderer) {
                match ordered {
                    Ordered::Item((t, _)) => {
                        prop_assert!(t >= next);
                        next = t;
                        went += 1;
                    }
                    Ordered::PassedOver(passed) => {
                        prop_assert!(passed.start >= next && passed.end > passed.start);
                        next = passed.end;
                    }
                    Ordered::Late((t, _)) => {
                        prop_assert!(t <= next);
                        went += 1;
                    }
                }
            }
            prop_assert!(orderer.next_due().is_none_or(|due| due > now));
        }
        orderer.end();
        let rest = ready(&mut orderer).into_iter().filter(|it| !matches!(it, Ordered::PassedOver(_)));
        prop_assert_eq!(came, went + rest.count());
    }
}
