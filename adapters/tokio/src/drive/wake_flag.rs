//! Wakes the driver, and flags which of its parties is to be polled.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use futures_util::task::AtomicWaker;

use crate::drive::{CALLS, TURNS};

/// Flags of the parties that take turns: without its flag, a party need not be polled.
pub(super) struct WakeFlags {
    driver: Arc<DriverWaker>,
    wakers: [Waker; TURNS],
}

/// Wakes one driver. All that is needed for it is in one place: of one operator among thousands nothing is in the processor's
/// cache when it is woken.
#[derive(Default)]
#[repr(C)]
pub(super) struct DriverWaker {
    are_set: [AtomicBool; TURNS],
    /// Among which slots of calls some were woken since the driver looked: the bit of a slot is its index modulo 64.
    woken: AtomicU64,
    task: AtomicWaker,
}

/// Sets one party's flag and wakes the driver.
struct SourceWaker {
    driver: Arc<DriverWaker>,
    party: usize,
}

impl WakeFlags {
    /// Makes flags that are all set, so that each party is polled at first.
    pub(super) fn new() -> Self {
        let driver = Arc::new(DriverWaker::default());
        let wakers = std::array::from_fn(|party| {
            driver.set(party);
            Waker::from(Arc::new(SourceWaker { driver: Arc::clone(&driver), party }))
        });
        Self { driver, wakers }
    }

    pub(super) fn driver(&self) -> Arc<DriverWaker> {
        Arc::clone(&self.driver)
    }

    /// Polls a party whose flag is set; it stays set unless nothing was ready.
    pub(super) fn poll<T>(
        &self,
        party: usize,
        poll: impl FnOnce(&mut Context<'_>) -> Poll<T>,
    ) -> Poll<T> {
        self.driver.are_set[party].store(false, Ordering::Release);
        let polled = poll(&mut Context::from_waker(&self.wakers[party]));
        if polled.is_ready() {
            self.driver.set(party);
        }
        polled
    }

    /// Registers the driver, which is woken when a flag is set.
    pub(super) fn wait(&self, context: &Context<'_>) {
        self.driver.task.register(context.waker());
        // One may have been set before the waker was registered.
        if (0..TURNS).any(|party| self.is_set(party)) {
            context.waker().wake_by_ref();
        }
    }

    pub(super) fn is_set(&self, party: usize) -> bool {
        self.driver.are_set[party].load(Ordering::Acquire)
            || party == CALLS && self.driver.woken.load(Ordering::Acquire) != 0
    }

    /// Sets a flag without a waker; for the driver itself.
    pub(super) fn set(&self, party: usize) {
        self.driver.set(party);
    }
}

impl DriverWaker {
    /// Slots with these bits were woken. Unless it has yet to look at earlier ones, the driver is woken too.
    pub(super) fn wake_slot(&self, bits: u64) {
        if self.woken.fetch_or(bits, Ordering::AcqRel) == 0 {
            self.task.wake();
        }
    }

    /// Returns the bits of the slots that were woken.
    pub(super) fn take_woken(&self) -> u64 {
        self.woken.swap(0, Ordering::AcqRel)
    }

    fn set(&self, party: usize) {
        self.are_set[party].store(true, Ordering::Release);
    }

    fn wake(&self, party: usize) {
        if !self.are_set[party].swap(true, Ordering::AcqRel) {
            self.task.wake();
        }
    }
}

impl Wake for SourceWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.driver.wake(self.party);
    }
}
