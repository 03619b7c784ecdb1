//! What goes in and comes out: values that name their source, message and instant, and are counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A message from the camera.
pub(crate) struct Frame {
    pub(crate) serial: usize,
    _alive: Alive,
}

/// A result.
pub(crate) struct Value {
    pub(crate) told: Told,
    _alive: Alive,
}

/// What a value says of itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Told {
    /// The source's priority.
    pub(crate) p: u16,
    /// The timestamp that the source was told.
    pub(crate) t: u64,
    /// The message that the source was given.
    pub(crate) serial: usize,
    /// When it was made, in ns.
    pub(crate) at: u64,
}

/// How many of one kind there are, and were at most.
#[derive(Clone, Default)]
pub(crate) struct Census(Arc<[AtomicUsize; 2]>);

struct Alive(Census);

impl Frame {
    pub(crate) fn new(serial: usize, census: &Census) -> Self {
        Self { serial, _alive: census.born() }
    }
}

impl Value {
    pub(crate) fn new(told: Told, census: &Census) -> Self {
        Self { told, _alive: census.born() }
    }
}

impl Census {
    pub(crate) fn now(&self) -> usize {
        self.0[0].load(Ordering::Relaxed)
    }

    pub(crate) fn most(&self) -> usize {
        self.0[1].load(Ordering::Relaxed)
    }

    fn born(&self) -> Alive {
        let now = self.0[0].fetch_add(1, Ordering::Relaxed) + 1;
        self.0[1].fetch_max(now, Ordering::Relaxed);
        Alive(self.clone())
    }
}

impl Drop for Alive {
    fn drop(&mut self) {
        self.0.0[0].fetch_sub(1, Ordering::Relaxed);
    }
}
