//! The checker's side is in C: `proofs/engine/checker.c` defines these imports.

use core::panic::{Location, PanicInfo};

use crate::Arbitrary;

#[link(wasm_import_module = "kani")]
unsafe extern "C" {
    safe fn any_bits(bits: u32) -> u64;
    #[link_name = "assume"]
    safe fn assume_that(condition: u32);
    #[link_name = "check"]
    safe fn check_that(
        condition: u32,
        file: *const u8,
        len: usize,
        line: u32,
        text: *const u8,
        text_len: usize,
    );
    #[link_name = "cover"]
    safe fn cover_that(condition: u32, line: u32);
    safe fn fail(file: *const u8, len: usize, line: u32) -> !;
}

#[inline(always)]
pub(crate) fn any(bits: u32) -> u64 {
    any_bits(bits)
}

#[inline(always)]
pub(crate) fn any_where<T: Arbitrary, F: Fn(&T) -> bool>(wanted: F) -> T {
    let value = T::any();
    assume(wanted(&value));
    value
}

#[inline(always)]
pub(crate) fn assume(condition: bool) {
    assume_that(u32::from(condition));
}

#[inline(always)]
pub(crate) fn check(condition: bool, message: &'static str, at: &'static Location<'static>) {
    let file = at.file();
    check_that(
        u32::from(condition),
        file.as_ptr(),
        file.len(),
        at.line(),
        message.as_ptr(),
        message.len(),
    );
}

#[inline(always)]
pub(crate) fn cover(condition: bool, line: u32, _message: &'static str) {
    cover_that(u32::from(condition), line);
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    let (file, line) = info.location().map_or(("", 0), |at| (at.file(), at.line()));
    fail(file.as_ptr(), file.len(), line)
}
