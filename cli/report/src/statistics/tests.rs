use std::time::Duration;

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Cloud, Commit, Header};

use super::*;

const MS: u64 = 1_000_000;
const CLOUDS: [u16; 3] = [7, 3, 5];

/// Applies inputs to the core and collects the statistics of its decisions.
fn statistics(inputs: &[Input]) -> TraceStatistics {
    let cloud = |p| Cloud { p, name: None, limit: 2, resume: 1 };
    let clouds = CLOUDS.map(cloud).to_vec();
    let header = Header { operator: None, window: 2, commit: Commit::Eager, clouds };
    let (mut arbiter, mut statistics) = (
        Arbiter::<15, 1024>::new(&header).unwrap(),
        TraceStatistics::new(CLOUDS, header.commit, false),
    );
    for input in inputs {
        statistics.input(input);
        arbiter.decide(input, |decision| statistics.decision(&decision));
    }
    statistics
}

/// Returns the counts of a source's requests that are not 0.
fn fates(statistics: &TraceStatistics, p: u64) -> Vec<(&'static str, u64)> {
    let totals = statistics.totals();
    let row = totals.rows.iter().find(|row| row.p == p).unwrap();
    let named = COLUMNS.iter().map(|(word, _)| *word).zip(row.counts);
    named.skip(1).filter(|(_, count)| *count > 0).collect()
}

fn open(at: u64, t: u64) -> Input {
    Input::Open { at: at * MS, t, deadline: None }
}

fn offer(at: u64, t: u64, p: u64) -> Input {
    Input::Offer { at: at * MS, t, p, deadline: 500 * MS, backlog: 0 }
}

fn result(at: u64, t: u64, p: u64) -> Input {
    Input::Result { at: at * MS, t, p }
}

fn fail(at: u64, t: u64, p: u64) -> Input {
    Input::Fail { at: at * MS, t, p }
}

const fn at(ms: u64) -> ArrivalTime {
    ArrivalTime::At(Duration::from_millis(ms))
}

/// The arrival of a source that got no request.
const UNASKED: ArrivalTime = ArrivalTime::Failed(Duration::ZERO);

const fn after(ms: u64) -> ArrivalTime {
    ArrivalTime::After(Duration::from_millis(ms))
}

#[test]
fn the_best_clouds_result_supersedes_the_other_request_and_local() {
    let page_trace =
        statistics(&[open(10, 0), offer(10, 0, 7), offer(10, 0, 3), result(180, 0, 7)]);
    assert_eq!(fates(&page_trace, 7), [("forwarded", 1)]);
    assert_eq!(fates(&page_trace, 3), [("superseded", 1)]);
    assert_eq!(fates(&page_trace, 0), [("superseded", 1)]);
    assert_eq!(fates(&page_trace, 5), []);
    let messages = page_trace.messages(|_, _, _| None);
    assert_eq!(messages[0].arrivals, [after(170), at(170), after(170), UNASKED]);
    assert_eq!(messages[0].forwarded.unwrap().response, Duration::from_millis(170));
}

#[test]
fn a_held_result_goes_or_is_discarded_and_the_one_timed_out_is_late() {
    let page_trace = statistics(&[
        open(0, 0),
        offer(0, 0, 7),
        offer(0, 0, 3),
        result(100, 0, 3),
        result(300, 0, 0),
        Input::Tick { at: 500 * MS },
        result(900, 0, 7),
    ]);
    assert_eq!(fates(&page_trace, 7), [("late", 1)]);
    assert_eq!(fates(&page_trace, 3), [("forwarded", 1)]);
    assert_eq!(fates(&page_trace, 0), [("discarded", 1)]);
    // A result that came after the end of its message is still an arrival.
    assert_eq!(
        page_trace.messages(|_, _, _| None)[0].arrivals,
        [at(300), at(900), at(100), UNASKED]
    );
}

#[test]
fn a_failure_after_its_timer_in_the_same_input_is_late_and_no_failure() {
    // At 500 the timers fire and local's result is forwarded. Only then does the machine look at
    // the failure, and drop it.
    let page_trace = statistics(&[open(0, 0), offer(0, 0, 7), result(9, 0, 0), fail(500, 0, 7)]);
    assert_eq!(fates(&page_trace, 7), [("late", 1)]);
    assert_eq!(fates(&page_trace, 0), [("forwarded", 1)]);
}

#[test]
fn an_accepted_failure_counts() {
    let page_trace = statistics(&[open(0, 0), offer(0, 0, 7), fail(20, 0, 7), result(30, 0, 0)]);
    assert_eq!(fates(&page_trace, 7), [("failed", 1)]);
    let failed = ArrivalTime::Failed(Duration::from_millis(20));
    assert_eq!(page_trace.messages(|_, _, _| None)[0].arrivals[1], failed);
}

#[test]
fn refused_offers_and_refused_messages_count_apart() {
    let page_trace =
        statistics(&[open(0, 0), open(1, 1), open(2, 2), offer(2, 2, 7), offer(3, 1, 7)]);
    let Totals { messages, refused, open, .. } = page_trace.totals();
    assert_eq!((messages, refused, open), (3, 1, 2));
    assert_eq!(fates(&page_trace, 7), [("open", 1), ("refused", 1)]);
    // Only messages that ended count, and a refused message went to no source.
    let messages = page_trace.messages(|_, _, _| Some(at(1)));
    assert_eq!(messages.len(), 1);
    assert_eq!(messages[0].arrivals, [UNASKED; 4]);
}

#[test]
fn an_open_that_is_refused_changes_nothing_about_the_one_before() {
    let page_trace = statistics(&[open(0, 0), open(5, 0), result(10, 0, 0)]);
    assert_eq!(page_trace.outcome(0), TimestampOutcome::Forwarded { p: 0 });
    let Totals { messages, forwarded, refused, response, .. } = page_trace.totals();
    assert_eq!((messages, forwarded, refused), (2, 1, 1));
    assert_eq!(response[0], Some(Quantile::Exactly(Duration::from_millis(10))));
}

#[test]
fn a_held_result_stays_in_time_when_its_timer_commits_a_better_one() {
    let page_trace = statistics(&[
        open(0, 0),
        offer(0, 0, 3),
        offer(5, 0, 5),
        offer(9, 0, 7),
        result(100, 0, 3),
        result(200, 0, 5),
        Input::Tick { at: 500 * MS },
    ]);
    assert_eq!(fates(&page_trace, 7), [("superseded", 1)]);
    assert_eq!(fates(&page_trace, 3), [("discarded", 1)]);
    assert_eq!(fates(&page_trace, 5), [("forwarded", 1)]);
}

#[test]
fn a_second_offer_is_refused_and_no_request() {
    let page_trace = statistics(&[open(0, 0), offer(0, 0, 7), offer(1, 0, 7), result(2, 0, 7)]);
    assert_eq!(fates(&page_trace, 7), [("forwarded", 1), ("refused", 1)]);
}

#[test]
fn a_message_nobody_answers_is_missed() {
    let page_trace = statistics(&[open(0, 0), fail(5, 0, 0)]);
    assert_eq!((page_trace.totals().missed, page_trace.outcome(0)), (1, TimestampOutcome::Missed));
    assert_eq!(page_trace.totals().response, [Some(Quantile::Never); 3]);
    assert_eq!(page_trace.messages(|_, _, _| None)[0].forwarded, None);
}

#[test]
fn a_plan_stands_in_for_a_call_that_was_ended() {
    let page_trace =
        statistics(&[open(10, 0), offer(10, 0, 3), offer(10, 0, 7), result(180, 0, 7)]);
    let planned = |source, opened, t| {
        assert_eq!((opened, t), (10 * MS, 0));
        (source == 2).then(|| at(220))
    };
    let expected = [after(170), at(170), at(220), UNASKED];
    assert_eq!(page_trace.messages(planned)[0].arrivals, expected);
}

#[test]
fn an_observed_trace_without_decisions_reports_each_fate_by_its_facts() {
    let mut page_trace = TraceStatistics::new([1, 2, 3], Commit::Eager, true);
    let request = |p, due| Decision::Request { at: 0, t: 0, p, due };
    page_trace.input(&Input::Open { at: 0, t: 0, deadline: None });
    for (p, due) in [(1, 10), (2, 50), (3, 50)] {
        page_trace.decision(&request(p, due));
    }
    for (at, p) in [(4, 2), (12, 1), (20, 0)] {
        page_trace.input(&Input::Result { at, t: 0, p });
    }
    page_trace.decision(&Decision::Emit { at: 20, t: 0, p: 0 });
    assert_eq!(fates(&page_trace, 0), [("forwarded", 1)]);
    assert_eq!(fates(&page_trace, 1), [("late", 1)]);
    assert_eq!(fates(&page_trace, 2), [("discarded", 1)]);
    assert_eq!(fates(&page_trace, 3), [("superseded", 1)]);
}
