//! Orders that loom overlooks by itself.

use std::sync::Arc;

use loom::sync::atomic::{AtomicU64, Ordering};

/// A turn that threads take before each call, so that loom looks at every order of the calls.
///
/// Loom does not do this by itself. It knows only the last access of an atomic, so it overlooks
/// that a load by one thread and an exchange by another could come in the other order if the other
/// thread loads before it exchanges. The turn is relaxed, so it orders nothing else.
#[derive(Clone, Default, Debug)]
pub(crate) struct CallOrder(Arc<AtomicU64>);

impl CallOrder {
    /// Takes a turn.
    pub(crate) fn take(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}
