//! Messages back to back through an operator, or by hand with the argument `by-hand`, for a tool that counts instructions from
//! outside.
//!
//! `benches/worst-case` runs it. Prints how many messages there are.

use std::env;

use fuseline_benches::adapter::{BACK_TO_BACK, runtime, with_adapter, with_select};

/// The subject of a count.
#[inline(never)]
fn messages_of_adapter() {
    runtime().block_on(with_adapter(BACK_TO_BACK));
}

/// The comparison.
#[inline(never)]
fn messages_by_hand() {
    runtime().block_on(with_select(BACK_TO_BACK));
}

fn main() {
    if env::args().nth(1).is_some_and(|side| side == "by-hand") {
        messages_by_hand();
    } else {
        messages_of_adapter();
    }
    println!("{}", BACK_TO_BACK.messages);
}
