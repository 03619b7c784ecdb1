//! State that the parts of an operator share.

use std::fmt;
use std::sync::{Arc, Mutex};

use fuseline_engine::lock;

/// State that local, handlers and side requests have in common; clones share it.
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
    /// Shared state that begins as `state`.
    #[must_use]
    pub fn new(state: T) -> Self {
        Self(Arc::new(Mutex::new(state)))
    }

    /// Looks at the state or changes it, while nobody else does.
    ///
    /// Others wait meanwhile, among them the operator if its message handlers use the state: copy what is
    /// needed and compute outside. A panic leaves the state as it is at that moment.
    ///
    /// Do not call it from within `use_it`: it would wait for ever.
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

/// Does not show the state, since reading it might wait.
impl<T> fmt::Debug for SharedState<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SharedState(…)")
    }
}
