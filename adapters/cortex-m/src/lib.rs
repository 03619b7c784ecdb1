//! Reads and writes lines of the trace over semihosting, without an allocator, for all images.
#![no_std]

pub mod console;
pub mod line;
