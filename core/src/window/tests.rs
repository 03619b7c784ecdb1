use super::*;
use std::collections::BTreeMap;
use std::vec::Vec;

/// Steele and Vigna's `SplitMix64`, a few lines of good enough randomness.
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

/// Checks order, balance, parents and what each node knows of the dues below; returns the height.
fn check<const CAPACITY: usize>(
    window: &Window<1, CAPACITY>,
    at: Place,
    up: Place,
    seen: &mut Vec<u64>,
) -> u8 {
    if at == NIL {
        return 0;
    }
    let node = *window.node(at);
    assert_eq!(node.up, up);
    let left = check(window, node.left, at, seen);
    seen.push(node.timestamp.as_u64());
    let right = check(window, node.right, at, seen);
    assert!(left.abs_diff(right) <= 1, "out of balance: {left} and {right}");
    assert_eq!(node.height, left.max(right) + 1);
    assert_eq!(node.due, window.entry(at).next_due());
    let below = [node.due, window.node(node.left).below, window.node(node.right).below];
    assert_eq!(node.below, below.into_iter().flatten().min());
    node.height
}

fn agree<const CAPACITY: usize>(window: &Window<1, CAPACITY>, model: &BTreeMap<u64, Option<u64>>) {
    let mut seen = Vec::new();
    let height = check(window, window.root, NIL, &mut seen);
    assert!(usize::from(height) <= MAX_HEIGHT);
    assert!(seen.iter().eq(model.keys()), "{seen:?}");
    assert_eq!(window.len(), model.len());
    let last = (window.last != NIL).then(|| window.timestamp(window.last).as_u64());
    assert_eq!(last, model.keys().next_back().copied());
    let next = model.iter().filter_map(|(t, due)| Some(((*due)?, *t))).min();
    let found = window
        .next_due()
        .map(|due| (due.as_nanos(), window.timestamp(window.first_due_at(due)).as_u64()));
    assert_eq!(found, next);
}

/// Random timestamps in and out, dues set and cleared, against a map.
fn churn<const CAPACITY: usize>(rounds: u64, check_every: u64) {
    let mut random = SplitMix(CAPACITY as u64);
    let mut window = Window::<1, CAPACITY>::new();
    let mut model = BTreeMap::new();
    let mut next = 0;
    // Phases of filling and draining, so that all sizes occur.
    for round in 0..rounds {
        let filling = (round / (CAPACITY as u64 * 4)) % 2 == 0;
        let pick = |random: &mut SplitMix, model: &BTreeMap<u64, Option<u64>>| {
            let nth = usize::try_from(random.below(model.len().max(1) as u64)).unwrap();
            model.keys().nth(nth).copied()
        };
        let choice = random.below(10);
        if choice < if filling { 6 } else { 2 } {
            let due = (random.below(4) != 0).then(|| random.below(20));
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
                let due = (random.below(3) != 0).then(|| random.below(20));
                // A due can only be added, as by an offer, or taken away.
                let due = due.filter(|_| model[&t].is_none());
                match due.map(Instant::from_nanos) {
                    Some(due) => window.arm(at, Slot::open(true), Source::LOCAL, due),
                    None => window.set(at, Slot::open(false)),
                }
                model.insert(t, due);
            }
        }
        let asked = random.below(next + 2);
        assert_eq!(
            window.find(Timestamp::new(asked)).map(|at| window.timestamp(at).as_u64()),
            model.contains_key(&asked).then_some(asked)
        );
        assert_eq!(
            window.at_least(Timestamp::new(asked)).map(|(t, _)| t.as_u64()),
            model.range(asked..).next().map(|(t, _)| *t)
        );
        if round % check_every == 0 {
            agree(&window, &model);
        }
    }
    agree(&window, &model);
}

#[test]
fn tree_agrees_with_a_map_at_every_step_of_small_windows() {
    churn::<1>(2_000, 1);
    churn::<2>(5_000, 1);
    churn::<3>(5_000, 1);
    churn::<4>(20_000, 1);
    churn::<7>(20_000, 1);
    churn::<16>(20_000, 1);
}

#[test]
fn tree_agrees_with_a_map_in_the_greatest_window() {
    churn::<1024>(60_000, 64);
}

/// The shape for which `MAX_HEIGHT` is made: the sparsest tree, by taking out what balance can spare.
#[test]
fn sparse_tree_stays_within_the_height_that_loops_run_to() {
    let mut window = Window::<1, 1024>::new();
    let mut model = BTreeMap::new();
    for t in 0..1024 {
        assert!(window.push(Timestamp::new(t), due_at(2048 - t)));
        model.insert(t, Some(2048 - t));
    }
    for stride in [2_u64, 3, 5, 7] {
        for t in (0..1024).filter(|t| t % stride == 1) {
            if let Some(at) = window.find(Timestamp::new(t)) {
                window.remove(at);
                model.remove(&t);
            }
        }
        agree(&window, &model);
    }
}

#[test]
fn due_at_the_end_of_the_clock_is_not_taken_for_none() {
    let mut window = Window::<1, 4>::new();
    assert!(window.push(Timestamp::new(1), UNARMED));
    assert!(window.push(Timestamp::new(2), due_at(u64::MAX)));
    assert!(window.push(Timestamp::new(3), due_at(u64::MAX)));
    assert_eq!(window.next_due(), Some(Instant::END));
    assert_eq!(window.timestamp(window.first_due_at(Instant::END)), Timestamp::new(2));
}
