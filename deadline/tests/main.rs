//! Collects the tests that need no process of their own into one program. The package `tests`
//! builds it, unoptimized.

mod drawn;
mod expected;
mod guard;
mod link;
mod send_budget;
mod stream_loss;
mod vehicle;
