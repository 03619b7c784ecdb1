//! The machine for many threads: no lock, no allocation, a bounded number of steps.
//!
//! One owner opens and offers; results, failures and timers come from any thread, each with the [`Ticket`] of its
//! message. All of them take the same pure step as [`Fusion`](crate::Fusion). The project's `SPEC.md` says in its section
//! on many threads what holds.
//!
//! ```
//! # #[cfg(target_has_atomic = "64")] {
//! use fuseline_core::shared::Shared;
//! use fuseline_core::*;
//!
//! let cloud = Priority::new(1);
//! let mut shared = Shared::<3, 16>::new(16, Commit::Eager, &[Cloud::new(cloud, 31)]).unwrap();
//! let (mut intake, desk) = shared.split();
//! let now = Instant::START;
//! let ticket = intake.open(now, Timestamp::new(0), None).unwrap();
//! let (_, admission) = intake.offer(now, ticket, cloud, Deadline::from_millis(400), 0);
//! let Admission::Admitted { due } = admission else { unreachable!() };
//!
//! // Any thread may give what came, at the instant that its own clock reads.
//! let (fired, outcome) = desk.result(now, ticket, Priority::LOCAL);
//! assert_eq!((fired, outcome), (None, Outcome::Held));
//! // Exactly one call is told to forward.
//! let fired = desk.expire(due, ticket).unwrap();
//! assert!(matches!(fired.outcome, Outcome::Forwarded { by: Priority::LOCAL, .. }));
//! # }
//! ```
//!
//! # What is guaranteed
//!
//! - Each call takes effect at one instant between its begin and its end, and answers what the pure step answers there:
//!   first the timers of its timestamp that are due by the caller's own `now` (F5), then its input (F1–F4). All calls
//!   have one such order that explains all their answers.
//! - In that order P1–P4, P8 and P11 hold. P2 is meant by the clock of the caller who gives the result: it is forwarded
//!   only if the `now` given along with it lies before its due instant.
//! - A call does not wait for another one, and looks at its timestamp's state at most `2 · CLOUDS + 1` times. It looks
//!   again only when that state changed meanwhile, and it changes no more often: each cloud is asked once, each source
//!   stops being pending once, and the last of these changes retires the timestamp. [`Intake::open`] looks at each place
//!   at most once.
//! - What a thread did before a call that changed a timestamp happens before the return of each later call that changes
//!   it, and of a later open that uses its place again. So values may be kept beside the machine: store one before
//!   the call, take it out after being told to forward. `fuseline-threads` does so.
//!
//! # What is not
//!
//! - **F0 and F5 over several timestamps.** A call fires no other timestamp's timers, and its `now` binds no other
//!   call: callers whose clocks differ are ordered by their calls, not by their instants. An open fires none, so that
//!   room which only a timer would make is none (A31). Tick each timestamp, at its [`Desk::next_due`] or by a timer for
//!   each admitted request.
//! - **P9 and P10.** There is no next due instant over all, and an open looks for a free place, from the one after the
//!   last. Who comes first is up to the threads.
//! - P5–P7 hold as far as somebody ticks the timestamp when they say so.
//! - **An endless memory for old tickets.** A place counts how often it was opened and retired, in the 62 − 2 · `CLOUDS`
//!   bits that the sources leave of its word: 2³¹ messages of one place with 15 clouds, 2⁵⁵ with 3. A ticket is taken
//!   for another one's if it is used after exactly a multiple of that many.
//!
//! # Where it is
//!
//! Up to 15 clouds, on targets with 64-bit compare-and-swap (`target_has_atomic = "64"`). Elsewhere, as on a Cortex-M,
//! keep a [`Fusion`](crate::Fusion) in a critical section: its worst input is short and bounded (P9).

#[cfg(target_has_atomic = "64")]
mod desk;
#[cfg(target_has_atomic = "64")]
mod intake;
#[cfg(target_has_atomic = "64")]
mod machine;
#[cfg(target_has_atomic = "64")]
mod word;

#[cfg(target_has_atomic = "64")]
pub use {desk::Desk, intake::Intake, machine::Shared, machine::Ticket};
