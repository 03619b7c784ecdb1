//! Real-time scheduling and locked memory: both are of Linux, and only where the system grants
//! them.
//!
//! A message that is due is answered once its thread runs. Under the usual scheduling that thread
//! shares its core with whatever else runs there; under `SCHED_FIFO` it runs at once, before every
//! thread without a real-time policy. A thread that waits for a page from a disk is late all the
//! same, so memory is locked.

use crate::error::NodeError;

/// Locks memory, and tries whether a thread gets this priority under `SCHED_FIFO`; does nothing for
/// 0.
#[cfg(target_os = "linux")]
pub(crate) fn prepare(priority: u8) -> Result<(), NodeError> {
    if priority == 0 {
        return Ok(());
    }
    let tried = std::thread::spawn(move || schedule(priority)).join();
    tried.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
    linux::lock_memory().map_err(NodeError::Realtime)
}

/// Puts the calling thread, and those that it starts from now on, under `SCHED_FIFO` with a
/// priority from 1 to 99; does nothing for 0.
#[cfg(target_os = "linux")]
pub(crate) fn schedule(priority: u8) -> Result<(), NodeError> {
    if priority == 0 { Ok(()) } else { linux::schedule(priority).map_err(NodeError::Realtime) }
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn prepare(priority: u8) -> Result<(), NodeError> {
    match priority {
        0 => Ok(()),
        _ => Err(NodeError::Realtime("this system has none".to_owned())),
    }
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn schedule(_: u8) -> Result<(), NodeError> {
    Ok(())
}

#[cfg(target_os = "linux")]
mod linux {
    use std::io;

    use rustix::mm::{MlockAllFlags, mlockall};
    use rustix::process::{Resource, getrlimit};
    use rustix::thread::{CapabilitySet, capabilities};
    use thread_priority::{
        Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue,
        ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };

    pub(super) fn schedule(priority: u8) -> Result<(), String> {
        let value = ThreadPriorityValue::try_from(priority)?;
        let value = ThreadPriority::Crossplatform(value);
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        set_thread_priority_and_policy(thread_native_id(), value, policy).map_err(|error| {
            let why = match error {
                Error::OS(number) => io::Error::from_raw_os_error(number).to_string(),
                other => format!("{other:?}"),
            };
            format!(
                "SCHED_FIFO {priority}: {why}; grant CAP_SYS_NICE, or raise `ulimit -r` to {priority}"
            )
        })
    }

    /// Keeps all memory of the process in RAM, also what it gets later. A system that grants only a
    /// limited number of bytes would end the process once it needs more.
    pub(super) fn lock_memory() -> Result<(), String> {
        let granted = capabilities(None).map(|granted| granted.effective);
        let may_exceed = granted.is_ok_and(|granted| granted.contains(CapabilitySet::IPC_LOCK));
        if let Some(limit) = getrlimit(Resource::Memlock).current.filter(|_| !may_exceed) {
            return Err(format!(
                "locking memory: the limit is {limit} bytes; grant CAP_IPC_LOCK, or `ulimit -l \
                 unlimited`"
            ));
        }
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
            .map_err(|error| format!("locking memory: {}", io::Error::from(error)))
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::{fs, thread};

    use super::*;

    /// Returns the calling thread's real-time priority and policy; `SCHED_FIFO` is 1.
    fn scheduling() -> (u8, u8) {
        let stat = fs::read_to_string("/proc/thread-self/stat").unwrap();
        // Its name, in brackets, may have spaces; fields 40 and 41 of proc_pid_stat(5), the state
        // being the third.
        let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        (fields[37].parse().unwrap(), fields[38].parse().unwrap())
    }

    #[test]
    fn thread_gets_its_priority_or_the_remedy() {
        let (scheduled, has) = thread::spawn(|| (schedule(7), scheduling())).join().unwrap();
        match scheduled {
            Ok(()) => assert_eq!(has, (7, 1)),
            Err(error) => {
                let error = error.to_string();
                assert!(error.contains("SCHED_FIFO 7: ") && error.contains("ulimit -r"), "{error}");
                assert_eq!(has, (0, 0));
            }
        }
        assert_eq!(scheduling().1, 0, "no other thread");
    }
}
