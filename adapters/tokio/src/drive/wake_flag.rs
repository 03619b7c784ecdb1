//! Wakes the driver, and notes which of its parties need to be polled.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use futures_util::task::AtomicWaker;

use crate::drive::{CALLS, TURNS};

/// The flags of the parties that take turns. A party is polled only if its flag is set.
pub(super) struct WakeFlags {
    driver: Arc<DriverWaker>,
    wakers: [Waker; TURNS],
}

/// Wakes one driver. Everything that this needs lies together, because an operator among thousands
/// has nothing in the processor's caches when it is woken.
#[derive(Default)]
#[repr(C)]
pub(super) struct DriverWaker {
    are_set: [AtomicBool; TURNS],
    /// The slots of calls that were woken since the driver last looked. A slot's bit is its index
    /// modulo 64.
    woken: AtomicU64,
    task: AtomicWaker,
}

/// Sets one party's flag and wakes the driver.
struct SourceWaker {
    driver: Arc<DriverWaker>,
    party: usize,
}

impl WakeFlags {
    /// Creates flags that are all set, so that each party is polled once.
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

    /// Polls a party whose flag is set. Clears the flag if the party was not ready.
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

    /// Registers the driver's task, which is woken when a flag is set.
    pub(super) fn wait(&self, context: &Context<'_>) {
        self.driver.task.register(context.waker());
        // A flag may have been set before the waker was registered.
        if (0..TURNS).any(|party| self.is_set(party)) {
            context.waker().wake_by_ref();
        }
    }

    pub(super) fn is_set(&self, party: usize) -> bool {
        self.driver.are_set[party].load(Ordering::Acquire)
            || party == CALLS && self.driver.woken.load(Ordering::Acquire) != 0
    }

    /// Sets a flag and wakes nobody. The driver itself uses this.
    pub(super) fn set(&self, party: usize) {
        self.driver.set(party);
    }
}

impl DriverWaker {
    /// Notes that slots with these bits were woken. Wakes the driver, unless it was woken for
    /// earlier ones and has not looked yet.
    pub(super) fn wake_slot(&self, bits: u64) {
        if self.woken.fetch_or(bits, Ordering::AcqRel) == 0 {
            self.task.wake();
        }
    }

    /// Returns the bits of the slots that were woken, and clears them.
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
