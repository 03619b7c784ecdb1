//! Real-time scheduling, and memory that stays: both of Linux, and only where the system grants them.
//!
//! What is due is served once its thread runs. Under the usual scheduling that thread shares its core with whatever else runs
//! there; under `SCHED_FIFO` it runs at once, before every thread without a real-time policy. A thread that waits for a page
//! from a disk is late all the same, so memory can be locked.
//!
//! ```no_run
//! use fuseline_tokio::realtime;
//! use tokio::runtime::Builder;
//!
//! realtime::lock_memory()?;
//! let runtime = Builder::new_multi_thread()
//!     .worker_threads(2)
//!     .on_thread_start(|| realtime::schedule(50).expect("granted when it was tried"))
//!     .enable_all()
//!     .build()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A thread that is started by one under `SCHED_FIFO` is under it too. Such a thread must not spin: it would keep a core for
//! itself, but for the twentieth of each second that Linux leaves to others by default.

use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use thiserror::Error;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// The greatest priority under `SCHED_FIFO`; the least is 1.
pub const MOST_URGENT: u8 = 99;

/// Why the system does not grant it.
#[derive(Debug, Error)]
pub enum RealtimeError {
    /// No such priority.
    #[error("priority {0}: SCHED_FIFO has 1 to {MOST_URGENT}")]
    Priority(u8),
    /// The thread may not have that priority.
    #[error(
        "SCHED_FIFO {priority}: {source}; grant CAP_SYS_NICE, or raise `ulimit -r` to {priority}"
    )]
    Schedule {
        /// What was requested.
        priority: u8,
        /// Why not.
        source: io::Error,
    },
    /// Only so many bytes may be locked: once the process needs more, it could not have them.
    #[error("locking memory: the limit is {0} bytes; grant CAP_IPC_LOCK, or `ulimit -l unlimited`")]
    Limit(u64),
    /// Memory cannot be locked.
    #[error("locking memory: {0}")]
    Memory(io::Error),
}

/// Puts the calling thread, and those that it starts from now on, under `SCHED_FIFO` with a priority from 1 to
/// [`MOST_URGENT`]; the greater runs first.
///
/// # Errors
/// If there is no such priority, or the system does not grant it.
pub fn schedule(priority: u8) -> Result<(), RealtimeError> {
    let value = ThreadPriorityValue::try_from(priority)
        .ok()
        .filter(|_| (1..=MOST_URGENT).contains(&priority))
        .ok_or(RealtimeError::Priority(priority))?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy)
        .map_err(|error| {
            let source = match error {
                thread_priority::Error::OS(number) => io::Error::from_raw_os_error(number),
                other => io::Error::other(format!("{other:?}")),
            };
            RealtimeError::Schedule { priority, source }
        })
}

/// Keeps all memory of the process in RAM, what it gets later too.
///
/// # Errors
/// If the system does not grant it, or grants so many bytes and no more: the process would end where it needs more.
pub fn lock_memory() -> Result<(), RealtimeError> {
    let may_exceed =
        capabilities(None).is_ok_and(|granted| granted.effective.contains(CapabilitySet::IPC_LOCK));
    if let Some(limit) = getrlimit(Resource::Memlock).current.filter(|_| !may_exceed) {
        return Err(RealtimeError::Limit(limit));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|error| RealtimeError::Memory(error.into()))
}
