//! Orders that loom overlooks by itself.

use std::sync::Arc;

use loom::sync::atomic::{AtomicU64, Ordering};

/// What threads take before each call, so that loom looks at every order of the calls.
///
/// It does not by itself: of an atomic it knows the last access alone, so it overlooks that a load by one thread and an
/// exchange by another could come the other way round if the other one loads before it exchanges. Being relaxed, it
/// orders nothing else.
#[derive(Clone, Default, Debug)]
pub struct CallOrder(Arc<AtomicU64>);

impl CallOrder {
    /// Takes it.
    pub fn take(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}
