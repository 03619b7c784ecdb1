//! The shared machine and its two halves.

use fuseline_core::{Cloud, Clouds, Commit, ConfigError};

use crate::handle::SharedHandle;
use crate::owner::{Owner, OwnerState};

/// One operator's machine for many threads, with up to `CLOUDS` (0 to 15) clouds and `WINDOW` (1 to 1024)
/// open timestamps. The documentation of the [crate](crate) says what it guarantees.
///
/// Threads that outlive the function that made the machine need a `'static` machine, such as one
/// from `Box::leak` or a static cell.
///
/// ```
/// use fuseline_core::{Admission, Cloud, Commit, Deadline, Instant, Outcome, Priority, Timestamp};
/// use fuseline_threads::Shared;
///
/// let cloud = Priority::new(1);
/// let mut shared = Shared::<3, 16>::new(16, Commit::Eager, &[Cloud::new(cloud, 31)])?;
/// let (mut owner, handle) = shared.split();
/// let now = Instant::START;
/// let id = owner.open(now, Timestamp::new(0), None).expect("there is room");
/// let (_, admission) = owner.offer(now, id, cloud, Deadline::from_millis(400), 0);
/// let Admission::Admitted { due } = admission else { panic!("the queue is empty") };
///
/// // Any thread may give a result, at the instant that its own clock reads.
/// let (fired, outcome) = handle.result(now, id, Priority::LOCAL);
/// assert_eq!((fired, outcome), (None, Outcome::Held));
/// // Exactly one call gets `Forwarded`.
/// let fired = handle.expire(due, id).expect("its timer is due");
/// assert!(matches!(fired.outcome, Outcome::Forwarded { by: Priority::LOCAL, .. }));
/// # Ok::<(), fuseline_core::ConfigError>(())
/// ```
#[derive(Debug)]
pub struct Shared<const CLOUDS: usize, const WINDOW: usize> {
    handle: SharedHandle<CLOUDS, WINDOW>,
    state: OwnerState<CLOUDS>,
}

impl<const CLOUDS: usize, const WINDOW: usize> Shared<CLOUDS, WINDOW> {
    /// Creates a machine without open messages and with open gates. The arguments are those of
    /// [`Fusion::new`](fuseline_core::Fusion::new).
    ///
    /// # Errors
    /// Returns the first [`ConfigError`] that holds.
    pub fn new(window: usize, commit: Commit, clouds: &[Cloud]) -> Result<Self, ConfigError> {
        let window = ConfigError::check_window::<WINDOW>(window)?;
        let clouds = Clouds::new(clouds)?;
        Ok(Self {
            handle: SharedHandle::new(window, commit, clouds),
            state: OwnerState::new(clouds),
        })
    }

    /// Splits the machine into its one owner and the handle for all threads. Splitting it again
    /// keeps the open messages.
    pub fn split(&mut self) -> (Owner<'_, CLOUDS, WINDOW>, &SharedHandle<CLOUDS, WINDOW>) {
        let Self { handle, state } = self;
        (Owner::new(handle, state), handle)
    }
}
