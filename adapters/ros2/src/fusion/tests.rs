//! The loop without DDS, on a clock that stands still until everybody sleeps.

mod node;
mod policy;

use std::future::pending;
use std::sync::atomic::Ordering;

use bytes::Bytes;
use fuseline_tokio::{Commit, Error};
use node::{Node, payload};
use tokio::time::{Instant, sleep, sleep_until};

use super::*;
use crate::in_process::ReceivedTopic;
use crate::settings::Change;

const MS: Duration = Duration::from_millis(1);

/// An action of a source on a message, in milliseconds from the request.
#[derive(Clone, Copy)]
enum SourceAction {
    Answers(u64),
    Fails(u64),
    Panics(u64),
    /// No result comes.
    Loses,
}
use SourceAction::{Answers, Fails, Loses, Panics};

/// The action of a source on each message.
type Plan = fn(u64) -> SourceAction;

/// A script of events. The timestamp of a message is its index.
struct Script {
    local: Plan,
    /// Clouds of priority 1, 2, …, each with its deadline in milliseconds and its plan.
    clouds: Vec<(u64, Plan)>,
    /// The instants at which messages come, in milliseconds.
    messages: Vec<u64>,
}

/// Returns a value that names its source, its message, and when it was requested.
fn value(source: &str, t: u64, requested: Duration) -> String {
    format!("{source}'s of {t}, asked at {} ms", requested.as_millis())
}

async fn compute(
    act: SourceAction,
    source: String,
    t: u64,
    start: Instant,
) -> Result<String, Error> {
    let value = value(&source, t, start.elapsed());
    match act {
        Answers(ms) => sleep(Duration::from_millis(ms)).await,
        Fails(ms) => {
            sleep(Duration::from_millis(ms)).await;
            return Err("on purpose".into());
        }
        Panics(ms) => {
            sleep(Duration::from_millis(ms)).await;
            panic!("on purpose")
        }
        Loses => pending().await,
    }
    Ok(value)
}

fn line(at: u128, t: u64, text: &str) -> String {
    format!("{at} ms: {t} {text}")
}

/// Plays a script and compares the statuses and outputs with what is expected.
async fn play(commit: Commit, script: Script, expected: &[&str]) {
    let commit = format!("commit:={commit}");
    let node = Node::start_with(script.local, &script.clouds, &[&commit]);
    node.feed(0, script.messages.iter().copied()).await;
    let last = script.messages.iter().max().unwrap();
    node.until(last + 3000).await;
    assert_eq!(node.lines(), expected);
}

#[tokio::test(start_paused = true)]
async fn the_best_result_in_time_goes_with_the_value_of_its_source_and_message() {
    let clouds: Vec<(u64, Plan)> = vec![
        (500, |t| if t == 1 { Loses } else { Answers(60) }),
        (500, |t| if t == 2 { Answers(40) } else { Loses }),
    ];
    let script = Script { local: |_| Answers(20), clouds, messages: vec![0, 10, 20] };
    let expected = [
        "60 ms: 2 cloud2's of 2, asked at 20 ms by F3",
        "500 ms: 0 cloud1's of 0, asked at 0 ms by F5",
        "510 ms: 1 local's of 1, asked at 10 ms by F5",
    ];
    play(Commit::Eager, script, &expected).await;
}

#[tokio::test(start_paused = true)]
async fn a_nearer_due_instant_is_served_in_its_time() {
    let clouds: Vec<(u64, Plan)> =
        vec![(500, |_| Loses), (100, |t| if t == 0 { Fails(1) } else { Loses })];
    let script = Script { local: |_| Answers(20), clouds, messages: vec![0, 10] };
    let expected = [
        "110 ms: 1 local's of 1, asked at 10 ms by F5",
        "500 ms: 0 local's of 0, asked at 0 ms by F5",
    ];
    play(Commit::Eager, script, &expected).await;
}

#[tokio::test(start_paused = true)]
async fn a_panic_and_a_failure_of_a_call_let_what_is_available_go_at_once() {
    let clouds: Vec<(u64, Plan)> = vec![(500, |t| if t == 0 { Panics(50) } else { Fails(30) })];
    let script = Script { local: |_| Answers(20), clouds, messages: vec![0, 100] };
    let expected = [
        "50 ms: 0 local's of 0, asked at 0 ms by F4",
        "130 ms: 1 local's of 1, asked at 100 ms by F4",
    ];
    play(Commit::Eager, script, &expected).await;
}

#[tokio::test(start_paused = true)]
async fn local_that_says_nothing_is_missed_at_its_limit() {
    let script = Script { local: |_| Loses, clouds: Vec::new(), messages: vec![0, 5] };
    play(Commit::Eager, script, &["1000 ms: 0 missed", "1005 ms: 1 missed"]).await;
}

/// Better results go to a topic of their own, and each message has one output on the output's topic
/// (D1, F9).
#[tokio::test(start_paused = true)]
async fn under_progressive_revisions_go_at_once_and_the_last_one_is_the_output() {
    let clouds: Vec<(u64, Plan)> = vec![
        (500, |t| if t == 1 { Panics(50) } else { Answers(60) }),
        (500, |t| if t == 2 { Answers(40) } else { Loses }),
    ];
    let script = Script { local: |_| Answers(20), clouds, messages: vec![0, 10, 100] };
    let expected = [
        "20 ms: 0 local's of 0, asked at 0 ms as revision 0",
        "30 ms: 1 local's of 1, asked at 10 ms as revision 0",
        "60 ms: 0 cloud1's of 0, asked at 0 ms as revision 1",
        "120 ms: 2 local's of 2, asked at 100 ms as revision 0",
        "140 ms: 2 cloud2's of 2, asked at 100 ms by F3",
        "500 ms: 0 cloud1's of 0, asked at 0 ms by F9",
        "510 ms: 1 local's of 1, asked at 10 ms by F9",
    ];
    play(Commit::Progressive, script, &expected).await;
}

#[tokio::test(start_paused = true)]
async fn local_is_given_messages_again_after_all_of_its_own_got_lost() {
    // Local is killed at 1 s and is back at 2 s. Everything that it was sent in between is lost. By
    // default, it computes four messages at once. The cloud answers all the same, so no timer of
    // the rules reveals the loss.
    let node = Node::start(|_| Answers(10), &[(500, |_| Answers(15))]);
    node.feed(0, (0..30).map(|t| t * 1000 / 30)).await;
    node.until(999).await;
    node.peers.is_deaf.store(true, Ordering::Relaxed);
    node.feed(30, (30..60).map(|t| t * 1000 / 30)).await;
    node.until(1999).await;
    node.peers.is_deaf.store(false, Ordering::Relaxed);
    node.feed(60, (60..150).map(|t| t * 1000 / 30)).await;
    node.until(4980).await;
    assert!(node.peers.senders.set(Change::CloudEnabled(0, false)));
    node.feed(150, (150..180).map(|t| t * 1000 / 30)).await;
    node.until(9000).await;
    let lines = node.lines();
    assert_eq!(lines.len(), 180);
    for (t, line) in lines.iter().enumerate() {
        let source = if t < 150 { "cloud1" } else { "local" };
        assert!(line.contains(&format!(": {t} {source}'s of {t}, asked at")), "{line}");
    }
    let tally = node.tally();
    assert!(tally.sources[0].lost >= 4, "{}", tally.sources[0].lost);
    // The node reported the loss, and at the end that all is well.
    let reported_lines = node.reported_lines();
    let locals = reported_lines.diagnostics.iter().flatten().filter(|it| it.name == "/node: local");
    let messages: Vec<_> = locals.map(|status| status.message.clone()).collect();
    assert!(messages.iter().any(|it| it.contains("no result from")), "{messages:?}");
    assert_eq!(messages.last().unwrap(), "in time");
}

#[tokio::test(start_paused = true)]
async fn a_call_is_dropped_when_its_timer_fires_when_it_is_cancelled_and_at_the_end() {
    let clouds: [(u64, Plan); 3] =
        [(500, |_| Loses), (40, |_| Loses), (500, |t| if t == 0 { Answers(60) } else { Loses })];
    let node = Node::start(|_| Answers(20), &clouds);
    node.feed(0, [0]).await;
    node.until(90).await;
    let mut dropped = node.peers.dropped.lock().unwrap().clone();
    dropped.sort_unstable();
    assert_eq!(dropped, [(1, 40), (2, 40), (3, 40)]);
    node.feed(1, [100]).await;
    node.until(110).await;
    node.running.abort();
    tokio::task::yield_now().await;
    node.until(111).await;
    assert_eq!(node.peers.dropped.lock().unwrap().len(), 6, "calls outlive the loop");
}

/// The first message is missed at 50 ms, and local's result for it comes at 60 ms. Without the
/// check, that value would be sent for a message of 55 ms with the same key (D2).
#[tokio::test(start_paused = true)]
async fn repeated_stamp_gets_no_stale_value() {
    let more = ["local.deadline:=0.05"];
    let node = Node::start_with(|t| if t == 7 { Answers(60) } else { Answers(20) }, &[], &more);
    node.feed(7, [0]).await;
    node.feed(7, [5]).await;
    node.feed(7, [55]).await;
    node.feed(8, [100, 1100]).await;
    node.feed(8, [1200]).await;
    node.until(2500).await;
    let expected = [
        "50 ms: 0 missed",
        "120 ms: 1 local's of 8, asked at 100 ms by F3",
        "1120 ms: 2 local's of 9, asked at 1100 ms by F3",
    ];
    assert_eq!(node.lines(), expected);
    let reported_lines = node.reported_lines();
    let fusion = &reported_lines.diagnostics.last().unwrap()[0];
    let count = fusion.values.iter().find(|value| value.key == "duplicate_stamp").unwrap();
    assert_eq!(count.value, "3");
    let periods = reported_lines.diagnostics.iter().map(|statuses| &statuses[0]);
    let warned: Vec<_> = periods.filter(|it| it.message.contains("has the same stamp")).collect();
    assert_eq!(warned.len(), 1);
    assert_eq!(warned[0].level, 1);
}

#[tokio::test(start_paused = true)]
async fn a_deadline_that_is_set_counts_from_the_next_message_on() {
    // The cloud has no deadline of its own.
    let node = Node::start(|_| Answers(10), &[(0, |_| Loses)]);
    node.feed(0, [0]).await;
    node.until(1).await;
    assert!(node.peers.senders.set(Change::Deadline(100 * MS)));
    node.until(10).await;
    node.feed(1, [10]).await;
    node.until(11).await;
    let seconds = Bytes::copy_from_slice(&0.05_f64.to_le_bytes());
    let seconds = Payload { big_endian: false, body: seconds };
    assert!(node.peers.senders.send(ReceivedTopic::Deadline, Some(seconds)).await);
    node.until(20).await;
    node.feed(2, [20]).await;
    node.until(21).await;
    assert!(node.peers.senders.set(Change::CloudDeadline(0, Some(30 * MS))));
    node.until(30).await;
    node.feed(3, [30]).await;
    node.until(1500).await;
    let expected = [
        "60 ms: 3 local's of 3, asked at 30 ms by F5",
        "70 ms: 2 local's of 2, asked at 20 ms by F5",
        "110 ms: 1 local's of 1, asked at 10 ms by F5",
        "500 ms: 0 local's of 0, asked at 0 ms by F5",
    ];
    assert_eq!(node.lines(), expected);
}

#[tokio::test(start_paused = true)]
async fn a_local_deadline_that_is_set_holds_for_the_next_message() {
    let node = Node::start(|_| Loses, &[]);
    assert!(node.peers.senders.set(Change::LocalDeadline(50 * MS)));
    node.until(1).await;
    node.feed(0, [10]).await;
    node.until(100).await;
    assert_eq!(node.lines(), ["60 ms: 0 missed"]);
}

/// A request ends as long before the end-to-end deadline as the reserve is, and local ends with it
/// (E2, E3).
#[tokio::test(start_paused = true)]
async fn a_request_ends_where_the_reserve_begins_and_local_with_the_end_to_end_deadline() {
    let budget = ["within:=0.2", "reserve:=0.05"];
    let local: Plan = |t| if t == 0 { Answers(10) } else { Loses };
    let node = Node::start_with(local, &[(500, |_| Loses)], &budget);
    node.feed(0, [0, 300]).await;
    node.until(1500).await;
    let expected = ["150 ms: 0 local's of 0, asked at 0 ms by F5", "500 ms: 1 missed"];
    assert_eq!(node.lines(), expected);
}

#[tokio::test(start_paused = true)]
async fn local_fails_at_once_while_nobody_listens_to_it() {
    let node = Node::start(|_| Answers(10), &[(500, |_| Answers(30))]);
    node.peers.local.store(0, Ordering::Relaxed);
    node.feed(0, [0]).await;
    node.until(100).await;
    node.peers.local.store(1, Ordering::Relaxed);
    node.feed(1, [100]).await;
    node.until(1500).await;
    let expected = [
        "30 ms: 0 cloud1's of 0, asked at 0 ms by F3",
        "130 ms: 1 cloud1's of 1, asked at 100 ms by F3",
    ];
    assert_eq!(node.lines(), expected);
    let local = &node.tally().sources[0];
    assert_eq!(local.reasons.to_string(), "1 × no node subscribes to its topic");
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_results_keeps_no_message_from_its_turn() {
    let node = Node::start(|_| Answers(20), &[]);
    let results = node.peers.senders.results.clone();
    // The channel never runs empty.
    let flood = tokio::spawn(async move {
        while results.send((LOCAL, Ok(payload(999, "stray")))).await.is_ok() {
            if results.capacity() > 32 {
                tokio::task::yield_now().await;
            }
        }
    });
    node.feed(0, [0]).await;
    while node.tally().messages == 0 {
        tokio::task::yield_now().await;
    }
    flood.abort();
    node.until(100).await;
    assert_eq!(node.lines().len(), 1);
}

/// With `lifecycle` the node is managed (D16).
#[tokio::test(start_paused = true)]
async fn d16_a_managed_node_takes_in_what_comes_while_it_is_active_and_answers_it_before_it_is_closed()
 {
    let node = Node::start_with(|_| Answers(300), &[], &["lifecycle:=true"]);
    node.feed(0, [10]).await;
    node.until(20).await;
    assert!(node.peers.senders.activate(true).await);
    node.feed(1, [30]).await;
    node.until(40).await;
    assert!(node.peers.senders.activate(false).await);
    node.feed(2, [50]).await;
    node.until(60).await;
    let (is_closed, ()) = tokio::join!(node.peers.senders.clean_up(), node.feed(3, [70]));
    assert!(is_closed);
    assert_eq!(node.start.elapsed(), 330 * MS);
    assert_eq!(node.lines(), ["330 ms: 0 local's of 1, asked at 30 ms by F3"]);
}
