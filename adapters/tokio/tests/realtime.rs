//! Real-time scheduling and locked memory, or an error that says what would grant them.
#![cfg(target_os = "linux")]

use std::fs;
use std::hint::black_box;
use std::thread;

use fuseline_tokio::realtime::{RealtimeError, lock_memory, schedule};

/// The calling thread's real-time priority and policy; `SCHED_FIFO` is 1.
fn scheduling() -> (u8, u8) {
    let stat = fs::read_to_string("/proc/thread-self/stat").unwrap();
    // Its name, in brackets, may have spaces; fields 40 and 41 of proc_pid_stat(5), the state being the third.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    (fields[37].parse().unwrap(), fields[38].parse().unwrap())
}

#[test]
fn a_thread_has_the_priority_that_it_requested_or_reports_what_would_grant_it() {
    let reported = thread::spawn(|| (schedule(7), scheduling())).join().unwrap();
    match reported {
        (Ok(()), scheduled) => assert_eq!(scheduled, (7, 1)),
        (Err(error), scheduled) => {
            let error = error.to_string();
            assert!(error.contains("SCHED_FIFO 7: ") && error.contains("ulimit -r"), "{error}");
            assert_eq!(scheduled, (0, 0));
        }
    }
    assert_eq!(scheduling().1, 0, "no other thread");
}

#[test]
fn what_is_no_priority_is_refused() {
    for none in [0, 100, 255] {
        assert!(
            matches!(schedule(none), Err(RealtimeError::Priority(priority)) if priority == none)
        );
    }
    assert_eq!(scheduling(), (0, 0));
}

#[test]
fn memory_is_locked_or_the_limit_is_reported() {
    let locked = || {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap()
    };
    match lock_memory() {
        Ok(()) => {
            let before = locked();
            assert!(before > 0);
            let later = black_box(vec![1_u8; 64 << 20]);
            // Threads of other tests may end meanwhile, and with them their stacks.
            assert!(locked() > before + 48 * 1024, "what it gets later too");
            drop(later);
        }
        Err(RealtimeError::Limit(_)) => assert_eq!(locked(), 0),
        Err(error) => panic!("{error}"),
    }
}
