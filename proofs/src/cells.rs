//! Cells that replace the arrays of the shipped window in proofs, so that the arrays may have any length and
//! contents.
//!
//! An array of a harness has two cells. *Own's* cell is the one that the call is about. It may be
//! anywhere, and an assertion forbids that anything else is read or written. The *other* cell is
//! anywhere else, with any value. So a statement that holds for the two cells holds for each cell
//! of an array. The keys are in `levels.rs`.
//!
//! The functions here replace the functions of arrays that `core/src/window.rs` calls. They do to
//! the two cells what the standard library does to each cell of an array. `tests/window.rs`
//! compares them with arrays.

use core::ops::{Range, RangeFrom, RangeTo};

use crate::cell_window::DueKey;
use crate::entry::Entry;
use crate::levels::Levels;
use crate::time::Timestamp;

/// The element of an array.
pub(crate) trait Element {
    /// The type that replaces the array.
    type Cells: Clone;
}

pub(crate) type CellsOf<T> = <T as Element>::Cells;

impl Element for Timestamp {
    type Cells = Cells<Self>;
}

impl Element for u16 {
    type Cells = Cells<Self>;
}

impl<const CLOUDS: usize> Element for Entry<CLOUDS> {
    type Cells = Cells<Self>;
}

impl Element for DueKey {
    type Cells = Levels;
}

#[derive(Clone)]
pub(crate) struct Cells<T> {
    /// The places of own's cell and of the other one. At the array's length there is no cell.
    pub(crate) at: [usize; 2],
    pub(crate) values: [T; 2],
    /// The array's length.
    pub(crate) size: usize,
    /// The part that `get_mut` took last.
    pub(crate) part: Range<usize>,
    /// The value outside of the cells.
    pub(crate) absent: Option<T>,
}

impl<T> Cells<T> {
    pub(crate) const fn new(at: [usize; 2], values: [T; 2], size: usize) -> Self {
        Self { at, values, size, part: 0..0, absent: None }
    }

    pub(crate) const fn as_flattened(&self) -> &Self {
        self
    }

    pub(crate) const fn as_flattened_mut(&mut self) -> &mut Self {
        self
    }

    /// Returns the length of the part.
    pub(crate) fn len(&self) -> usize {
        self.part.len()
    }

    fn is_own(&self, at: usize) -> bool {
        kani::assert(at == self.at[0], "P9: nothing but its own is looked at");
        at < self.size
    }
}

/// Stands for an array's `get`.
pub(crate) trait Get<I> {
    type Item<'a>
    where
        Self: 'a;
    fn get(&self, at: I) -> Option<Self::Item<'_>>;
}

impl<T> Get<usize> for Cells<T> {
    type Item<'a>
        = &'a T
    where
        T: 'a;

    fn get(&self, at: usize) -> Option<&T> {
        self.is_own(at).then_some(&self.values[0])
    }
}

/// Stands for an array's `get_mut`.
pub(crate) trait GetMut<I> {
    type Item<'a>
    where
        Self: 'a;
    fn get_mut(&mut self, at: I) -> Option<Self::Item<'_>>;
}

impl<T> GetMut<usize> for Cells<T> {
    type Item<'a>
        = &'a mut T
    where
        T: 'a;

    fn get_mut(&mut self, at: usize) -> Option<&mut T> {
        self.is_own(at).then_some(&mut self.values[0])
    }
}

/// The open timestamps, ascending.
pub(crate) struct Open<'a> {
    cells: &'a Cells<Timestamp>,
    places: Range<usize>,
    first: Timestamp,
    last: Timestamp,
}

impl Get<Range<usize>> for Cells<Timestamp> {
    type Item<'a> = Open<'a>;

    fn get(&self, places: Range<usize>) -> Option<Open<'_>> {
        let (at, own) = (self.at[0], self.values[0].as_u64());
        let [mut first, mut last]: [u64; 2] = kani::any();
        if places.contains(&at) {
            // The cells before it are less, and the cells behind it are greater.
            let (is_first, is_last) = (at == places.start, at + 1 == places.end);
            kani::assume((is_first || own > 0) && (is_last || own < u64::MAX));
            first = if is_first { own } else { first.min(own.wrapping_sub(1)) };
            last = if is_last { own } else { last.max(own.wrapping_add(1)) };
        }
        let [first, last] = [first, last].map(Timestamp::new);
        kani::assume(self.absent != Some(first) && self.absent != Some(last));
        let fits = places.start <= places.end && places.end <= self.size;
        fits.then_some(Open { cells: self, places, first, last })
    }
}

impl Open<'_> {
    pub(crate) fn first(&self) -> Option<&Timestamp> {
        (!self.places.is_empty()).then_some(&self.first)
    }

    pub(crate) fn last(&self) -> Option<&Timestamp> {
        (!self.places.is_empty()).then_some(&self.last)
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "so the slice's function takes it")]
    pub(crate) fn binary_search(&self, timestamp: &Timestamp) -> Result<usize, usize> {
        let (at, own) = (self.cells.at[0], self.cells.values[0]);
        let is_own = self.places.contains(&at) && *timestamp == own;
        let is_absent = self.cells.absent == Some(*timestamp);
        kani::assert(is_own || is_absent, "P9: nothing but what is sought is looked for");
        if is_own { Ok(at - self.places.start) } else { Err(kani::any::<u16>().into()) }
    }
}

// Takes a part in order to change it.
impl<T> GetMut<Range<usize>> for Cells<T> {
    type Item<'a>
        = &'a mut Self
    where
        T: 'a;

    fn get_mut(&mut self, part: Range<usize>) -> Option<&mut Self> {
        if part.start > part.end || part.end > self.size {
            return None;
        }
        self.part = part;
        Some(self)
    }
}

/// A type whose values are moved.
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

/// Stands for a slice's `copy_within`.
pub(crate) trait CopyWithin<R> {
    fn copy_within(&mut self, from: R, to: usize);
}

/// Moves each value behind the first one cell down. The last value is then in two cells.
impl<T: AnyValue> CopyWithin<RangeFrom<usize>> for Cells<T> {
    fn copy_within(&mut self, from: RangeFrom<usize>, to: usize) {
        kani::assert(from.start == 1 && to == 0, "P9: what is behind it moves by one place");
        kani::assert(!self.part.is_empty(), "P9: there is something to move");
        kani::assert(self.at[0] == self.part.start, "P9: what is removed is its own");
        if self.part.contains(&self.at[1]) {
            self.at[1] -= 1;
        }
        self.move_own(self.part.end - 1);
    }
}

/// Moves each value before the last one cell up. The first value is then in two cells.
impl<T: AnyValue> CopyWithin<RangeTo<usize>> for Cells<T> {
    fn copy_within(&mut self, from: RangeTo<usize>, to: usize) {
        let moves = from.end + 1 == self.part.len() && to == 1;
        kani::assert(moves, "P9: what is before it moves by one place");
        kani::assert(self.at[0] == self.part.end - 1, "P9: what is removed is its own");
        if self.part.contains(&self.at[1]) {
            self.at[1] += 1;
        }
        self.move_own(self.part.start);
    }
}

impl<T: AnyValue> Cells<T> {
    /// Moves own's cell to another place, and knows nothing of its value there.
    fn move_own(&mut self, to: usize) {
        self.at[0] = to;
        self.values[0] = T::any();
    }

    pub(crate) fn split_at_mut_checked(
        &mut self,
        at: usize,
    ) -> Option<(FirstCells<'_, T>, LastCells)> {
        let tail = LastCells(at..self.size);
        (at <= self.size).then_some((FirstCells { cells: self, len: at }, tail))
    }
}

/// The first cells of an array.
pub(crate) struct FirstCells<'a, T> {
    cells: &'a mut Cells<T>,
    len: usize,
}

/// The cells behind the first cells.
pub(crate) struct LastCells(Range<usize>);

impl LastCells {
    pub(crate) fn get(&self, to: RangeTo<usize>) -> Option<Self> {
        let from = self.0.start;
        (to.end <= self.0.len()).then_some(Self(from..from + to.end))
    }
}

impl<T: AnyValue> FirstCells<'_, T> {
    pub(crate) fn get_mut(self, to: RangeTo<usize>) -> Option<Self> {
        (to.end <= self.len).then_some(Self { len: to.end, ..self })
    }

    /// Copies the cells. Own's cell is behind them, before and afterwards.
    pub(crate) fn copy_from_slice(self, from: LastCells) {
        let (cells, LastCells(places)) = (self.cells, from);
        kani::assert(places.len() == self.len, "P9: as many are taken as are written");
        kani::assert(cells.at[0] == places.end, "P9: all that are open move, and nothing else");
        if places.contains(&cells.at[1]) {
            cells.at[1] -= places.start;
        } else if cells.at[1] <= self.len {
            // The cell is overwritten, or it is own's and was not open.
            cells.at[1] = cells.size;
        }
        cells.move_own(self.len);
    }
}
