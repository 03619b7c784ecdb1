//! A stand-in for Kani, for hosts without it: it has the functions and macros that the harnesses use, with
//! the same names.
//!
//! Compiled to wasm, values and properties are imports that the checker defines. Natively, values come from
//! random numbers or from the list of a counterexample, and a run is reported; see [`native`].
#![cfg_attr(target_arch = "wasm32", no_std)]

pub use fuseline_proof_macros::{proof, solver, unwind};

#[cfg(target_arch = "wasm32")]
#[path = "wasm.rs"]
mod engine;
#[cfg(not(target_arch = "wasm32"))]
pub mod native;
#[cfg(not(target_arch = "wasm32"))]
use native as engine;

/// A type of which any value can be drawn.
pub trait Arbitrary {
    /// Returns any value.
    fn any() -> Self;
}

macro_rules! arbitrary {
    ($($type:ty)*) => { $(
        impl Arbitrary for $type {
            #[inline]
            #[expect(clippy::cast_possible_truncation, reason = "the bits beyond the type mean nothing")]
            fn any() -> Self {
                engine::any(Self::BITS) as Self
            }
        }
    )* };
}

arbitrary!(u8 u16 u32);

impl Arbitrary for u64 {
    #[inline]
    fn any() -> Self {
        engine::any(Self::BITS)
    }
}

impl Arbitrary for bool {
    #[inline]
    fn any() -> Self {
        engine::any(1) & 1 != 0
    }
}

impl<T: Arbitrary, const N: usize> Arbitrary for [T; N] {
    #[inline]
    fn any() -> Self {
        core::array::from_fn(|_| T::any())
    }
}

/// Returns any value.
#[inline]
#[must_use]
pub fn any<T: Arbitrary>() -> T {
    T::any()
}

/// Returns any value for which `wanted` holds.
#[inline]
pub fn any_where<T: Arbitrary, F: Fn(&T) -> bool>(wanted: F) -> T {
    engine::any_where(wanted)
}

/// Excludes the values that do not satisfy `condition`.
#[inline]
pub fn assume(condition: bool) {
    engine::assume(condition);
}

/// Asserts that `condition` holds for all values.
#[inline(always)]
#[track_caller]
pub fn assert(condition: bool, message: &'static str) {
    engine::check(condition, message, core::panic::Location::caller());
}

#[doc(hidden)]
#[inline]
pub fn cover(condition: bool, line: u32, message: &'static str) {
    engine::cover(condition, line, message);
}

/// Requires that some values reach this line with `condition`.
#[macro_export]
macro_rules! cover {
    ($condition:expr, $message:literal) => {
        $crate::cover($condition, line!(), $message)
    };
}
