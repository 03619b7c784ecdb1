//! Sends messages back to back through an operator, or with the argument `by-hand` through
//! hand-written code, under a tool that counts instructions.
//!
//! `benches/worst-case` runs it. It prints the number of messages.

use std::env;

use fuseline_benches::adapter::{BACK_TO_BACK, runtime, with_adapter, with_select};

/// Runs the adapter, whose instructions are counted.
#[inline(never)]
fn messages_of_adapter() {
    runtime().block_on(with_adapter(BACK_TO_BACK));
}

/// Runs the hand-written code for comparison.
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
