//! The invariant, once, from the words of `SPEC.md` and not from the core.

use crate::any::{earliest, least};
use crate::slot::{Commit, Slot};
use crate::source::{Source, Sources};
use crate::window::{NIL, Node, Window};

/// What holds of every open timestamp between two inputs, and between two firings.
pub(crate) fn is_valid(commit: Commit, slot: Slot) -> bool {
    let (requested, pending, armed, cached) =
        (slot.requested().bits(), slot.pending().bits(), slot.armed().bits(), slot.cached().bits());
    let local = Sources::LOCAL.bits();
    // F1, F2: 0 always was asked for, and only what was asked for is pending or cached.
    let asked = requested & local != 0 && (pending | cached) & !requested == 0;
    // F3: a result leaves pending as it joins cached.
    let apart = pending & cached == 0;
    // F6: with nothing pending it would have been forwarded or missed.
    let waiting = pending != 0;
    // P4: the greatest pending outranks the greatest cached. As numbers, sets without a common member compare so.
    let prompt = cached == 0 || pending > cached;
    // P8: what is armed, and nothing else; F3 says what the commit rule keeps armed.
    let kept = match commit {
        Commit::Eager => pending | cached,
        Commit::Patient => pending,
    };
    let timers = armed & !local == kept & !local && armed & local & !pending == 0;
    asked && apart && waiting && prompt && timers
}

/// P7 for a timestamp opened with a deadline: until local returned, failed or was given up, the deadline is armed.
pub(crate) fn is_limited(slot: Slot) -> bool {
    !slot.pending().contains(Source::LOCAL) || slot.armed().contains(Source::LOCAL)
}

/// The places of a tree's nodes in ascending order of their timestamps, and how many there are; none if the links are not
/// those of a tree.
pub(crate) fn in_order<const CLOUDS: usize, const CAPACITY: usize>(
    window: &Window<CLOUDS, CAPACITY>,
) -> Option<([usize; CAPACITY], usize)> {
    let mut order = [0; CAPACITY];
    let mut stack = [0; CAPACITY];
    let (mut len, mut depth, mut at, mut up) = (0, 0, window.root, NIL);
    // Each node is met on the way down and on the way up.
    for _ in 0..=2 * CAPACITY {
        if at == NIL {
            if depth == 0 {
                return Some((order, len));
            }
            depth -= 1;
            if len == CAPACITY {
                return None;
            }
            order[len] = stack[depth];
            len += 1;
            up = crate::window::Place(stack[depth] as u16);
            at = window.nodes[stack[depth]].right;
        } else {
            let place = usize::from(at.0);
            if place >= CAPACITY || depth == CAPACITY || window.nodes[place].up != up {
                return None;
            }
            stack[depth] = place;
            depth += 1;
            up = at;
            at = window.nodes[place].left;
        }
    }
    None
}

/// Whether two nodes are the same, field by field.
pub(crate) fn same_node(a: &Node, b: &Node) -> bool {
    a.timestamp == b.timestamp
        && a.due == b.due
        && a.below == b.below
        && a.left == b.left
        && a.right == b.right
        && a.up == b.up
        && a.height == b.height
}

/// What holds of the window: a balanced search tree, in which each node knows the earliest due instant at and below it,
/// beside a list of all other places.
pub(crate) fn is_tree<const CLOUDS: usize, const CAPACITY: usize>(
    window: &Window<CLOUDS, CAPACITY>,
) -> bool {
    let Some((order, len)) = in_order(window) else { return false };
    let mut valid = window.len == len;
    valid &=
        if len == 0 { window.last == NIL } else { usize::from(window.last.0) == order[len - 1] };
    let mut taken = [false; CAPACITY];
    for i in 0..len {
        let node = &window.nodes[order[i]];
        valid &= !taken[order[i]];
        taken[order[i]] = true;
        valid &= i == 0 || window.nodes[order[i - 1]].timestamp < node.timestamp;
        let [left, right] = [node.left, node.right].map(|child| {
            if child == NIL {
                (0, None)
            } else {
                (
                    window.nodes[usize::from(child.0)].height,
                    window.nodes[usize::from(child.0)].below,
                )
            }
        });
        let (high, low) = if left.0 > right.0 { (left.0, right.0) } else { (right.0, left.0) };
        valid &= node.height == high + 1 && high - low <= 1;
        valid &= node.due == earliest(&window.entries[order[i]]);
        valid &= node.below == least(node.due, least(left.1, right.1));
    }
    let mut free = window.free;
    for _ in len..CAPACITY {
        let place = usize::from(free.0);
        if place >= CAPACITY || taken[place] {
            return false;
        }
        taken[place] = true;
        free = window.nodes[place].right;
    }
    valid && free == NIL
}
