//! Tests whether a configuration can keep up, and the advice if it cannot.

use std::time::Duration;

use fuseline_engine::{CapacityError, Workload};

fn workload(longest_s: f64, local_s: f64) -> Workload {
    Workload {
        rate: 30.0,
        longest_deadline: Duration::from_secs_f64(longest_s),
        local_response: Duration::from_secs_f64(local_s),
    }
}

#[test]
fn defaults_at_11_m_s_fall_short_with_remedies() {
    let error = workload(2.4253, 0.3).check(16, 4, [("west", 8), ("east", 80)]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a window of 16 for 30 messages a second that are open for up to 2.4253 s: give 75, or cap \
         deadlines at 0.462 s; 8 calls at once to west for 30 a second that take up to 2.4253 s: \
         give 73, or cap deadlines at 0.266 s; 4 local computations at once for 30 a second that \
         take 0.3 s: give 10, or send at most 13.3 messages a second"
    );
}

#[test]
fn each_remedy_is_enough_and_no_more() {
    assert!(workload(2.4253, 0.3).check(75, 10, [("west", 73)]).is_ok());
    assert!(workload(2.4253, 0.3).check(74, 10, [("west", 73)]).is_err());
    assert!(workload(2.4253, 0.3).check(75, 9, [("west", 73)]).is_err());
    assert!(workload(2.4253, 0.3).check(75, 10, [("west", 72)]).is_err());
    assert!(workload(0.4616, 0.1).check(16, 4, [("west", 14)]).is_ok());
    assert!(workload(0.4617, 0.1).check(16, 4, [("west", 14)]).is_err());
    assert!(workload(0.2656, 0.1).check(16, 4, [("west", 8)]).is_ok());
    assert!(workload(0.2667, 0.1).check(16, 4, [("west", 8)]).is_err());
    // A message also stays open for as long as local takes, however short the deadline is.
    assert!(workload(0.01, 0.6).check(16, 19, []).is_err());
}

#[test]
fn what_cannot_be_met_says_so() {
    let error = workload(60.0, 1.0).check(16, 31, []).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a window of 16 for 30 messages a second that are open for up to 60 s: give 1803 (but at \
         most 1024 are possible); no deadline is short enough, because local takes 1 s"
    );
    let endless = Workload { longest_deadline: Duration::MAX, ..workload(0.0, 0.3) };
    assert!(endless.check(1024, 1024, []).is_err());
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = Workload { rate, ..workload(0.1, 0.1) }.check(16, 4, []).unwrap_err();
        assert!(matches!(error.0[..], [CapacityError::Rate(_)]), "{error}");
    }
}
