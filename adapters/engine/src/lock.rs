//! The locks that a panic does not shut.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex whose value is sound at each moment, and so after a panic of another thread that held it.
pub fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
