//! The open timestamps: one balanced tree, ordered by timestamp, in which each node knows the earliest due
//! instant at or below it (P9).
//!
//! So a timestamp and the next timer are found in at most [`MAX_HEIGHT`] steps, the next due instant in none,
//! and equal dues are met in the order of their timestamps (F5). It is an AVL tree (Adelson-Velsky and Landis,
//! 1962) over a fixed array. Timestamps come in ascending order (F1), so nodes join at the right end alone.
//! Reading beside the tree yields [`Node::NIL`] and writing there does nothing: no place can panic.

use crate::entry::Entry;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Instant, Timestamp};

/// The height of the sparsest AVL tree with 1024 nodes: one with 15 levels has at least 1596.
const MAX_HEIGHT: usize = 14;

/// An index into the arrays.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Place(pub(crate) u16);

pub(crate) const NIL: Place = Place(u16::MAX);

#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

impl Side {
    const fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

#[derive(Clone, Copy)]
pub(crate) struct Node {
    pub(crate) timestamp: Timestamp,
    /// The earliest due instant among this timestamp's armed timers.
    pub(crate) due: Option<Instant>,
    /// The earliest at or below this node.
    pub(crate) below: Option<Instant>,
    pub(crate) left: Place,
    pub(crate) right: Place,
    pub(crate) up: Place,
    pub(crate) height: u8,
}

impl Node {
    pub(crate) const NIL: Self = Self {
        timestamp: Timestamp::new(0),
        due: None,
        below: None,
        left: NIL,
        right: NIL,
        up: NIL,
        height: 0,
    };
}

/// The earlier of two dues; none is later than any.
fn earlier(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (due, None) | (None, due) => due,
    }
}

#[derive(Clone)]
pub(crate) struct Window<const CLOUDS: usize, const CAPACITY: usize> {
    pub(crate) nodes: [Node; CAPACITY],
    pub(crate) entries: [Entry<CLOUDS>; CAPACITY],
    pub(crate) root: Place,
    /// The greatest timestamp, at the right end.
    pub(crate) last: Place,
    /// The first free place; the others follow by `right`.
    pub(crate) free: Place,
    pub(crate) len: usize,
}

impl<const CLOUDS: usize, const CAPACITY: usize> Window<CLOUDS, CAPACITY> {
    pub(crate) fn new() -> Self {
        let mut nodes = [Node::NIL; CAPACITY];
        let mut free = NIL;
        let mut place = 0;
        for node in &mut nodes {
            node.right = free;
            free = Place(place);
            place = place.wrapping_add(1);
        }
        Self { nodes, entries: [Entry::EMPTY; CAPACITY], root: NIL, last: NIL, free, len: 0 }
    }

    /// Adds a timestamp greater than all present; false if there is no room.
    pub(crate) fn push(&mut self, timestamp: Timestamp, entry: Entry<CLOUDS>) -> bool {
        let place = self.free;
        let next_free = self.node(place).right;
        let due = entry.next_due();
        let (Some(node), Some(slot)) =
            (self.nodes.get_mut(usize::from(place.0)), self.entries.get_mut(usize::from(place.0)))
        else {
            return false;
        };
        *node = Node { timestamp, due, below: due, height: 1, ..Node::NIL };
        *slot = entry;
        self.free = next_free;
        self.len = self.len.saturating_add(1);
        if self.root == NIL {
            self.root = place;
        } else {
            self.join(self.last, Side::Right, place);
        }
        let parent = self.last;
        self.last = place;
        self.mend(parent);
        true
    }

    /// Puts the state at a place of the tree in which `source` is armed anew, and its due instant.
    pub(crate) fn arm(&mut self, place: Place, slot: Slot, source: Source, due: Instant) {
        let Some(entry) = self.entries.get_mut(usize::from(place.0)) else { return };
        entry.slot = slot;
        entry.set_due(source, due);
        if let Some(node) = self.nodes.get_mut(usize::from(place.0)) {
            node.due = earlier(node.due, Some(due));
        }
        // One more due can only bring those above forward.
        let mut at = place;
        for _ in 0..MAX_HEIGHT {
            let Some(node) = self.nodes.get_mut(usize::from(at.0)) else { break };
            if node.below.is_some_and(|below| below <= due) {
                break;
            }
            node.below = Some(due);
            at = node.up;
        }
    }

    /// Puts a state at a place of the tree in which no more is armed than before.
    pub(crate) fn set(&mut self, place: Place, slot: Slot) {
        let Some(entry) = self.entries.get_mut(usize::from(place.0)) else { return };
        let armed = core::mem::replace(&mut entry.slot, slot).armed();
        if armed == slot.armed() {
            return;
        }
        let due = entry.next_due();
        let Some(node) = self.nodes.get_mut(usize::from(place.0)) else { return };
        if core::mem::replace(&mut node.due, due) != due {
            self.mend(place);
        }
    }

    /// Takes a place of the tree out of it.
    pub(crate) fn remove(&mut self, place: Place) {
        let Node { left, right, up, height, below, .. } = *self.node(place);
        if place == self.last {
            // Nothing is at its right, so at most a leaf is at its left.
            self.last = if left == NIL { up } else { left };
        }
        if left == NIL || right == NIL {
            self.replace(place, if left == NIL { right } else { left });
            self.mend(up);
        } else {
            let heir = self.leftmost(right);
            let mut lowest = self.node(heir).up;
            if lowest == place {
                lowest = heir;
            } else {
                self.replace(heir, self.node(heir).right);
                self.join(heir, Side::Right, right);
            }
            self.join(heir, Side::Left, left);
            self.replace(place, heir);
            // What its ancestors know of the place still stands; mending says what changed.
            if let Some(node) = self.nodes.get_mut(usize::from(heir.0)) {
                node.height = height;
                node.below = below;
            }
            self.mend(lowest);
            self.mend(heir);
        }
        if let Some(node) = self.nodes.get_mut(usize::from(place.0)) {
            *node = Node { right: self.free, ..Node::NIL };
            self.free = place;
            self.len = self.len.saturating_sub(1);
        }
    }

    pub(crate) fn find(&self, timestamp: Timestamp) -> Option<Place> {
        // Offers follow their message's open.
        if self.nodes.get(usize::from(self.last.0))?.timestamp == timestamp {
            return Some(self.last);
        }
        let mut at = self.root;
        for _ in 0..MAX_HEIGHT {
            let node = self.nodes.get(usize::from(at.0))?;
            if timestamp == node.timestamp {
                return Some(at);
            }
            at = if timestamp < node.timestamp { node.left } else { node.right };
        }
        None
    }

    /// The least open timestamp that is at least `timestamp`.
    pub(crate) fn at_least(&self, timestamp: Timestamp) -> Option<(Timestamp, &Entry<CLOUDS>)> {
        let mut at = self.root;
        let mut found = None;
        for _ in 0..MAX_HEIGHT {
            let Some(node) = self.nodes.get(usize::from(at.0)) else { break };
            if node.timestamp >= timestamp {
                found = Some((node.timestamp, self.entry(at)));
                at = node.left;
            } else {
                at = node.right;
            }
        }
        found
    }

    /// The earliest due instant.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.node(self.root).below
    }

    /// F5: the least timestamp with a timer due at `due`, which is the next due instant.
    pub(crate) fn first_due(&self) -> Option<Place> {
        let due = self.node(self.root).below.unwrap_or(Instant::END);
        let mut at = self.root;
        for _ in 0..MAX_HEIGHT {
            let node = self.node(at);
            if self.node(node.left).below == Some(due) {
                at = node.left;
            } else if node.due == Some(due) {
                break;
            } else {
                at = node.right;
            }
        }
        Some(at)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (Timestamp, &Entry<CLOUDS>)> {
        let mut next = Some(Timestamp::new(0));
        core::iter::from_fn(move || {
            let (timestamp, entry) = self.at_least(next?)?;
            next = timestamp.as_u64().checked_add(1).map(Timestamp::new);
            Some((timestamp, entry))
        })
    }

    pub(crate) fn entry(&self, place: Place) -> &Entry<CLOUDS> {
        self.entries.get(usize::from(place.0)).unwrap_or(&Entry::EMPTY)
    }

    pub(crate) fn timestamp(&self, place: Place) -> Timestamp {
        self.node(place).timestamp
    }

    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    fn node(&self, place: Place) -> &Node {
        self.nodes.get(usize::from(place.0)).unwrap_or(&Node::NIL)
    }

    fn child(&self, place: Place, side: Side) -> Place {
        match side {
            Side::Left => self.node(place).left,
            Side::Right => self.node(place).right,
        }
    }

    fn leftmost(&self, mut place: Place) -> Place {
        for _ in 0..MAX_HEIGHT {
            let left = self.node(place).left;
            if left == NIL {
                break;
            }
            place = left;
        }
        place
    }

    /// Makes `child` the child of `parent` on that side.
    fn join(&mut self, parent: Place, side: Side, child: Place) {
        if let Some(node) = self.nodes.get_mut(usize::from(parent.0)) {
            match side {
                Side::Left => node.left = child,
                Side::Right => node.right = child,
            }
        }
        if let Some(node) = self.nodes.get_mut(usize::from(child.0)) {
            node.up = parent;
        }
    }

    /// Puts `new` where `old` hangs.
    fn replace(&mut self, old: Place, new: Place) {
        let up = self.node(old).up;
        if up == NIL {
            self.root = new;
            if let Some(node) = self.nodes.get_mut(usize::from(new.0)) {
                node.up = NIL;
            }
        } else {
            let side = if self.node(up).left == old { Side::Left } else { Side::Right };
            self.join(up, side, new);
        }
    }

    /// Restores balance and dues from `at` upwards, until an ancestor already knows.
    fn mend(&mut self, mut at: Place) {
        for _ in 0..MAX_HEIGHT {
            let Some(node) = self.nodes.get(usize::from(at.0)) else { break };
            let (height, below) = (node.height, node.below);
            let top = match self.lean(node) {
                Some(side) => self.rotate_towards(at, side.other()),
                None => at,
            };
            self.pull(top);
            let node = self.node(top);
            if node.height == height && node.below == below {
                break;
            }
            at = node.up;
        }
    }

    /// The side that is two levels higher than the other, if any.
    fn lean(&self, node: &Node) -> Option<Side> {
        let (left, right) = (self.node(node.left).height, self.node(node.right).height);
        if left > right.saturating_add(1) {
            Some(Side::Left)
        } else if right > left.saturating_add(1) {
            Some(Side::Right)
        } else {
            None
        }
    }

    /// Computes what `at` knows from its children.
    fn pull(&mut self, at: Place) {
        let node = self.node(at);
        let (left, right) = (self.node(node.left), self.node(node.right));
        let below = earlier(node.due, earlier(left.below, right.below));
        let height = left.height.max(right.height).saturating_add(1);
        if let Some(node) = self.nodes.get_mut(usize::from(at.0)) {
            node.below = below;
            node.height = height;
        }
    }

    /// Lowers `at` to that side, once its other child leans outwards.
    fn rotate_towards(&mut self, at: Place, side: Side) -> Place {
        let high = self.child(at, side.other());
        let (outer, inner) = (self.child(high, side.other()), self.child(high, side));
        if self.node(inner).height > self.node(outer).height {
            self.rotate(high, side.other());
        }
        self.rotate(at, side)
    }

    fn rotate(&mut self, at: Place, side: Side) -> Place {
        let riser = self.child(at, side.other());
        let moved = self.child(riser, side);
        self.replace(at, riser);
        self.join(at, side.other(), moved);
        self.join(riser, side, at);
        self.pull(at);
        self.pull(riser);
        riser
    }
}
