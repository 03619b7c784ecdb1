//! One program of the tests that need no process of their own. The package of `tests` builds it: it is not optimized.

mod drawn;
mod expected;
mod guard;
mod link;
mod send_budget;
mod stream_loss;
mod vehicle;
