//! Any value of the machine's types; any valid state, made so that nothing need be assumed.

use crate::clouds::Clouds;
use crate::entry::Entry;
use crate::fusion::Fusion;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{NIL, Node, Place, Window};

/// Any number below `cases`. A checker that is asked about one case at a time is told which when this is compiled, so that
/// all that hangs on it is a constant; a line `Cases:` tells the runner how many there are.
pub(crate) fn any_case(cases: u8) -> u8 {
    let case = kani::any_where(|case| *case < cases);
    match option_env!("FUSELINE_CASE") {
        None => case,
        Some(only) => {
            let only = only.bytes().fold(0, |number, digit| number * 10 + (digit - b'0'));
            kani::assume(case == only);
            only
        }
    }
}

pub(crate) fn any_commit() -> Commit {
    if kani::any() { Commit::Eager } else { Commit::Patient }
}

/// Local or one of the first `clouds` clouds.
pub(crate) fn any_source(clouds: u8) -> Source {
    Source::new(kani::any_where(|index| *index <= clouds)).unwrap_or(Source::LOCAL)
}

/// Local and the first `clouds` clouds.
pub(crate) const fn sources(clouds: u8) -> Sources {
    Sources::from_bits(u16::MAX >> (15 - clouds))
}

/// Any valid state of an open timestamp that was asked for nothing beyond the first `clouds` clouds.
pub(crate) fn any_slot(commit: Commit, clouds: u8) -> Slot {
    let [requested, pending, cached] = kani::any();
    slot_of(commit, clouds, requested, pending, cached, kani::any())
}

/// Bends any bits to a valid state. Those of a valid state stay as they are, so that none is left out.
pub(crate) fn slot_of(
    commit: Commit,
    clouds: u8,
    requested: u16,
    pending: u16,
    cached: u16,
    limited: bool,
) -> Slot {
    let requested = requested & sources(clouds).bits() | Sources::LOCAL.bits();
    let pending = match pending & requested {
        0 => Sources::LOCAL.bits(),
        pending => pending,
    };
    // P4: what is cached lies below the greatest pending.
    let below = u16::MAX >> pending.leading_zeros() >> 1;
    let cached = cached & requested & !pending & below;
    let kept = match commit {
        Commit::Eager => pending | cached,
        Commit::Patient => pending,
    };
    let deadline = if limited { pending & Sources::LOCAL.bits() } else { 0 };
    let armed = kept & !Sources::LOCAL.bits() | deadline;
    let [requested, pending, armed, cached] =
        [requested, pending, armed, cached].map(Sources::from_bits);
    // `every_valid_state_is_generated_and_accepted` shows that it is no error.
    Slot::from_sets(commit, requested, pending, armed, cached).unwrap_or(Slot::RETIRED)
}

pub(crate) fn any_instant() -> Instant {
    Instant::from_nanos(kani::any())
}

pub(crate) fn any_deadline() -> Deadline {
    Deadline::from_nanos(kani::any())
}

pub(crate) fn any_timestamp() -> Timestamp {
    Timestamp::new(kani::any())
}

/// The shape of a balanced tree of up to four nodes. Node `i` has the `i`-th least timestamp and lies at place `i`.
pub(crate) struct Shape {
    /// How many nodes there are.
    pub(crate) len: usize,
    root: u16,
    children: [(u16, u16); 4],
    heights: [u8; 4],
}

/// No node.
const N: u16 = u16::MAX;

/// All nine.
pub(crate) const SHAPES: [Shape; 9] = [
    Shape { len: 0, root: N, children: [(N, N); 4], heights: [0, 0, 0, 0] },
    Shape { len: 1, root: 0, children: [(N, N); 4], heights: [1, 0, 0, 0] },
    Shape { len: 2, root: 0, children: [(N, 1), (N, N), (N, N), (N, N)], heights: [2, 1, 0, 0] },
    Shape { len: 2, root: 1, children: [(N, N), (0, N), (N, N), (N, N)], heights: [1, 2, 0, 0] },
    Shape { len: 3, root: 1, children: [(N, N), (0, 2), (N, N), (N, N)], heights: [1, 2, 1, 0] },
    Shape { len: 4, root: 1, children: [(N, N), (0, 2), (N, 3), (N, N)], heights: [1, 3, 2, 1] },
    Shape { len: 4, root: 1, children: [(N, N), (0, 3), (N, N), (2, N)], heights: [1, 3, 1, 2] },
    Shape { len: 4, root: 2, children: [(N, 1), (N, N), (0, 3), (N, N)], heights: [2, 1, 3, 1] },
    Shape { len: 4, root: 2, children: [(N, N), (0, N), (1, 3), (N, N)], heights: [1, 2, 3, 1] },
];

/// The earliest due instant of an entry's armed timers, by looking at each.
pub(crate) fn earliest<const CLOUDS: usize>(entry: &Entry<CLOUDS>) -> Option<Instant> {
    let armed = entry.slot.armed().bits();
    let mut earliest = if armed & 1 != 0 { Some(entry.local_due) } else { None };
    let mut bit = 2;
    for due in entry.dues {
        if armed & bit != 0 {
            earliest = least(earliest, Some(due));
        }
        bit <<= 1;
    }
    earliest
}

/// The earlier one; none is later than any.
pub(crate) fn least(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a <= b { a } else { b }),
        (Some(due), None) | (None, Some(due)) => Some(due),
        (None, None) => None,
    }
}

/// Any open timestamp's entry.
pub(crate) fn any_entry<const CLOUDS: usize>(commit: Commit) -> Entry<CLOUDS> {
    let mut entry = Entry { slot: any_slot(commit, CLOUDS as u8), ..Entry::EMPTY };
    entry.local_due = any_instant();
    for due in &mut entry.dues {
        *due = any_instant();
    }
    entry
}

/// Any tree of this shape: any timestamps in ascending order, any entries.
pub(crate) fn any_window<const CLOUDS: usize, const SHAPE: usize>(
    commit: Commit,
) -> Window<CLOUDS, 4> {
    let len = const { SHAPES[SHAPE].len };
    let timestamps = kani::any_where(|of: &[u64; 4]| (1..len).all(|i| of[i - 1] < of[i]));
    any_window_at::<CLOUDS, SHAPE>(commit, timestamps)
}

/// Any tree of this shape with these timestamps: any entries.
pub(crate) fn any_window_at<const CLOUDS: usize, const SHAPE: usize>(
    commit: Commit,
    timestamps: [u64; 4],
) -> Window<CLOUDS, 4> {
    let shape = const { &SHAPES[SHAPE] };
    let mut window = Window {
        nodes: [Node::NIL; 4],
        entries: [Entry::EMPTY; 4],
        root: Place(shape.root),
        last: if shape.len > 0 { Place(shape.len as u16 - 1) } else { NIL },
        free: NIL,
        len: shape.len,
    };
    for i in 0..4 {
        let (left, right) = shape.children[i];
        let node = &mut window.nodes[i];
        if i < shape.len {
            window.entries[i] = any_entry(commit);
            node.timestamp = Timestamp::new(timestamps[i]);
            node.due = earliest(&window.entries[i]);
            (node.left, node.right) = (Place(left), Place(right));
            node.height = shape.heights[i];
        } else {
            node.right = window.free;
            window.free = Place(i as u16);
        }
    }
    // From the leaves up: parents, and what each knows of the dues below.
    for level in 1..=3 {
        for i in 0..shape.len {
            if shape.heights[i] == level {
                let (left, right) = shape.children[i];
                let mut below = window.nodes[i].due;
                for child in [left, right] {
                    if child != N {
                        window.nodes[usize::from(child)].up = Place(i as u16);
                        below = least(below, window.nodes[usize::from(child)].below);
                    }
                }
                window.nodes[i].below = below;
            }
        }
    }
    window
}

/// A window of one, with any timestamp open in it.
fn any_window_of_one<const CLOUDS: usize>(commit: Commit) -> Window<CLOUDS, 1> {
    let entry = any_entry(commit);
    let due = earliest(&entry);
    let node = Node { timestamp: any_timestamp(), due, below: due, height: 1, ..Node::NIL };
    Window { nodes: [node], entries: [entry], root: Place(0), last: Place(0), free: NIL, len: 1 }
}

/// A machine with a window of one and any timestamp open in it; any clock, clouds and gates.
pub(crate) fn any_single<const CLOUDS: usize>() -> Fusion<CLOUDS, 1> {
    let commit = any_commit();
    let open = any_window_of_one(commit);
    // F1: no later timestamp is open than the greatest ever opened.
    let least = open.nodes[0].timestamp;
    let newest = kani::any_where(|newest: &u64| *newest >= least.as_u64());
    let newest = Some(Timestamp::new(newest));
    Fusion { commit, window: 1, clouds: any_clouds(), now: any_instant(), newest, open }
}

/// The same with nothing open, and perhaps nothing ever opened.
pub(crate) fn any_empty<const CLOUDS: usize, const WINDOW: usize>() -> Fusion<CLOUDS, WINDOW> {
    Fusion {
        commit: any_commit(),
        window: WINDOW,
        clouds: any_clouds(),
        now: any_instant(),
        newest: if kani::any() { Some(any_timestamp()) } else { None },
        open: Window::new(),
    }
}

/// Any clouds, any gates; all of the capacity are registered.
pub(crate) fn any_clouds<const CLOUDS: usize>() -> Clouds<CLOUDS> {
    let mut priorities = [Priority::LOCAL; CLOUDS];
    let mut below = 0;
    for (i, priority) in priorities.iter_mut().enumerate() {
        // Ascending, with room for those to come.
        let most = u16::MAX - (CLOUDS - 1 - i) as u16;
        below = kani::any_where(|number| *number > below && *number <= most);
        *priority = Priority::new(below);
    }
    Clouds { priorities, gates: core::array::from_fn(|_| any_gate()), len: CLOUDS }
}

pub(crate) fn any_gate() -> Gate {
    let [limit, resume] = kani::any_where(|[limit, resume]: &[u64; 2]| resume < limit);
    Gate { limit, resume, shut: kani::any() }
}
