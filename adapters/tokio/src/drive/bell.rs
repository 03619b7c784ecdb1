//! Wakes the driver, and remembers for whom.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use futures_util::task::AtomicWaker;

/// The waker of one party that takes turns: without it, the party need not be polled.
pub(super) struct Bell {
    ring: Arc<Ring>,
    waker: Waker,
}

/// Rings for one and wakes the driver.
pub(super) struct Ring {
    is_rung: AtomicBool,
    driver: Arc<AtomicWaker>,
}

impl Bell {
    /// A bell that rings, so that all parties are polled at first.
    pub(super) fn new(driver: &Arc<AtomicWaker>) -> Self {
        let ring = Arc::new(Ring { is_rung: AtomicBool::new(true), driver: Arc::clone(driver) });
        Self { waker: Waker::from(Arc::clone(&ring)), ring }
    }

    pub(super) fn ring(&self) -> Arc<Ring> {
        Arc::clone(&self.ring)
    }

    /// Polls if the bell rings; it rings on unless nothing was ready.
    pub(super) fn poll<T>(&self, poll: impl FnOnce(&mut Context<'_>) -> Poll<T>) -> Poll<T> {
        if !self.is_rung() {
            return Poll::Pending;
        }
        self.ring.is_rung.store(false, Ordering::Release);
        let polled = poll(&mut Context::from_waker(&self.waker));
        if polled.is_ready() {
            self.ring.is_rung.store(true, Ordering::Release);
        }
        polled
    }

    pub(super) fn is_rung(&self) -> bool {
        self.ring.is_rung.load(Ordering::Acquire)
    }

    /// Rings without a waker; for the driver itself.
    pub(super) fn set(&self) {
        self.ring.is_rung.store(true, Ordering::Release);
    }
}

impl Wake for Ring {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if !self.is_rung.swap(true, Ordering::AcqRel) {
            self.driver.wake();
        }
    }
}
