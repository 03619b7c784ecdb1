//! Cells that replace the arrays of the shipped window in proofs, so that these may have any length and any content.
//!
//! An array of a harness has two cells. *Own's* is the one that the call is about; it is anywhere, and nothing else may be read
//! or written, which is asserted. The *other* one is anywhere else and anything. Where all of an array is read, the other
//! has the first of all keys but own's. So what is shown of the two holds of each cell of an array.
//!
//! The functions here are those of arrays that `core/src/window.rs` calls, and do to the two cells what the standard library says that
//! they do to each. `tests/window.rs` compares them with arrays.

use core::cell::Cell;
use core::ops::{Range, RangeFrom, RangeTo};

use crate::cell_window::DueKey;
use crate::time::Timestamp;

#[derive(Clone)]
pub(crate) struct Cells<T, const N: usize> {
    /// Where own's cell is, and the other.
    pub(crate) at: [usize; 2],
    pub(crate) values: [T; 2],
    /// How many cells mean something, where the window does not say.
    pub(crate) rows: usize,
    /// The part that was last taken by `get_mut`.
    pub(crate) part: Range<usize>,
    /// What is in no cell.
    pub(crate) absent: Option<T>,
    /// How many cells were read so far where all of a part is read.
    pub(crate) reads: Cell<usize>,
}

impl<T, const N: usize> Cells<T, N> {
    pub(crate) fn new(at: [usize; 2], values: [T; 2]) -> Self {
        Self { at, values, rows: 0, part: 0..0, absent: None, reads: Cell::new(0) }
    }

    fn is_own(&self, at: usize) -> bool {
        kani::assert(at == self.at[0], "P9: nothing but its own is looked at");
        at < N
    }

    /// All of a part that has own's: own's, and the first of all others.
    fn read_all(&self, cells: usize) -> &[T] {
        self.reads.set(self.reads.get() + cells);
        &self.values
    }
}

/// An array's `get`.
pub(crate) trait Get<I> {
    type Item<'a>
    where
        Self: 'a;
    fn get(&self, at: I) -> Option<Self::Item<'_>>;
}

impl<T, const N: usize> Get<usize> for Cells<T, N> {
    type Item<'a>
        = &'a T
    where
        T: 'a;

    fn get(&self, at: usize) -> Option<&T> {
        self.is_own(at).then_some(&self.values[0])
    }
}

/// An array's `get_mut`.
pub(crate) trait GetMut<I> {
    type Item<'a>
    where
        Self: 'a;
    fn get_mut(&mut self, at: I) -> Option<Self::Item<'_>>;
}

impl<T, const N: usize> GetMut<usize> for Cells<T, N> {
    type Item<'a>
        = &'a mut T
    where
        T: 'a;

    fn get_mut(&mut self, at: usize) -> Option<&mut T> {
        self.is_own(at).then_some(&mut self.values[0])
    }
}

// The rows' first keys.
impl<const N: usize> Get<RangeTo<usize>> for Cells<DueKey, N> {
    type Item<'a> = &'a [DueKey];

    fn get(&self, to: RangeTo<usize>) -> Option<&[DueKey]> {
        kani::assert(to.end == self.rows, "P9: all rows are looked at, and nothing beyond");
        (to.end <= N).then_some(self.read_all(to.end))
    }
}

/// The rows.
pub(crate) struct Chunks<'a, const N: usize> {
    keys: &'a Cells<DueKey, N>,
    of: usize,
}

impl<const N: usize> Cells<DueKey, N> {
    pub(crate) fn chunks(&self, of: usize) -> Chunks<'_, N> {
        Chunks { keys: self, of }
    }
}

impl<'a, const N: usize> Chunks<'a, N> {
    pub(crate) fn nth(&mut self, row: usize) -> Option<&'a [DueKey]> {
        let (from, own) = (row * self.of, self.keys.at[0]);
        let is_own = from <= own && own < from + self.of;
        kani::assert(is_own, "P9: no row but its own is read");
        (from < N).then_some(self.keys.read_all(self.of))
    }
}

/// The open timestamps. They ascend.
pub(crate) struct Open<'a, const N: usize> {
    cells: &'a Cells<Timestamp, N>,
    len: usize,
    first: Timestamp,
    last: Timestamp,
}

impl<const N: usize> Get<RangeTo<usize>> for Cells<Timestamp, N> {
    type Item<'a> = Open<'a, N>;

    fn get(&self, to: RangeTo<usize>) -> Option<Open<'_, N>> {
        let (at, own) = (self.at[0], self.values[0].as_u64());
        let [mut first, mut last]: [u64; 2] = kani::any();
        if at < to.end {
            // Those before it are less, those behind it greater.
            let (is_first, is_last) = (at == 0, at + 1 == to.end);
            kani::assume((is_first || own > 0) && (is_last || own < u64::MAX));
            first = if is_first { own } else { first.min(own.wrapping_sub(1)) };
            last = if is_last { own } else { last.max(own.wrapping_add(1)) };
        }
        let [first, last] = [first, last].map(Timestamp::new);
        kani::assume(self.absent != Some(first) && self.absent != Some(last));
        (to.end <= N).then_some(Open { cells: self, len: to.end, first, last })
    }
}

impl<const N: usize> Open<'_, N> {
    pub(crate) fn first(&self) -> Option<&Timestamp> {
        (self.len > 0).then_some(&self.first)
    }

    pub(crate) fn last(&self) -> Option<&Timestamp> {
        (self.len > 0).then_some(&self.last)
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "so the slice's function takes it")]
    pub(crate) fn binary_search(&self, timestamp: &Timestamp) -> Result<usize, usize> {
        let (at, own) = (self.cells.at[0], self.cells.values[0]);
        let (is_own, is_absent) =
            (at < self.len && *timestamp == own, self.cells.absent == Some(*timestamp));
        kani::assert(is_own || is_absent, "P9: nothing but what is sought is looked for");
        if is_own { Ok(at) } else { Err(kani::any::<u16>().into()) }
    }
}

// A part, to be changed.
impl<T, const N: usize> GetMut<Range<usize>> for Cells<T, N> {
    type Item<'a>
        = &'a mut Self
    where
        T: 'a;

    fn get_mut(&mut self, part: Range<usize>) -> Option<&mut Self> {
        if part.start > part.end || part.end > N {
            return None;
        }
        self.part = part;
        Some(self)
    }
}

/// A type of the values that `copy_within` moves.
pub(crate) trait AnyValue: Copy {
    fn any() -> Self;
}

impl AnyValue for u16 {
    fn any() -> Self {
        kani::any()
    }
}

impl AnyValue for Timestamp {
    fn any() -> Self {
        Self::new(kani::any())
    }
}

impl<T: AnyValue, const N: usize> Cells<T, N> {
    pub(crate) fn is_empty(&self) -> bool {
        self.part.is_empty()
    }

    /// Each value behind the first moves one cell down; the last is in two cells then.
    pub(crate) fn copy_within(&mut self, from: RangeFrom<usize>, to: usize) {
        kani::assert(from.start == 1 && to == 0, "P9: what is behind it moves by one rank");
        kani::assert(!self.is_empty(), "P9: there is something to move");
        kani::assert(self.at[0] == self.part.start, "P9: what is removed is its own");
        // The last keeps what it has, which is now in the cell before it as well.
        let last = self.part.end - 1;
        if self.at[0] != last {
            self.values[0] = if self.at[1] == last { self.values[1] } else { T::any() };
            self.at[0] = last;
        }
        if self.part.contains(&self.at[1]) {
            self.at[1] -= 1;
        }
    }

    pub(crate) fn last_mut(&mut self) -> Option<&mut T> {
        let is_own = self.at[0] + 1 == self.part.end;
        kani::assert(is_own, "P9: what is at the end is put there");
        (!self.is_empty()).then_some(&mut self.values[0])
    }
}
