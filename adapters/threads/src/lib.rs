#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(any(test, feature = "values"))]
extern crate std;

#[cfg(not(target_has_atomic = "64"))]
compile_error!(
    "fuseline-threads needs 64-bit compare-and-swap: keep a Fusion in a critical section instead"
);

#[cfg(feature = "values")]
mod call;
#[cfg(feature = "values")]
mod cells;
mod handle;
mod owner;
mod shared;
mod message_id;
#[cfg(feature = "values")]
mod values;
mod packed;

#[cfg(feature = "values")]
pub use call::{CallOutcome, Call, Message};
pub use handle::SharedHandle;
pub use owner::Owner;
pub use shared::Shared;
pub use message_id::MessageId;
#[cfg(feature = "values")]
pub use values::ValueOwner;
