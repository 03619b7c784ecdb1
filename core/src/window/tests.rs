use super::*;
use std::collections::BTreeMap;

/// `SplitMix64` by Steele and Vigna: a short generator that is random enough for tests.
struct SplitMix(u64);

impl SplitMix {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound
    }
}

fn due_at(nanos: u64) -> Entry<1> {
    let mut entry = Entry { slot: Slot::open(true), ..Entry::EMPTY };
    entry.set_due(Source::LOCAL, Instant::from_nanos(nanos));
    entry
}

const UNARMED: Entry<1> = Entry { slot: Slot::open(false), ..Entry::EMPTY };

/// Checks that each entry's index is there once, that each entry has the key of its timestamp, and
/// that the stored least keys are right.
fn check<const CAPACITY: usize>(window: &Window<1, CAPACITY>) {
    let open = &window.entry_indices.as_flattened()[window.start..window.end()];
    let empty = &window.free[..CAPACITY - window.len];
    let mut indices: std::vec::Vec<u16> = open.iter().chain(empty).copied().collect();
    indices.sort_unstable();
    assert!(indices.iter().copied().eq(0..u16::try_from(CAPACITY).unwrap()), "{indices:?}");
    for (index, timestamp) in open.iter().zip(&window.timestamps.as_flattened()[window.start..]) {
        let due = window.entry_at(*index).next_due();
        assert_eq!(window.keys[usize::from(*index)], DueKey::new(due, *timestamp));
    }
    for index in empty {
        assert_eq!(window.keys[usize::from(*index)], DueKey::NEVER);
    }
    let first =
        |keys: &[DueKey]| keys.iter().copied().min_by_key(|key| (key.due_minus_one, key.timestamp));
    let (mut below, mut above) = (&window.keys[..], &window.firsts[..]);
    for _ in 0..Window::<1, CAPACITY>::LEVELS {
        let (level, rest) = above.split_at(below.len().div_ceil(4));
        assert!(below.chunks(4).map(first).eq(level.iter().map(|key| Some(*key))));
        (below, above) = (level, rest);
    }
    assert_eq!(below.len(), 1);
    assert_eq!(below[0], window.first);
    assert_eq!(first(&window.keys), Some(window.first));
}

fn agree<const CAPACITY: usize>(window: &Window<1, CAPACITY>, model: &BTreeMap<u64, Option<u64>>) {
    check(window);
    assert!(window.iter().map(|(t, _)| t.as_u64()).eq(model.keys().copied()));
    assert_eq!(window.len(), model.len());
    let next = model.iter().filter_map(|(t, due)| Some(((*due)?, *t))).min();
    let found = window.next_due().zip(window.first_due());
    let found = found.map(|(due, index)| (due.as_nanos(), window.timestamp(index).as_u64()));
    assert_eq!(found, next);
}

/// Adds and removes random timestamps, sets and clears due instants, and compares the window with a
/// map.
fn churn<const CAPACITY: usize>(rounds: u64, check_every: u64) {
    let mut random = SplitMix(CAPACITY as u64);
    let mut window = Window::<1, CAPACITY>::new();
    let mut model = BTreeMap::new();
    let mut next = 0;
    // Phases of filling and draining reach every size.
    for round in 0..rounds {
        let filling = (round / (CAPACITY as u64 * 4)) % 2 == 0;
        let pick = |random: &mut SplitMix, model: &BTreeMap<u64, Option<u64>>| {
            let nth = usize::try_from(random.below(model.len().max(1) as u64)).unwrap();
            model.keys().nth(nth).copied()
        };
        let choice = random.below(10);
        if choice < if filling { 6 } else { 2 } {
            let due = (random.below(4) != 0).then(|| 1 + random.below(20));
            let added = window.push(Timestamp::new(next), due.map_or(UNARMED, due_at));
            assert_eq!(added, model.len() < CAPACITY);
            if added {
                model.insert(next, due);
            }
            next += 1 + random.below(3);
        } else if let Some(t) = pick(&mut random, &model) {
            let at = window.find(Timestamp::new(t)).unwrap();
            if choice < 8 {
                window.remove(at);
                model.remove(&t);
                assert!(window.find(Timestamp::new(t)).is_none());
            } else {
                let due = (random.below(3) != 0).then(|| 1 + random.below(20));
                // A due instant can only be added, as by an offer, or removed.
                let due = due.filter(|_| model[&t].is_none());
                match due.map(Instant::from_nanos) {
                    Some(due) => window.arm(at, Slot::open(true), Source::LOCAL, due),
                    None => window.set(at, Slot::open(false)),
                }
                model.insert(t, due);
            }
        }
        let sought = random.below(next + 2);
        assert_eq!(
            window.find(Timestamp::new(sought)).map(|at| window.timestamp(at).as_u64()),
            model.contains_key(&sought).then_some(sought)
        );
        if round % check_every == 0 {
            agree(&window, &model);
        }
    }
    agree(&window, &model);
}

#[test]
fn it_agrees_with_a_map_at_every_step_of_small_windows() {
    churn::<1>(2_000, 1);
    churn::<2>(5_000, 1);
    churn::<3>(5_000, 1);
    churn::<4>(20_000, 1);
    churn::<7>(20_000, 1);
    churn::<16>(20_000, 1);
    churn::<17>(20_000, 1);
}

#[test]
fn it_agrees_with_a_map_in_the_greatest_window() {
    churn::<1024>(60_000, 64);
    churn::<1000>(20_000, 64);
}

#[test]
fn equal_dues_go_by_timestamp_wherever_their_entries_are() {
    let mut window = Window::<1, 8>::new();
    for t in 0..8 {
        assert!(window.push(Timestamp::new(t), due_at(5)));
    }
    // The entries become free in this order, so the greater timestamp gets the lesser index.
    for t in [6, 3, 0] {
        window.remove(window.find(Timestamp::new(t)).unwrap());
    }
    for t in [8, 9, 10] {
        assert!(window.push(Timestamp::new(t), due_at(5)));
    }
    for t in [1, 2, 4, 5, 7, 8, 9, 10] {
        let first = window.first_due().unwrap();
        assert_eq!(window.timestamp(first), Timestamp::new(t));
        window.set(first, Slot::open(false));
    }
    assert_eq!(window.next_due(), None);
}

#[test]
fn due_at_the_end_of_the_clock_is_not_taken_for_none() {
    let mut window = Window::<1, 4>::new();
    assert!(window.push(Timestamp::new(1), UNARMED));
    assert!(window.push(Timestamp::new(2), due_at(u64::MAX)));
    assert!(window.push(Timestamp::new(3), due_at(u64::MAX)));
    assert_eq!(window.next_due(), Some(Instant::END));
    assert_eq!(window.timestamp(window.first_due().unwrap()), Timestamp::new(2));
}

#[test]
fn an_earlier_due_of_another_source_is_noticed_and_a_later_one_is_not() {
    let mut window = Window::<1, 4>::new();
    assert!(window.push(Timestamp::new(1), due_at(10)));
    assert!(window.push(Timestamp::new(2), due_at(20)));
    let cloud = Source::new(1).unwrap();
    let both = Slot::open(true).offer(cloud).0;
    let arm = |window: &mut Window<1, 4>, t, due| {
        let index = window.find(Timestamp::new(t)).unwrap();
        window.arm(index, both, cloud, Instant::from_nanos(due));
        check(window);
        let first = window.first_due().map(|index| window.timestamp(index).as_u64());
        (window.next_due().map(Instant::as_nanos), first)
    };
    assert_eq!(arm(&mut window, 2, 5), (Some(5), Some(2)));
    assert_eq!(arm(&mut window, 1, 30), (Some(5), Some(2)));
    window.set(window.find(Timestamp::new(2)).unwrap(), Slot::open(true));
    assert_eq!(window.next_due(), Some(Instant::from_nanos(10)));
}
