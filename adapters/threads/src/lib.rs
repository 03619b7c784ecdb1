//! Values for the [machine for many threads](fuseline_core::shared): each result brings one, and whoever is told to
//! forward gets the winner's.
//!
//! ```
//! use fuseline_core::shared::Shared;
//! use fuseline_core::{Cloud, Commit, Deadline, Instant, Priority, Timestamp};
//! use fuseline_threads::Intake;
//! use std::thread;
//!
//! let cloud = Priority::new(1);
//! let mut shared = Shared::<3, 16>::new(16, Commit::Eager, &[Cloud::new(cloud, 31)])?;
//! let mut intake = Intake::new(&mut shared);
//! let now = Instant::START;
//! let (message, local) = intake.open(now, Timestamp::new(0), None).expect("there is room");
//! let (_, call) = intake.offer(now, &message, cloud, Deadline::from_millis(400), 0);
//! let (call, _due) = call.expect("the queue is empty");
//!
//! // Whoever comes second, or the timer, forwards.
//! let forwarded = thread::scope(|scope| {
//!     let on_board = scope.spawn(move || local.result(now, "a guess").forwarded);
//!     let remote = scope.spawn(move || call.result(now, "the truth").forwarded);
//!     on_board.join().unwrap().or(remote.join().unwrap())
//! });
//! assert_eq!(forwarded, Some("the truth"));
//! # Ok::<(), fuseline_core::ConfigError>(())
//! ```
//!
//! # How values travel
//!
//! Each asked source has a cell of its own. Its one [`Call`] fills the cell before it asks the machine. If the machine
//! drops the result, the same thread takes its value back and drops it when it likes. If the machine holds it, it stays
//! there for the one thread that is told to forward. So no two threads ever want a cell at once: its lock is never
//! waited for, and that is checked.
//!
//! A value that was held and then discarded (F7) stays in its cell until its message's [`Message`]s and [`Call`]s are
//! gone and its place is used again, and is dropped by the owner then. If some of them are still there at that time, the
//! owner allocates new cells, and the last of them drops the old ones. Nothing else allocates.
//!
//! # When the plain machine does better
//!
//! - **Two threads and the most messages a second**: a [`Fusion`](fuseline_core::Fusion) in a `std` `Mutex` carries
//!   more, 35 against 25 million results a second in the project's table, since whoever has the lock keeps it for many calls.
//!   What this machine buys instead is the tail, 0.13 ms against 4.8 ms at worst, and that nobody waits for a thread that
//!   does not run. With one thread, or more than cores, the mutex carries less.
//! - **One thread or task that drives everything anyway.** The tokio adapter stays with
//!   [`Fusion`](fuseline_core::Fusion) for that: each value has to reach its task through a queue in any case, nothing
//!   contends for the machine behind it, and its strict trace needs what only one caller can give, one clock and one
//!   order over all timestamps (F0, F5). It would gain neither in simplicity nor in speed.
//! - **A target without 64-bit compare-and-swap**: there is no such machine there.
//!
//! # What is not provided
//!
//! Threads, timers and a clock: see `examples/executor.rs` for a way. What the machine does not guarantee is not
//! guaranteed here either.

mod call;
mod cells;
mod intake;

pub use call::{Answered, Call, Message};
pub use intake::Intake;
