//! State that parts of an operator share.

use std::fmt;
use std::sync::{Arc, Mutex};

use fuseline_engine::lock;

/// Shares state between local, handlers and side requests. Clones share the same state.
///
/// ```
/// # use fuseline_tokio::SharedState;
/// let plans = SharedState::new(Vec::new());
/// let cached = plans.clone(); // one for each closure
/// cached.with(|plans| plans.push("swerve left"));
/// assert_eq!(plans.with(|plans| plans.len()), 1);
/// ```
pub struct SharedState<T>(Arc<Mutex<T>>);

impl<T> SharedState<T> {
    /// Creates shared state that begins as `state`.
    #[must_use]
    pub fn new(state: T) -> Self {
        Self(Arc::new(Mutex::new(state)))
    }

    /// Calls `use_it` with the state, and returns what `use_it` returns.
    ///
    /// Nobody else can use the state during that call. Others wait, even the operator if its
    /// message handlers use the state. So copy what you need, and compute outside. After a panic
    /// the state stays as it was at that moment.
    ///
    /// Do not call it from within `use_it`: that call would never return.
    pub fn with<R>(&self, use_it: impl FnOnce(&mut T) -> R) -> R {
        use_it(&mut lock(&self.0))
    }
}

impl<T> Clone for SharedState<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: Default> Default for SharedState<T> {
    fn default() -> Self {
        Self::new(T::default())
    }
}

/// Does not print the state, because reading it might wait.
impl<T> fmt::Debug for SharedState<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SharedState(…)")
    }
}
