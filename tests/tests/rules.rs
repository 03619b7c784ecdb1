//! Tests each rule at its edges, through the core's façade with a manual clock.

use fuseline_core::{Admission, Cloud, Commit, DropReason, OfferRefusal, OpenRefusal, Outcome};
use fuseline_core::{Fusion, Instant, Opening, Priority};
use fuseline_tests::{CoreDriver, Fired};

const BOTH: [Commit; 2] = [Commit::Eager, Commit::Patient];
const END: u64 = u64::MAX;

/// Describes an outcome in a word or two.
fn reported(outcome: Outcome<15>) -> String {
    match outcome {
        Outcome::Dropped(DropReason::Unknown) => "unknown".into(),
        Outcome::Dropped(DropReason::Superseded) => "superseded".into(),
        Outcome::Dropped(DropReason::Unsolicited) => "unsolicited".into(),
        Outcome::Dropped(DropReason::Duplicate) => "duplicate".into(),
        Outcome::Dropped(DropReason::Late) => "late".into(),
        Outcome::Held => "held".into(),
        Outcome::Waiting => "waits".into(),
        Outcome::Missed => "missed".into(),
        Outcome::Final { by } => format!("{} is final", by.as_u16()),
        Outcome::Preliminary { by, cancelled } => {
            let cancelled: Vec<_> = cancelled.iter().map(Priority::as_u16).collect();
            format!("{} goes first, cancels {cancelled:?}", by.as_u16())
        }
        Outcome::Forwarded { by, cancelled } => {
            let cancelled: Vec<_> = cancelled.iter().map(Priority::as_u16).collect();
            format!("{} goes, cancels {cancelled:?}", by.as_u16())
        }
    }
}

/// Describes a firing as `timestamp: timers, outcome`.
fn reported_firing(firing: &Fired) -> String {
    let timers: Vec<_> = firing.timers.iter().map(Priority::as_u16).collect();
    format!("{}: {timers:?}, {}", firing.timestamp.as_u64(), reported(firing.outcome))
}

fn reported_firings(firings: &[Fired]) -> Vec<String> {
    firings.iter().map(reported_firing).collect()
}

/// Returns a driver with timestamp 0 open at 0 and offered, in order, with these deadlines.
fn driver_with(commit: Commit, clouds: &[(u16, u64)]) -> CoreDriver {
    let priorities: Vec<u16> = clouds.iter().map(|(p, _)| *p).collect();
    let mut driver = CoreDriver::new(4, commit, &priorities);
    driver.opened(0, None);
    for (p, deadline) in clouds {
        driver.requested(0, *p, *deadline);
    }
    driver
}

fn refused(admission: Admission) -> Option<OfferRefusal> {
    match admission {
        Admission::Refused(why) => Some(why),
        Admission::Admitted { .. } => None,
    }
}

// Time (F0)

#[test]
fn f0_result_just_before_due_is_in_time() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported_firings(&driver.tick(9)), [""; 0]);
        assert_eq!(reported(driver.result(0, 1)), "1 goes, cancels []");
    }
}

#[test]
fn f0_result_at_and_after_the_due_instant_is_late() {
    for (commit, now) in BOTH.into_iter().flat_map(|commit| [(commit, 10), (commit, 11)]) {
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported_firings(&driver.tick(now)), ["0: [1], waits"]);
        assert_eq!(reported(driver.result(0, 1)), "late");
    }
}

#[test]
fn f0_a_clock_that_goes_back_stands_still() {
    let mut driver = driver_with(Commit::Eager, &[(1, 10), (2, 30)]);
    driver.tick(20);
    driver.tick(5);
    assert_eq!(driver.fusion().now(), Instant::from_nanos(20));
    // Stamped before its due instant, but given after the clock passed it (A21).
    assert_eq!(reported(driver.result(0, 1)), "late");
    assert_eq!(driver.open(1, Some(3)), Opening::Accepted);
    assert_eq!(driver.next_due(), Some(23));
}

#[test]
fn f0_refused_and_dropped_inputs_move_the_clock() {
    let mut driver = driver_with(Commit::Eager, &[(1, 10)]);
    driver.tick(9);
    assert_eq!(driver.open(0, None), Opening::Refused(OpenRefusal::Order));
    assert_eq!(reported(driver.result(9, 1)), "unknown");
    assert_eq!(driver.fusion().now(), Instant::from_nanos(9));
}

// Open (F1)

#[test]
fn f1_reasons_to_refuse_an_open_come_in_order() {
    let mut driver = CoreDriver::new(1, Commit::Eager, &[]);
    assert_eq!(driver.open(5, Some(0)), Opening::Refused(OpenRefusal::Deadline));
    // A refused timestamp may come again (A25).
    assert_eq!(driver.open(5, None), Opening::Accepted);
    assert_eq!(driver.open(5, Some(0)), Opening::Refused(OpenRefusal::Order));
    assert_eq!(driver.open(4, None), Opening::Refused(OpenRefusal::Order));
    assert_eq!(driver.open(6, Some(0)), Opening::Refused(OpenRefusal::Full));
}

#[test]
fn f1_window_of_every_size_has_room_for_its_size() {
    for window in [1, 2, 1023, 1024] {
        let mut driver = CoreDriver::new(window, Commit::Eager, &[]);
        for t in 0..window as u64 {
            assert_eq!(driver.open(t, None), Opening::Accepted);
        }
        let next = window as u64;
        assert_eq!(driver.open(next, None), Opening::Refused(OpenRefusal::Full));
        assert_eq!(reported(driver.result(next, 0)), "unknown");
        assert_eq!(reported(driver.result(0, 0)), "0 goes, cancels []");
        assert_eq!(driver.open(next, None), Opening::Accepted);
    }
}

#[test]
fn f1_open_at_due_finds_the_freed_room() {
    for (now, opening) in [(9, Opening::Refused(OpenRefusal::Full)), (10, Opening::Accepted)] {
        let mut driver = CoreDriver::new(1, Commit::Eager, &[]);
        assert_eq!(driver.open(0, Some(10)), Opening::Accepted);
        driver.tick(now);
        assert_eq!(driver.open(1, None), opening);
    }
}

#[test]
fn f1_skipped_timestamps_are_superseded_and_closed() {
    let mut driver = CoreDriver::new(4, Commit::Eager, &[1]);
    assert_eq!(reported(driver.result(3, 0)), "unknown");
    assert_eq!(driver.open(7, None), Opening::Accepted);
    assert_eq!(reported(driver.result(3, 0)), "superseded");
    assert_eq!(refused(driver.offer(3, 1, 10)), Some(OfferRefusal::Closed));
}

#[test]
fn a14_the_greatest_timestamp_opens_once() {
    let mut driver = CoreDriver::new(4, Commit::Eager, &[]);
    assert_eq!(driver.open(END, None), Opening::Accepted);
    assert_eq!(reported(driver.result(END, 0)), "0 goes, cancels []");
    assert_eq!(driver.open(END, None), Opening::Refused(OpenRefusal::Order));
}

#[test]
fn a14_due_saturates_and_the_clocks_end_arms_nothing() {
    let mut driver = CoreDriver::new(4, Commit::Eager, &[1]);
    driver.tick(END - 1);
    assert_eq!(driver.open(0, Some(END)), Opening::Accepted);
    assert_eq!(driver.offer(0, 1, END), Admission::Admitted { due: Instant::END });
    assert_eq!(reported_firings(&driver.tick(END)), ["0: [0, 1], missed"]);
    assert_eq!(driver.open(1, Some(END)), Opening::Refused(OpenRefusal::Deadline));
    assert_eq!(driver.open(1, None), Opening::Accepted);
    assert_eq!(refused(driver.offer(1, 1, END)), Some(OfferRefusal::Deadline));
    assert_eq!(reported(driver.result(1, 0)), "0 goes, cancels []");
}

// Offer (F2)

#[test]
fn f2_reasons_to_refuse_an_offer_come_in_order() {
    let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 1));
    let mut driver = CoreDriver::with(4, Commit::Eager, &clouds);
    let offer = |driver: &mut CoreDriver, t, p, deadline| refused(driver.queue(t, p, deadline, 1));
    assert_eq!(offer(&mut driver, 0, 1, 10), Some(OfferRefusal::Unknown));
    driver.opened(0, None);
    driver.opened(1, None);
    assert_eq!(reported(driver.fail(1, 0)), "missed");
    assert_eq!(offer(&mut driver, 1, 4, 10), Some(OfferRefusal::Unknown));
    assert_eq!(offer(&mut driver, 1, 0, 10), Some(OfferRefusal::Unknown));
    assert_eq!(offer(&mut driver, 1, 1, 0), Some(OfferRefusal::Closed));
    driver.requested(0, 2, 10);
    driver.requested(0, 3, 10);
    assert_eq!(reported(driver.result(0, 2)), "held");
    assert_eq!(offer(&mut driver, 0, 2, 0), Some(OfferRefusal::Duplicate));
    assert_eq!(offer(&mut driver, 0, 1, 0), Some(OfferRefusal::Outranked));
    driver.opened(2, None);
    assert_eq!(offer(&mut driver, 2, 1, 0), Some(OfferRefusal::Deadline));
    assert_eq!(offer(&mut driver, 2, 1, 10), Some(OfferRefusal::Queue));
    // A refused offer may be made again (A26).
    assert_eq!(driver.offer(2, 1, 10), Admission::Admitted { due: Instant::from_nanos(10) });
}

#[test]
fn f2_request_may_join_while_a_lower_result_is_held() {
    for (commit, expected) in
        [(Commit::Eager, "0: [1], 0 goes, cancels [2]"), (Commit::Patient, "0: [1], waits")]
    {
        let mut driver = CoreDriver::new(4, commit, &[1, 2]);
        driver.opened(0, None);
        driver.requested(0, 1, 10);
        assert_eq!(reported(driver.result(0, 0)), "held");
        assert_eq!(refused(driver.offer(0, 2, 50)), None);
        assert_eq!(reported_firings(&driver.tick(10)), [expected]);
    }
}

#[test]
fn f2g_gate_shuts_at_limit_and_opens_at_resume() {
    let cloud = Cloud { priority: Priority::new(1), limit: 31, resume: 10 };
    let mut driver = CoreDriver::with(16, Commit::Eager, &[cloud]);
    let backlogs = [30, 31, 30, 11, 10, 30, u64::MAX, 0];
    let admitted: Vec<bool> = (0..)
        .zip(backlogs)
        .map(|(t, backlog)| {
            driver.opened(t, None);
            refused(driver.queue(t, 1, 10, backlog)).is_none()
        })
        .collect();
    assert_eq!(admitted, [true, false, false, false, true, true, false, true]);
}

#[test]
fn f2g_gate_is_asked_last() {
    let mut driver = CoreDriver::with(4, Commit::Eager, &[Cloud::new(Priority::new(1), 5)]);
    driver.opened(0, None);
    assert_eq!(refused(driver.queue(0, 1, 0, 5)), Some(OfferRefusal::Deadline));
    assert!(driver.fusion().gate(Priority::new(1)).is_some_and(|gate| !gate.is_shut()));
    assert_eq!(refused(driver.queue(0, 1, 10, 5)), Some(OfferRefusal::Queue));
    assert!(driver.fusion().gate(Priority::new(1)).is_some_and(|gate| gate.is_shut()));
}

// Result (F3)

#[test]
fn f3_reasons_to_drop_a_result_come_in_order() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10), (2, 50), (3, 50)]);
        assert_eq!(reported(driver.result(0, 9)), "unknown");
        assert_eq!(reported(driver.result(1, 1)), "unknown");
        driver.opened(1, None);
        assert_eq!(reported(driver.result(1, 1)), "unsolicited");
        assert_eq!(reported(driver.result(0, 2)), "held");
        assert_eq!(reported(driver.result(0, 2)), "duplicate");
        assert_eq!(reported(driver.fail(0, 1)), "waits");
        assert_eq!(reported(driver.result(0, 1)), "late");
        assert_eq!(reported(driver.result(0, 3)), "3 goes, cancels []");
        // It would also be late if the timestamp had not been retired (A16).
        assert_eq!(reported(driver.result(0, 1)), "superseded");
    }
}

#[test]
fn f3_highest_is_forwarded_and_cancels_the_lower() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10), (7, 10), (65_535, 10)]);
        assert_eq!(reported(driver.result(0, 7)), "held");
        assert_eq!(reported(driver.result(0, 65_535)), "65535 goes, cancels [1]");
    }
}

#[test]
fn f3_a_held_local_result_disarms_its_limit() {
    for commit in BOTH {
        let mut driver = CoreDriver::new(4, commit, &[1]);
        driver.opened(0, Some(5));
        driver.requested(0, 1, 10);
        assert_eq!(driver.next_due(), Some(5));
        assert_eq!(reported(driver.result(0, 0)), "held");
        assert_eq!(driver.next_due(), Some(10));
    }
}

#[test]
fn a3_a_held_cloud_keeps_its_timer_under_eager_alone() {
    for (commit, next_due, at_10) in
        [(Commit::Eager, 10, vec!["0: [1], 1 goes, cancels [2]"]), (Commit::Patient, 50, vec![])]
    {
        let mut driver = driver_with(commit, &[(1, 10), (2, 50)]);
        assert_eq!(reported(driver.result(0, 1)), "held");
        assert_eq!(driver.next_due(), Some(next_due));
        assert_eq!(reported_firings(&driver.tick(10)), at_10);
    }
}

// Fail (F4)

#[test]
fn f4_a_failure_frees_what_it_outranked() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10), (2, 20), (3, 30)]);
        assert_eq!(reported(driver.result(0, 1)), "held");
        // A failure alone does not commit (A36).
        assert_eq!(reported(driver.fail(0, 3)), "waits");
        assert_eq!(reported(driver.fail(0, 3)), "late");
        assert_eq!(reported(driver.fail(0, 1)), "duplicate");
        assert_eq!(reported(driver.fail(0, 2)), "1 goes, cancels []");
        assert_eq!(reported(driver.fail(0, 2)), "superseded");
    }
}

#[test]
fn f4_local_failing_last_misses_and_first_waits() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported(driver.fail(0, 0)), "waits");
        assert_eq!(reported(driver.fail(0, 1)), "missed");
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported(driver.fail(0, 1)), "waits");
        assert_eq!(reported(driver.fail(0, 0)), "missed");
        assert!(driver.fusion().is_empty());
    }
}

// Expire (F5)

#[test]
fn f5_fires_by_due_then_timestamp_with_ties_together() {
    for commit in BOTH {
        let mut driver = CoreDriver::new(4, commit, &[1, 2]);
        driver.opened(3, Some(20));
        driver.opened(7, Some(10));
        driver.requested(7, 2, 20);
        driver.requested(3, 1, 20);
        driver.opened(9, None);
        driver.requested(9, 1, 5);
        let fired = reported_firings(&driver.tick(20));
        let expected = ["9: [1], waits", "7: [0], waits", "3: [0, 1], missed", "7: [2], missed"];
        assert_eq!(fired, expected);
    }
}

#[test]
fn a22_ties_close_together_so_that_none_is_cancelled() {
    let mut driver = driver_with(Commit::Eager, &[(1, 10), (2, 10), (3, 11)]);
    assert_eq!(reported(driver.result(0, 0)), "held");
    assert_eq!(reported_firings(&driver.tick(10)), ["0: [1, 2], 0 goes, cancels [3]"]);
}

// Settle (F6)

#[test]
fn f6_the_limit_alone_commits_nothing() {
    for (commit, at_10, at_20) in [
        (Commit::Eager, vec!["0: [1], 1 goes, cancels [2]"], vec![]),
        (Commit::Patient, vec![], vec!["0: [2], 1 goes, cancels []"]),
    ] {
        let mut driver = CoreDriver::new(4, commit, &[1, 2]);
        driver.opened(0, Some(5));
        driver.requested(0, 1, 10);
        driver.requested(0, 2, 20);
        assert_eq!(reported(driver.result(0, 1)), "held");
        assert_eq!(reported_firings(&driver.tick(5)), ["0: [0], waits"]);
        assert_eq!(reported_firings(&driver.tick(10)), at_10);
        assert_eq!(reported_firings(&driver.tick(20)), at_20);
    }
}

#[test]
fn a4_lower_timer_commits_only_under_eager() {
    for (commit, at_10) in
        [(Commit::Eager, "0: [1], 0 goes, cancels [2]"), (Commit::Patient, "0: [1], waits")]
    {
        let mut driver = driver_with(commit, &[(1, 10), (2, 20)]);
        assert_eq!(reported(driver.result(0, 0)), "held");
        assert_eq!(reported_firings(&driver.tick(9)), [""; 0]);
        assert_eq!(reported_firings(&driver.tick(10)), [at_10]);
    }
}

#[test]
fn p3_of_several_available_the_best_goes() {
    for (commit, at_10, at_30) in [
        (Commit::Eager, "0: [1], 2 goes, cancels [3]", None),
        (Commit::Patient, "0: [1], waits", Some("0: [3], 2 goes, cancels []")),
    ] {
        let mut driver = driver_with(commit, &[(1, 10), (2, 20), (3, 30)]);
        assert_eq!(reported(driver.result(0, 0)), "held");
        assert_eq!(reported(driver.result(0, 2)), "held");
        assert_eq!(reported_firings(&driver.tick(10)), [at_10]);
        assert_eq!(reported_firings(&driver.tick(30)), Vec::from_iter(at_30));
    }
}

#[test]
fn a28_empty_firing_does_not_hurry_later_results() {
    let mut driver = driver_with(Commit::Eager, &[(1, 10), (2, 20)]);
    assert_eq!(reported_firings(&driver.tick(10)), ["0: [1], waits"]);
    assert_eq!(reported(driver.result(0, 0)), "held");
    assert_eq!(reported_firings(&driver.tick(20)), ["0: [2], 0 goes, cancels []"]);
}

#[test]
fn f6_patient_commits_although_lower_are_pending() {
    let mut driver = driver_with(Commit::Patient, &[(1, 30), (2, 30), (3, 20)]);
    assert_eq!(reported(driver.result(0, 2)), "held");
    assert_eq!(reported_firings(&driver.tick(20)), ["0: [3], 2 goes, cancels [1]"]);
}

// Forward and totality (F7, F8)

#[test]
fn f7_retired_has_no_timers_and_local_goes_on() {
    for commit in BOTH {
        let mut driver = CoreDriver::new(4, commit, &[1, 2]);
        driver.opened(0, Some(100));
        driver.requested(0, 1, 10);
        driver.requested(0, 2, 20);
        assert_eq!(reported(driver.result(0, 2)), "2 goes, cancels [1]");
        assert_eq!(driver.next_due(), None);
        assert_eq!(reported_firings(&driver.tick(END)), [""; 0]);
    }
}

#[test]
fn f8_what_no_operator_should_say_has_an_answer() {
    let mut driver = CoreDriver::new(1, Commit::Eager, &[]);
    assert_eq!(reported(driver.result(END, u16::MAX)), "unknown");
    assert_eq!(reported(driver.fail(0, 0)), "unknown");
    assert_eq!(refused(driver.queue(END, 0, 0, END)), Some(OfferRefusal::Unknown));
    assert_eq!(driver.open(END, Some(0)), Opening::Refused(OpenRefusal::Deadline));
}

// Promises that a scenario shows plainly

#[test]
fn p6_local_goes_at_once_without_requests() {
    for commit in BOTH {
        let mut driver = CoreDriver::new(4, commit, &[1, 2]);
        driver.opened(0, Some(10));
        driver.tick(9);
        assert_eq!(reported(driver.result(0, 0)), "0 goes, cancels []");
    }
}

#[test]
fn p5_local_goes_by_the_latest_due_if_clouds_are_lost() {
    for commit in BOTH {
        let mut driver = driver_with(commit, &[(1, 10), (2, 20), (3, 30)]);
        assert_eq!(reported(driver.result(0, 0)), "held");
        let last = driver.tick(30).last().map(reported_firing);
        assert!(last.is_some_and(|last| last.contains("0 goes")), "{commit:?}");
    }
}

/// The greatest of local's arrival and the due instants decides, whichever it is. The instant just
/// before it does not.
#[test]
fn p12_the_wait_ends_with_local_and_the_last_request() {
    for commit in BOTH {
        // Local comes first. Its result waits for the last due instant, but no longer for that of a
        // failed request.
        let mut driver = driver_with(commit, &[(1, 10), (2, 20), (3, 30)]);
        assert_eq!(reported(driver.result(0, 0)), "held");
        assert_eq!(reported(driver.fail(0, 3)), "waits");
        driver.tick(9);
        assert_eq!(driver.fusion().len(), 1, "{commit:?}");
        driver.tick(20);
        assert!(driver.fusion().is_empty(), "{commit:?}");
        // Local comes last. Its result, its failure or its timer ends the wait.
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported_firings(&driver.tick(10)), ["0: [1], waits"]);
        assert_eq!(reported(driver.result(0, 0)), "0 goes, cancels []");
        let mut driver = driver_with(commit, &[(1, 10)]);
        assert_eq!(reported_firings(&driver.tick(10)), ["0: [1], waits"]);
        assert_eq!(reported(driver.fail(0, 0)), "missed");
        let mut driver = CoreDriver::new(4, commit, &[1]);
        driver.opened(0, Some(30));
        driver.requested(0, 1, 10);
        assert_eq!(reported_firings(&driver.tick(29)), ["0: [1], waits"]);
        assert_eq!(reported_firings(&driver.tick(30)), ["0: [0], missed"]);
    }
}

#[test]
fn a10_refuses_impossible_configurations() {
    let cloud = |p, limit, resume| Cloud { priority: Priority::new(p), limit, resume };
    let accepted =
        |window, clouds: &[Cloud]| Fusion::<15, 1024>::new(window, Commit::Eager, clouds).is_ok();
    assert!(accepted(1, &[cloud(1, 1, 0), cloud(65_535, 1, 0)]));
    assert!(!accepted(0, &[]));
    assert!(!accepted(1025, &[]));
    assert!(!accepted(1, &[cloud(0, 1, 0)]));
    assert!(!accepted(1, &[cloud(3, 1, 0), cloud(3, 2, 0)]));
    assert!(!accepted(1, &[cloud(1, 0, 0)]));
    assert!(!accepted(1, &[cloud(1, 5, 5)]));
    let sixteen: Vec<_> = (1..=16).map(|p| cloud(p, 1, 0)).collect();
    assert!(accepted(1, &sixteen[..15]));
    assert!(!accepted(1, &sixteen));
}

// Progressive (F9)

#[test]
fn f9_better_results_go_at_once_and_the_last_is_final() {
    let mut driver = driver_with(Commit::Progressive, &[(1, 10), (2, 20), (3, 30)]);
    assert_eq!(reported(driver.result(0, 0)), "0 goes first, cancels []");
    assert_eq!(reported(driver.result(0, 2)), "2 goes first, cancels [1]");
    assert_eq!(reported(driver.result(0, 2)), "duplicate");
    assert_eq!(reported(driver.result(0, 1)), "superseded");
    assert_eq!(reported(driver.fail(0, 0)), "superseded");
    assert_eq!(reported_firings(&driver.tick(29)), [""; 0]);
    assert_eq!(reported_firings(&driver.tick(30)), ["0: [3], 2 is final"]);
    assert_eq!(reported(driver.result(0, 3)), "superseded");
}

#[test]
fn f9_nothing_better_pending_is_final_at_once() {
    let mut driver = driver_with(Commit::Progressive, &[(1, 10), (2, 20)]);
    assert_eq!(reported(driver.result(0, 2)), "2 goes, cancels [1]");
    let mut driver = driver_with(Commit::Progressive, &[(1, 10)]);
    assert_eq!(reported(driver.result(0, 0)), "0 goes first, cancels []");
    assert_eq!(reported(driver.fail(0, 1)), "0 is final");
}

#[test]
fn f9_only_offers_that_could_improve_may_join() {
    let mut driver = CoreDriver::new(4, Commit::Progressive, &[1, 2, 3]);
    driver.opened(0, None);
    driver.requested(0, 3, 30);
    driver.requested(0, 2, 30);
    assert_eq!(reported(driver.result(0, 2)), "2 goes first, cancels []");
    assert_eq!(refused(driver.offer(0, 1, 30)), Some(OfferRefusal::Outranked));
    assert_eq!(reported(driver.result(0, 3)), "3 goes, cancels []");
}

#[test]
fn f9_without_an_output_it_is_missed() {
    let mut driver = driver_with(Commit::Progressive, &[(1, 10)]);
    assert_eq!(reported(driver.fail(0, 0)), "waits");
    assert_eq!(reported_firings(&driver.tick(10)), ["0: [1], missed"]);
}
