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
mod desk;
mod owner;
mod shared;
mod ticket;
#[cfg(feature = "values")]
mod values;
mod word;

#[cfg(feature = "values")]
pub use call::{Answered, Call, Message};
pub use desk::Desk;
pub use owner::Owner;
pub use shared::Shared;
pub use ticket::Ticket;
#[cfg(feature = "values")]
pub use values::Intake;
