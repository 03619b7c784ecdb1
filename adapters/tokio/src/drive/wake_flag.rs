//! Wakes the driver, and flags which of its parties is to be polled.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use futures_util::task::AtomicWaker;

/// The waker of one party that takes turns: without it, the party need not be polled.
pub(super) struct WakeFlag {
    flag_waker: Arc<FlagWaker>,
    waker: Waker,
}

/// Sets one party's flag and wakes the driver.
pub(super) struct FlagWaker {
    is_set: AtomicBool,
    driver: Arc<AtomicWaker>,
}

impl WakeFlag {
    /// A flag that is set, so that all parties are polled at first.
    pub(super) fn new(driver: &Arc<AtomicWaker>) -> Self {
        let flag_waker =
            Arc::new(FlagWaker { is_set: AtomicBool::new(true), driver: Arc::clone(driver) });
        Self { waker: Waker::from(Arc::clone(&flag_waker)), flag_waker }
    }

    pub(super) fn flag_waker(&self) -> Arc<FlagWaker> {
        Arc::clone(&self.flag_waker)
    }

    /// Polls whose flag is set; it stays set unless nothing was ready.
    pub(super) fn poll<T>(&self, poll: impl FnOnce(&mut Context<'_>) -> Poll<T>) -> Poll<T> {
        self.flag_waker.is_set.store(false, Ordering::Release);
        let polled = poll(&mut Context::from_waker(&self.waker));
        if polled.is_ready() {
            self.flag_waker.is_set.store(true, Ordering::Release);
        }
        polled
    }

    pub(super) fn is_set(&self) -> bool {
        self.flag_waker.is_set.load(Ordering::Acquire)
    }

    /// Sets the flag without a waker; for the driver itself.
    pub(super) fn set(&self) {
        self.flag_waker.is_set.store(true, Ordering::Release);
    }
}

impl Wake for FlagWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if !self.is_set.swap(true, Ordering::AcqRel) {
            self.driver.wake();
        }
    }
}
