//! The tree of open timestamps: from any tree of up to four, each way to change it and each question to it.
//!
//! Every shape that balance allows is taken, nine in all, with any timestamps, sets and due instants. Where a node lies in
//! the arrays is fixed: the tree compares places with each other and with none, and never orders them.

use crate::Admission;
use crate::any::{
    any_case, any_commit, any_deadline, any_entry, any_gate, any_instant, any_slot, any_source,
    any_timestamp, earliest, least,
};
use crate::clouds::Clouds;
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::priority::Priority;
use crate::slot::Cause;
use crate::source::Source;
use crate::time::{Instant, Timestamp};
use crate::told;
use crate::valid::{in_order, is_tree, same_node};
use crate::window::{Place, Window};

/// The tree knows one due instant of each timestamp, the earliest. Local's is enough for it to be any, or none; that
/// it is the earliest of several, `fusion` shows.
type Tree = Window<0, 4>;

/// Calls a function for each shape, of which one is any.
macro_rules! any_shape {
    ($harness:ident) => {
        match any_case(9) {
            0 => $harness::<0>(),
            1 => $harness::<1>(),
            2 => $harness::<2>(),
            3 => $harness::<3>(),
            4 => $harness::<4>(),
            5 => $harness::<5>(),
            6 => $harness::<6>(),
            7 => $harness::<7>(),
            _ => $harness::<8>(),
        }
    };
}

/// The same for each shape of up to three nodes, or of four.
macro_rules! any_shape_of {
    (three, $harness:ident) => {
        match any_case(5) {
            0 => $harness::<0>(),
            1 => $harness::<1>(),
            2 => $harness::<2>(),
            3 => $harness::<3>(),
            _ => $harness::<4>(),
        }
    };
    (four, $harness:ident) => {
        match any_case(4) {
            0 => $harness::<5>(),
            1 => $harness::<6>(),
            2 => $harness::<7>(),
            _ => $harness::<8>(),
        }
    };
}

/// Calls a function for each node of each shape with up to three nodes, of which one is any.
macro_rules! any_node_of_three {
    ($harness:ident) => {
        match any_case(8) {
            0 => $harness::<1, 0>(),
            1 => $harness::<2, 0>(),
            2 => $harness::<2, 1>(),
            3 => $harness::<3, 0>(),
            4 => $harness::<3, 1>(),
            5 => $harness::<4, 0>(),
            6 => $harness::<4, 1>(),
            _ => $harness::<4, 2>(),
        }
    };
}

/// The same for each shape with four nodes, first of all the one whose loss leaves the tree leaning to the left.
macro_rules! any_node_of_four {
    ($harness:ident) => {
        match any_case(16) {
            0 => $harness::<7, 3>(),
            1 => $harness::<5, 0>(),
            2 => $harness::<5, 1>(),
            3 => $harness::<5, 2>(),
            4 => $harness::<5, 3>(),
            5 => $harness::<6, 0>(),
            6 => $harness::<6, 1>(),
            7 => $harness::<6, 2>(),
            8 => $harness::<6, 3>(),
            9 => $harness::<7, 0>(),
            10 => $harness::<7, 1>(),
            11 => $harness::<7, 2>(),
            12 => $harness::<8, 0>(),
            13 => $harness::<8, 1>(),
            14 => $harness::<8, 2>(),
            _ => $harness::<8, 3>(),
        }
    };
}

fn same_entry<const CLOUDS: usize>(a: &Entry<CLOUDS>, b: &Entry<CLOUDS>) -> bool {
    a.slot == b.slot && a.local_due == b.local_due && (0..CLOUDS).all(|i| a.dues[i] == b.dues[i])
}

/// Whether every timestamp but that of `place` is in both trees, at the same place, with the same entry.
fn others_stay<const CLOUDS: usize>(
    before: &Window<CLOUDS, 4>,
    after: &Window<CLOUDS, 4>,
    len: usize,
    place: usize,
) -> bool {
    (0..len).filter(|i| *i != place).all(|i| {
        before.nodes[i].timestamp == after.nodes[i].timestamp
            && same_entry(&before.entries[i], &after.entries[i])
    })
}

fn generated<const SHAPE: usize>() -> usize {
    let tree = any_window::<SHAPE>();
    kani::assert(is_tree(&tree), "what is generated is a tree");
    kani::assert(is_tree(&Tree::new()), "an empty window is a tree");
    tree.len
}

fn any_window<const SHAPE: usize>() -> Tree {
    crate::any::any_window::<0, SHAPE>(any_commit())
}

/// The trees that harnesses start from are valid.
///
/// Bounds: trees of 0 to 4.
#[kani::proof]
#[kani::unwind(10)]
pub fn every_generated_tree_is_valid() {
    let len = any_shape!(generated);
    kani::cover!(len == 0, "an empty one");
    kani::cover!(len == 4, "a full one");
}

fn found<const SHAPE: usize>() -> Option<usize> {
    let tree = any_window::<SHAPE>();
    let timestamp = any_timestamp();
    let place = (0..tree.len).find(|i| tree.nodes[*i].timestamp == timestamp);
    let found = tree.find(timestamp).map(|place| usize::from(place.0));
    kani::assert(found == place, "P9: it finds what is open and nothing else");
    found
}

/// P9, F8: lookup finds what is open and nothing else.
///
/// Bounds: trees of 0 to 3.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_lookup_in_three() {
    let found = any_shape_of!(three, found);
    kani::cover!(found == Some(0), "it finds the first");
    kani::cover!(found.is_none(), "there is none");
}

/// As `p9_lookup_in_three`, for P9 in larger trees.
///
/// Bounds: trees of 4.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_lookup_in_four() {
    let found = any_shape_of!(four, found);
    kani::cover!(found == Some(0), "it finds the first");
    kani::cover!(found.is_none(), "there is none");
}

fn next<const SHAPE: usize>() -> (bool, bool) {
    let tree = any_window::<SHAPE>();
    let due = tree.next_due();
    let all = (0..tree.len).fold(None, |due, i| least(due, earliest(&tree.entries[i])));
    kani::assert(due == all, "P9: the next due instant is the least armed one");
    let Some(due) = due else { return (true, false) };
    let first = (0..tree.len).find(|i| tree.nodes[*i].due == Some(due));
    let found = usize::from(tree.first_due_at(due).0);
    kani::assert(Some(found) == first, "F5: of those due then the least timestamp fires");
    let last = (0..tree.len).rfind(|i| tree.nodes[*i].due == Some(due));
    (false, first != last)
}

/// P9, F5, A23: the next due instant is the least armed one, and the least timestamp that is due then fires.
///
/// Bounds: trees of 0 to 3.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_next_due_in_three() {
    let (is_none, is_tie) = any_shape_of!(three, next);
    kani::cover!(is_none, "nothing is armed");
    kani::cover!(is_tie, "two are due at one instant");
}

/// As `p9_next_due_in_three`, for P9, F5 and A23 in larger trees.
///
/// Cases: 4.
/// Bounds: trees of 4.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_next_due_in_four() {
    let (is_none, is_tie) = any_shape_of!(four, next);
    kani::cover!(is_none, "nothing is armed");
    kani::cover!(is_tie, "two are due at one instant");
}

fn pushed<const SHAPE: usize>() -> (usize, bool) {
    let before = any_window::<SHAPE>();
    let len = before.len;
    let (timestamp, entry) = (any_timestamp(), any_entry::<0>(any_commit()));
    kani::assume(len == 0 || before.nodes[len - 1].timestamp < timestamp);
    let mut after = before.clone();
    let added = after.push(timestamp, entry);
    kani::assert(added == (len < 4), "P9: there is room for as many as the window");
    kani::assert(is_tree(&after), "P9: it is a tree");
    kani::assert(others_stay(&before, &after, len, len), "P9: only its own timestamp changes");
    kani::assert(after.len == len + usize::from(added), "P9: it is one more");
    if added {
        let last = usize::from(after.last.0);
        let is_there =
            after.nodes[last].timestamp == timestamp && same_entry(&after.entries[last], &entry);
        kani::assert(is_there, "P9: it is there with its entry");
    }
    (len, added)
}

/// P9, F1, F8: opening adds the timestamp and changes no other; what is full takes no more.
///
/// The timestamp is assumed to be greater than all open ones: F1 refuses it otherwise, which `f1_open_by_the_rule` shows.
///
/// Bounds: trees of 0 to 4.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_open() {
    let (len, added) = any_shape!(pushed);
    kani::cover!(len == 3 && added, "it takes the last place");
    kani::cover!(!added, "it is full");
}

fn armed<const SHAPE: usize, const AT: usize>() -> bool {
    let commit = any_commit();
    let before = crate::any::any_window::<1, SHAPE>(commit);
    let due = any_instant();
    let source = Source::new(1).unwrap_or(Source::LOCAL);
    let (slot, refusal) = before.entries[AT].slot.offer(source);
    kani::assume(refusal.is_none());
    let mut after = before.clone();
    after.arm(Place(AT as u16), slot, source, due);
    kani::assert(is_tree(&after), "P9: it is a tree");
    kani::assert(
        others_stay(&before, &after, before.len, AT),
        "P9: only its own timestamp changes",
    );
    let mut entry = before.entries[AT];
    entry.slot = slot;
    entry.dues[0] = due;
    kani::assert(same_entry(&after.entries[AT], &entry), "P9: its timer is armed");
    after.next_due() != before.next_due()
}

/// P9, F2: arming a timer changes no other timestamp, and the next due instant is still the least.
///
/// That the request is admitted is assumed: the tree is told of no other.
///
/// Bounds: trees of 1 to 3.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_offer_in_three() {
    let is_next = any_node_of_three!(armed);
    kani::cover!(is_next, "it is the next due");
}

/// As `p9_offer_in_three`, for P9 in trees of four.
///
/// Cases: 16.
/// Bounds: trees of 4.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_offer_in_four() {
    let is_next = any_node_of_four!(armed);
    kani::cover!(is_next, "it is the next due");
}

fn set<const SHAPE: usize, const AT: usize>() -> bool {
    let commit = any_commit();
    let before = crate::any::any_window::<1, SHAPE>(commit);
    let slot = any_slot(commit, 1);
    kani::assume(before.entries[AT].slot.armed().contains_all(slot.armed()));
    let mut after = before.clone();
    after.set(Place(AT as u16), slot);
    kani::assert(is_tree(&after), "P9: it is a tree");
    kani::assert(
        others_stay(&before, &after, before.len, AT),
        "P9: only its own timestamp changes",
    );
    let entry = Entry { slot, ..before.entries[AT] };
    kani::assert(same_entry(&after.entries[AT], &entry), "P9: it has the new state");
    after.next_due() != before.next_due()
}

/// P9, F3, F4, F5: what closes requests changes no other timestamp, and the next due instant is still the least.
///
/// That no timer is armed anew is assumed: `p7_no_stall` shows it of every event.
///
/// Cases: 8.
/// Bounds: trees of 1 to 3.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_close_in_three() {
    let is_other = any_node_of_three!(set);
    kani::cover!(is_other, "the next due is another");
}

/// As `p9_close_in_three`, for P9 in trees of four.
///
/// Cases: 16.
/// Bounds: trees of 4.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_close_in_four() {
    let is_other = any_node_of_four!(set);
    kani::cover!(is_other, "the next due is another");
}

fn removed<const SHAPE: usize, const AT: usize>() -> bool {
    let before = any_window::<SHAPE>();
    let mut after = before.clone();
    after.remove(Place(AT as u16));
    kani::assert(is_tree(&after), "P9: it is a tree");
    kani::assert(
        others_stay(&before, &after, before.len, AT),
        "P9: only its own timestamp changes",
    );
    let is_gone = in_order(&after).is_some_and(|(order, len)| !order[..len].contains(&AT));
    kani::assert(is_gone && after.len == before.len - 1, "P9: it is open no more");
    after.next_due() != before.next_due()
}

/// P9, F7: retiring a timestamp changes no other, leaves a tree, and its place is free again.
///
/// Bounds: trees of 1 to 3.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_retire_in_three() {
    let is_other = any_node_of_three!(removed);
    kani::cover!(is_other, "the next due is another");
}

/// As `p9_retire_in_three`, for P9 in trees of four.
///
/// Cases: 16.
/// Bounds: trees of 4.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_retire_in_four() {
    let is_other = any_node_of_four!(removed);
    kani::cover!(is_other, "the next due is another");
}

/// The timestamps of `p9_one_of_four`: fixed, so that where one lies is known. That lookup finds any is `p9_lookup_in_four`.
const TIMESTAMPS: [u64; 4] = [0, 1, u64::MAX - 1, u64::MAX];

/// A result, a failure or an offer.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Result,
    Failure,
    Offer,
}

fn one_of<const AT: usize>(kind: Kind) -> (bool, bool) {
    let commit = any_commit();
    let open = crate::any::any_window_at::<1, 5>(commit, TIMESTAMPS);
    let clouds = Clouds { priorities: [Priority::new(1)], gates: [any_gate()], len: 1 };
    let newest = Some(Timestamp::new(TIMESTAMPS[3]));
    let due = open.next_due();
    let now = kani::any_where(|now: &u64| due.is_none_or(|due| due.as_nanos() > *now));
    let now = Instant::from_nanos(now);
    let mut fusion = Fusion { commit, window: 4, clouds, now, newest, open };
    let before = fusion.open.clone();
    let mut tree = before.clone();
    let (slot, place) = (before.entries[AT].slot, Place(AT as u16));
    let (timestamp, source) = (Timestamp::new(TIMESTAMPS[AT]), any_source(1));
    let priority = Priority::new(source.index().into());
    let mut is_retired = false;
    let mut is_offer = false;
    if kind == Kind::Offer {
        let asked = told::offer(&mut fusion, timestamp, priority, any_deadline(), kani::any());
        if let Admission::Admitted { due } = asked {
            is_offer = true;
            tree.arm(place, slot.offer(source).0, source, due);
        }
    } else {
        let event = if kind == Kind::Result {
            let _ = told::result(&mut fusion, timestamp, priority);
            Cause::Result(source)
        } else {
            let _ = told::fail(&mut fusion, timestamp, priority);
            Cause::Failure(source)
        };
        let after = slot.step(commit, event).0;
        is_retired = !after.is_open();
        if is_retired { tree.remove(place) } else { tree.set(place, after) }
    }
    kani::assert(same_tree(&fusion.open, &tree), "P9: the tree is changed at its place");
    let same = others_stay(&before, &fusion.open, before.len, AT);
    kani::assert(same, "P9: only its own timestamp changes");
    kani::assert(fusion.len() == 4 - usize::from(is_retired), "P9: as many are open as were left");
    (is_retired, is_offer)
}

/// Whether the trees are the same, node by node and entry by entry.
fn same_tree<const CLOUDS: usize>(a: &Window<CLOUDS, 4>, b: &Window<CLOUDS, 4>) -> bool {
    let same = a.root == b.root && a.last == b.last && a.free == b.free && a.len == b.len;
    same && (0..4)
        .all(|i| same_node(&a.nodes[i], &b.nodes[i]) && same_entry(&a.entries[i], &b.entries[i]))
}

/// P9, F2, F3, F4, F7: an input to the whole machine for one timestamp of four does to the tree what `p9_offer_in_four`,
/// `p9_close_in_four` and `p9_retire_in_four` look at, there and nowhere else.
///
/// Cases: 12.
/// Bounds: window of 4, 1 cloud, one shape of tree, fixed timestamps.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_one_of_four() {
    let (is_retired, is_offer) = match any_case(12) {
        0 => one_of::<0>(Kind::Result),
        1 => one_of::<1>(Kind::Result),
        2 => one_of::<2>(Kind::Result),
        3 => one_of::<3>(Kind::Result),
        4 => one_of::<0>(Kind::Failure),
        5 => one_of::<1>(Kind::Failure),
        6 => one_of::<2>(Kind::Failure),
        7 => one_of::<3>(Kind::Failure),
        8 => one_of::<0>(Kind::Offer),
        9 => one_of::<1>(Kind::Offer),
        10 => one_of::<2>(Kind::Offer),
        _ => one_of::<3>(Kind::Offer),
    };
    kani::cover!(is_retired, "it is retired");
    kani::cover!(is_offer, "a request is admitted");
}
