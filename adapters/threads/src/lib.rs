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
mod message_id;
mod owner;
mod packed;
mod shared;
#[cfg(feature = "values")]
mod values;

#[cfg(feature = "values")]
pub use call::{Call, CallOutcome, Message};
pub use handle::SharedHandle;
pub use message_id::MessageId;
pub use owner::Owner;
pub use shared::Shared;
#[cfg(feature = "values")]
pub use values::ValueOwner;
