//! Words for a panic that was caught.

use std::any::Any;

/// What the panic said, if it said it in words.
pub(crate) fn reason(panic: &(dyn Any + Send)) -> &str {
    if let Some(words) = panic.downcast_ref::<&str>() {
        return words;
    }
    panic.downcast_ref::<String>().map_or("a panic without words", String::as_str)
}
