//! Ctrl-C and termination: asked for once, seen by whoever polls or waits.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use tokio::sync::Notify;

/// Whether the user wants the command to end.
#[derive(Clone, Default)]
pub(crate) struct Interrupt {
    inner: Arc<Inner>,
}

#[derive(Default)]
struct Inner {
    came: AtomicBool,
    waiting: Notify,
}

static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

impl Interrupt {
    /// From now on Ctrl-C and termination no longer end the process but set this.
    ///
    /// Where the system refuses a handler they end it as before.
    pub(crate) fn watch() -> Self {
        INTERRUPT
            .get_or_init(|| {
                let interrupt = Self::default();
                let seen = interrupt.clone();
                if ctrlc::set_handler(move || seen.set()).is_err() {
                    eprintln!("warning: Ctrl-C will end the command at once");
                }
                interrupt
            })
            .clone()
    }

    /// Whether it came.
    pub(crate) fn came(&self) -> bool {
        self.inner.came.load(Ordering::Acquire)
    }

    /// Waits until it comes.
    pub(crate) async fn wait(&self) {
        loop {
            let notified = self.inner.waiting.notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            if self.came() {
                return;
            }
            notified.await;
        }
    }

    /// Makes it come.
    pub(crate) fn set(&self) {
        self.inner.came.store(true, Ordering::Release);
        self.inner.waiting.notify_waiters();
    }
}
