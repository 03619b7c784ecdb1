//! What the images share: lines of the trace in and out, over semihosting, without an allocator.
#![no_std]

pub mod console;
pub mod line;
