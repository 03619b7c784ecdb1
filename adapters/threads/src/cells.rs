//! The cells that store one message's values until one of them is forwarded.

use std::sync::PoisonError;
#[cfg(not(loom))]
use std::sync::{Mutex, MutexGuard};

#[cfg(loom)]
use loom::sync::{Mutex, MutexGuard};

use fuseline_core::Source;

/// Stores the value of each source in a cell of its own.
#[derive(Debug)]
pub(crate) struct SourceCells<T, const CLOUDS: usize> {
    local: Mutex<Option<T>>,
    clouds: [Mutex<Option<T>>; CLOUDS],
}

impl<T, const CLOUDS: usize> SourceCells<T, CLOUDS> {
    pub(crate) fn new() -> Self {
        let clouds = std::array::from_fn(|_| Mutex::new(None));
        Self { local: Mutex::new(None), clouds }
    }

    pub(crate) fn put(&self, source: Source, value: T) {
        if let Some(cell) = self.cell(source) {
            *alone(cell) = Some(value);
        }
    }

    pub(crate) fn take(&self, source: Source) -> Option<T> {
        alone(self.cell(source)?).take()
    }

    /// Drops the values that were discarded.
    pub(crate) fn clear(&mut self) {
        for cell in std::iter::once(&mut self.local).chain(&mut self.clouds) {
            *cell.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }

    fn cell(&self, source: Source) -> Option<&Mutex<Option<T>>> {
        match usize::from(source.index()).checked_sub(1) {
            None => Some(&self.local),
            Some(cloud) => self.clouds.get(cloud),
        }
    }
}

/// Locks a cell that no other thread uses at this time.
fn alone<T>(cell: &Mutex<T>) -> MutexGuard<'_, T> {
    cell.try_lock().unwrap_or_else(|_| {
        debug_assert!(false, "two threads want one cell");
        cell.lock().unwrap_or_else(PoisonError::into_inner)
    })
}
