//! Turns caught panics into errors.

use std::any::Any;
use std::panic::AssertUnwindSafe;

use futures_util::FutureExt;

use crate::Error;

/// Turns a panic of `computation` into an error (D7).
pub(crate) async fn guarded<T>(
    computation: impl Future<Output = Result<T, Error>>,
) -> Result<T, Error> {
    let ended = AssertUnwindSafe(computation).catch_unwind().await;
    ended.unwrap_or_else(|panic| Err(panicked(&*panic)))
}

/// Returns the panic as an error.
pub(crate) fn panicked(panic: &(dyn Any + Send)) -> Error {
    format!("it panicked: {}", reason(panic)).into()
}

/// Returns the panic's message, if it is text.
pub(crate) fn reason(panic: &(dyn Any + Send)) -> &str {
    if let Some(text) = panic.downcast_ref::<&str>() {
        return text;
    }
    panic.downcast_ref::<String>().map_or("without a message", String::as_str)
}
