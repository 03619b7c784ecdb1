//! Ctrl-C and termination: caught once, seen by all who poll or wait.

use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use tokio::sync::Notify;

use crate::diagnostics::print_line;
use crate::exit::INTERRUPTED;
use crate::output::discard;

/// Records whether the user wants the command to end.
#[derive(Clone, Default)]
pub(crate) struct Interrupt {
    inner: Arc<InterruptState>,
}

#[derive(Default)]
struct InterruptState {
    is_set: AtomicBool,
    waiting: Notify,
}

static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

impl Interrupt {
    /// From now on Ctrl-C and termination no longer end the process but set this.
    ///
    /// If the system refuses a handler, they end the command as before.
    pub(crate) fn watch() -> Self {
        INTERRUPT
            .get_or_init(|| {
                let interrupt = Self::default();
                let flag = interrupt.clone();
                let handler = move || {
                    // A second one: do not wait for what is under way.
                    if flag.is_set() {
                        discard();
                        print_line("interrupted twice; what was not written yet is lost");
                        process::exit(INTERRUPTED);
                    }
                    flag.set();
                };
                if ctrlc::set_handler(handler).is_err() {
                    print_line("warning: Ctrl-C will end the command at once");
                }
                interrupt
            })
            .clone()
    }

    pub(crate) fn is_set(&self) -> bool {
        self.inner.is_set.load(Ordering::Acquire)
    }

    pub(crate) async fn wait(&self) {
        loop {
            let notified = self.inner.waiting.notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            if self.is_set() {
                return;
            }
            notified.await;
        }
    }

    /// Acts as if it had come.
    pub(crate) fn set(&self) {
        self.inner.is_set.store(true, Ordering::Release);
        self.inner.waiting.notify_waiters();
    }
}
