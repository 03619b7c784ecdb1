//! The window of open timestamps: from any window of four, each way to change it and each question to it.
//!
//! Four seats are two rows of two. Every number of open timestamps is taken, and every way to share the rows, three at most, with
//! any timestamps, sets and due instants.

use crate::any::{
    SEATINGS, any_case, any_commit, any_deadline, any_entry, any_instant, any_slot, any_timestamp,
    any_window, earliest, least,
};
use crate::entry::Entry;
use crate::shipped::window::{Place, Window};
use crate::source::Source;
use crate::time::Instant;
use crate::valid::{is_window, same_turn};

/// The window knows one due instant of each timestamp, the earliest. Local's is enough for it to be any, or none; that
/// it is the earliest of several, `fusion` shows.
type Four = Window<0, 4>;

/// Calls a function for each seating of up to three open timestamps, or of four, of which one is any.
macro_rules! any_of {
    (three, $harness:ident) => {
        match any_case(7) {
            0 => $harness::<0, 0>(),
            1 => $harness::<0, 1>(),
            2 => $harness::<0, 2>(),
            3 => $harness::<1, 2>(),
            4 => $harness::<0, 3>(),
            5 => $harness::<1, 3>(),
            _ => $harness::<2, 3>(),
        }
    };
    (four, $harness:ident) => {
        match any_case(3) {
            0 => $harness::<0, 4>(),
            1 => $harness::<1, 4>(),
            _ => $harness::<2, 4>(),
        }
    };
}

/// Calls a function for each of the timestamps in each seating of up to three, or of four, of which one is any.
macro_rules! any_place_of {
    (three, $harness:ident) => {
        match any_case(14) {
            0 => $harness::<0, 1, 0>(),
            1 => $harness::<0, 2, 0>(),
            2 => $harness::<0, 2, 1>(),
            3 => $harness::<1, 2, 0>(),
            4 => $harness::<1, 2, 1>(),
            5 => $harness::<0, 3, 0>(),
            6 => $harness::<0, 3, 1>(),
            7 => $harness::<0, 3, 2>(),
            8 => $harness::<1, 3, 0>(),
            9 => $harness::<1, 3, 1>(),
            10 => $harness::<1, 3, 2>(),
            11 => $harness::<2, 3, 0>(),
            12 => $harness::<2, 3, 1>(),
            _ => $harness::<2, 3, 2>(),
        }
    };
    (four, $harness:ident) => {
        match any_case(12) {
            0 => $harness::<0, 4, 0>(),
            1 => $harness::<0, 4, 1>(),
            2 => $harness::<0, 4, 2>(),
            3 => $harness::<0, 4, 3>(),
            4 => $harness::<1, 4, 0>(),
            5 => $harness::<1, 4, 1>(),
            6 => $harness::<1, 4, 2>(),
            7 => $harness::<1, 4, 3>(),
            8 => $harness::<2, 4, 0>(),
            9 => $harness::<2, 4, 1>(),
            10 => $harness::<2, 4, 2>(),
            _ => $harness::<2, 4, 3>(),
        }
    };
}

/// The place of a rank in a seating.
const fn place<const SEATING: usize, const AT: usize>() -> Place {
    Place { rank: AT as u16, seat: SEATINGS[SEATING][AT] }
}

fn same_entry<const CLOUDS: usize>(a: &Entry<CLOUDS>, b: &Entry<CLOUDS>) -> bool {
    a.slot == b.slot && a.local_due == b.local_due && (0..CLOUDS).all(|i| a.dues[i] == b.dues[i])
}

/// Whether every seat but one has the same entry and turn in both windows.
fn others_stay<const CLOUDS: usize>(
    before: &Window<CLOUDS, 4>,
    after: &Window<CLOUDS, 4>,
    seat: u16,
) -> bool {
    (0..4).filter(|i| *i != usize::from(seat)).all(|i| {
        same_turn(before.turns[i], after.turns[i])
            && same_entry(&before.entries[i], &after.entries[i])
    })
}

/// Whether the same timestamps are open in both windows, in the same seats.
fn same_order<const CLOUDS: usize>(a: &Window<CLOUDS, 4>, b: &Window<CLOUDS, 4>) -> bool {
    let same = a.len == b.len && a.seats == b.seats;
    same && (0..4).all(|i| i >= a.len || a.timestamps[i] == b.timestamps[i])
}

fn generated<const SEATING: usize, const LEN: usize>() -> usize {
    let window: Four = any_window::<0, SEATING, LEN>(any_commit());
    kani::assert(is_window(&window), "what is generated is a window");
    kani::assert(is_window(&Four::new()), "what is made is a window");
    window.len
}

/// The windows that harnesses start from are valid.
///
/// Bounds: window of 4.
#[kani::proof]
#[kani::unwind(6)]
pub fn every_generated_window_is_valid() {
    let len = if kani::any() { any_of!(three, generated) } else { any_of!(four, generated) };
    kani::cover!(len == 0, "an empty one");
    kani::cover!(len == 4, "a full one");
}

fn found<const SEATING: usize, const LEN: usize>() -> Option<usize> {
    let window: Four = any_window::<0, SEATING, LEN>(any_commit());
    let timestamp = any_timestamp();
    let rank = (0..LEN).find(|i| window.timestamps[*i] == timestamp);
    let found = window.find(timestamp);
    let place = found.map(|place| usize::from(place.rank));
    kani::assert(place == rank, "P9: it finds what is open and nothing else");
    for i in 0..LEN {
        if let Some(place) = found.filter(|place| usize::from(place.rank) == i) {
            kani::assert(place.seat == window.seats[i], "P9: it tells its seat");
            let kept = &window.entries[usize::from(window.seats[i])];
            let is_there = same_entry(window.entry(place), kept);
            kani::assert(is_there, "P9: what is kept of it is there");
            kani::assert(window.timestamp(place) == timestamp, "P9: it is of that timestamp");
        }
    }
    kani::assert(window.len() == LEN, "P9: as many are open");
    rank
}

/// P9, F8: lookup finds what is open and nothing else.
///
/// Cases: 7.
/// Bounds: window of 4, 0 to 3 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_lookup_in_three() {
    let found = any_of!(three, found);
    kani::cover!(found == Some(0), "it finds the first");
    kani::cover!(found.is_none(), "there is none");
}

/// As `p9_lookup_in_three`, for P9 in a full window.
///
/// Cases: 3.
/// Bounds: window of 4, 4 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_lookup_in_four() {
    let found = any_of!(four, found);
    kani::cover!(found == Some(0), "it finds the first");
    kani::cover!(found.is_none(), "there is none");
}

fn next<const SEATING: usize, const LEN: usize>() -> (bool, bool) {
    let window: Four = any_window::<0, SEATING, LEN>(any_commit());
    let seats = const { SEATINGS[SEATING] };
    let of = |rank: usize| earliest(&window.entries[usize::from(seats[rank])]);
    let due = window.next_due();
    let all = (0..LEN).fold(None, |due, rank| least(due, of(rank)));
    kani::assert(due == all, "P9: the next due instant is the least armed one");
    if due.is_none() {
        return (true, false);
    }
    let first = (0..LEN).find(|rank| of(*rank) == due);
    let found = window.first_due().map(|place| usize::from(place.rank));
    kani::assert(found == first, "F5: of those due then the least timestamp fires");
    let last = (0..LEN).rfind(|rank| of(*rank) == due);
    (false, first != last)
}

/// P9, F5, A23: the next due instant is the least armed one, and the least timestamp that is due then fires.
///
/// Cases: 7.
/// Bounds: window of 4, 0 to 3 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_next_due_in_three() {
    let (is_none, is_tie) = any_of!(three, next);
    kani::cover!(is_none, "nothing is armed");
    kani::cover!(is_tie, "two are due at one instant");
}

/// As `p9_next_due_in_three`, for P9, F5 and A23 in a full window.
///
/// Cases: 3.
/// Bounds: window of 4, 4 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_next_due_in_four() {
    let (is_none, is_tie) = any_of!(four, next);
    kani::cover!(is_none, "nothing is armed");
    kani::cover!(is_tie, "two are due at one instant");
}

fn pushed<const SEATING: usize, const LEN: usize>() -> (usize, bool) {
    let before: Four = any_window::<0, SEATING, LEN>(any_commit());
    let (timestamp, entry) = (any_timestamp(), any_entry::<0>(any_commit()));
    // What is full takes no more, whatever it is.
    kani::assume(LEN == 0 || LEN == 4 || before.timestamps[LEN - 1] < timestamp);
    let mut after = before.clone();
    let added = after.push(timestamp, entry);
    kani::assert(added == (LEN < 4), "P9: there is room for as many as the window");
    kani::assert(is_window(&after), "P9: it is a window");
    kani::assert(after.len == LEN + usize::from(added), "P9: it is one more");
    let seat = if LEN < 4 { SEATINGS[SEATING][LEN] } else { u16::MAX };
    kani::assert(others_stay(&before, &after, seat), "P9: only its own timestamp changes");
    let same = (0..LEN).all(|i| before.timestamps[i] == after.timestamps[i]);
    kani::assert(same && before.seats == after.seats, "P9: the others stay where they are");
    if LEN < 4 {
        let kept = &after.entries[usize::from(seat)];
        let is_there = after.timestamps[LEN] == timestamp && same_entry(kept, &entry);
        kani::assert(is_there, "P9: it is there with its entry");
    }
    (LEN, added)
}

/// P9, F1, F8: opening adds the timestamp and changes no other.
///
/// The timestamp is assumed to be greater than all open ones: F1 refuses it otherwise, which `f1_open_by_the_rule` shows.
///
/// Cases: 7.
/// Bounds: window of 4, 0 to 3 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_open() {
    let (len, added) = any_of!(three, pushed);
    kani::cover!(len == 0 && added, "it is the first");
    kani::cover!(len == 3 && added, "it takes the last seat");
}

/// As `p9_open`, for P9 in a full window, which takes no more.
///
/// Cases: 3.
/// Bounds: window of 4, 4 open.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_open_in_four() {
    let (_, added) = any_of!(four, pushed);
    kani::cover!(!added, "it is full");
}

fn armed<const SEATING: usize, const LEN: usize, const AT: usize>() -> bool {
    let before = any_window::<1, SEATING, LEN>(any_commit());
    let place = place::<SEATING, AT>();
    let seat = usize::from(place.seat);
    let now = any_instant();
    let source = Source::new(1).unwrap_or(Source::LOCAL);
    let (slot, refusal) = before.entries[seat].slot.offer(source);
    let due = now.due(any_deadline());
    kani::assume(refusal.is_none() && due.is_some());
    let due = due.unwrap_or(Instant::END);
    let mut after = before.clone();
    after.arm(place, slot, source, due);
    kani::assert(is_window(&after), "P9: it is a window");
    let same = others_stay(&before, &after, place.seat) && same_order(&before, &after);
    kani::assert(same, "P9: only its own timestamp changes");
    let mut entry = before.entries[seat];
    entry.slot = slot;
    entry.dues[0] = due;
    kani::assert(same_entry(&after.entries[seat], &entry), "P9: its timer is armed");
    after.next_due() != before.next_due()
}

/// P9, F2: arming a timer changes no other timestamp, and the next due instant is still the least.
///
/// That the request is admitted is assumed: the window is told of no other.
///
/// Cases: 14.
/// Bounds: window of 4, 1 to 3 open, 1 cloud.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_offer_in_three() {
    let is_next = any_place_of!(three, armed);
    kani::cover!(is_next, "it is the next due");
}

/// As `p9_offer_in_three`, for P9 in a full window.
///
/// Cases: 12.
/// Bounds: window of 4, 4 open, 1 cloud.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_offer_in_four() {
    let is_next = any_place_of!(four, armed);
    kani::cover!(is_next, "it is the next due");
}

fn set<const SEATING: usize, const LEN: usize, const AT: usize>() -> bool {
    let commit = any_commit();
    let before = any_window::<1, SEATING, LEN>(commit);
    let place = place::<SEATING, AT>();
    let seat = usize::from(place.seat);
    let slot = any_slot(commit, 1);
    kani::assume(before.entries[seat].slot.armed().contains_all(slot.armed()));
    let mut after = before.clone();
    after.set(place, slot);
    kani::assert(is_window(&after), "P9: it is a window");
    let same = others_stay(&before, &after, place.seat) && same_order(&before, &after);
    kani::assert(same, "P9: only its own timestamp changes");
    let entry = Entry { slot, ..before.entries[seat] };
    kani::assert(same_entry(&after.entries[seat], &entry), "P9: it has the new state");
    after.next_due() != before.next_due()
}

/// P9, F3, F4, F5: what closes requests changes no other timestamp, and the next due instant is still the least.
///
/// That no timer is armed anew is assumed: `p7_no_stall` shows it of every event.
///
/// Cases: 14.
/// Bounds: window of 4, 1 to 3 open, 1 cloud.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_close_in_three() {
    let is_other = any_place_of!(three, set);
    kani::cover!(is_other, "the next due is another");
}

/// As `p9_close_in_three`, for P9 in a full window.
///
/// Cases: 12.
/// Bounds: window of 4, 4 open, 1 cloud.
#[kani::proof]
#[kani::unwind(6)]
pub fn p9_close_in_four() {
    let is_other = any_place_of!(four, set);
    kani::cover!(is_other, "the next due is another");
}

fn removed<const SEATING: usize, const LEN: usize, const AT: usize>() -> bool {
    let before: Four = any_window::<0, SEATING, LEN>(any_commit());
    let place = place::<SEATING, AT>();
    let mut after = before.clone();
    after.remove(place);
    kani::assert(is_window(&after), "P9: it is a window");
    kani::assert(others_stay(&before, &after, place.seat), "P9: only its own timestamp changes");
    let mut moved = after.len == LEN - 1;
    for i in 0..LEN - 1 {
        let was = if i < AT { i } else { i + 1 };
        moved &= after.timestamps[i] == before.timestamps[was];
        moved &= after.seats[i] == before.seats[was];
    }
    kani::assert(moved, "P9: it is open no more, and the others are, in their seats");
    after.next_due() != before.next_due()
}

/// P9, F7: retiring a timestamp changes no other, leaves a window, and its seat is free again.
///
/// Cases: 14.
/// Bounds: window of 4, 1 to 3 open.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_retire_in_three() {
    let is_other = any_place_of!(three, removed);
    kani::cover!(is_other, "the next due is another");
}

/// As `p9_retire_in_three`, for P9 in a full window.
///
/// Cases: 12.
/// Bounds: window of 4, 4 open.
#[kani::proof]
#[kani::unwind(10)]
pub fn p9_retire_in_four() {
    let is_other = any_place_of!(four, removed);
    kani::cover!(is_other, "the next due is another");
}
