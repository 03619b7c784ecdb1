//! What is shared, and its two halves.

use crate::clouds::{Cloud, Clouds, ConfigError};
use crate::slot::Commit;
use crate::source::Source;
use crate::time::Timestamp;

use super::desk::Desk;
use super::intake::{Intake, Owner};

/// One operator's machine for many threads, for up to `CLOUDS` (0 to 15) clouds and `WINDOW` (1 to 1024) open
/// timestamps. The [module](super) says what it guarantees.
///
/// Threads that outlive the function that made it need it for ever: `Box::leak`, or a static cell.
#[derive(Debug)]
pub struct Shared<const CLOUDS: usize, const WINDOW: usize> {
    desk: Desk<CLOUDS, WINDOW>,
    owner: Owner<CLOUDS>,
}

/// Names one open message to the machine that opened it. Using it with another machine is not detected.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Ticket {
    pub(super) timestamp: Timestamp,
    pub(super) generation: u64,
    pub(super) place: usize,
}

impl<const CLOUDS: usize, const WINDOW: usize> Shared<CLOUDS, WINDOW> {
    /// A machine with nothing open and its gates open; its arguments are those of [`Fusion::new`](crate::Fusion::new).
    ///
    /// # Errors
    /// The first [`ConfigError`] that holds.
    pub fn new(window: usize, commit: Commit, clouds: &[Cloud]) -> Result<Self, ConfigError> {
        const {
            assert!(CLOUDS < Source::COUNT as usize, "a machine has at most 15 clouds");
            assert!(WINDOW >= 1 && WINDOW <= 1024, "a window holds 1 to 1024 timestamps");
        }
        if window == 0 || window > WINDOW {
            return Err(ConfigError::Window { window, capacity: WINDOW });
        }
        let clouds = Clouds::new(clouds)?;
        Ok(Self { desk: Desk::new(window, commit, clouds), owner: Owner::new(&clouds) })
    }

    /// The one intake, and the desk for all threads. What is open stays so when it is split again.
    pub fn split(&mut self) -> (Intake<'_, CLOUDS, WINDOW>, &Desk<CLOUDS, WINDOW>) {
        let Self { desk, owner } = self;
        (Intake::new(desk, owner), desk)
    }
}

impl Ticket {
    /// The message's timestamp.
    #[must_use]
    pub const fn timestamp(self) -> Timestamp {
        self.timestamp
    }

    /// The message's place, less than the window: no other open message has it.
    #[must_use]
    pub const fn place(self) -> usize {
        self.place
    }
}
