//! Tests the outcomes of messages, to the millisecond. Every run's trace is judged too.

use std::time::Duration;

use crate::support::SourceAction::{Answers, Fails, Never, Panics};
use crate::support::{CloudScript, Script, play, play_default};
use fuseline_tokio::{Commit, Config, DropReason, Latency, OfferRefusal, OpenRefusal, SourceTally};

/// A local result after its deadline is late, and local is never aborted (D6).
#[tokio::test(start_paused = true)]
async fn local_past_its_deadline_is_late_and_never_aborted() {
    let script = Script {
        local: |_| Answers(80),
        deadline: Some(Duration::from_millis(50)),
        ..Script::new()
    };
    let played = play_default(script.cloud(1, 100, |_| Answers(90)), &[0]).await;
    assert_eq!(played.items, "90.000 ms: 0 cloud 1 by arrival from 90 ms\n");
    assert_eq!(played.tally.sources[0].dropped.get(&DropReason::Late), Some(&1));
}

/// The best held result is sent when the first timer fires (D2).
#[tokio::test(start_paused = true)]
async fn the_best_held_result_goes_when_the_first_timer_fires() {
    let script = || {
        Script::new().cloud(1, 100, |_| Answers(40)).cloud(2, 150, |_| Answers(60)).cloud(
            3,
            300,
            |_| Answers(200),
        )
    };
    let played = play_default(script(), &[0]).await;
    // Cloud 2's result is held. Its own timer and cloud 1's keep running, and cloud 1's fires
    // first.
    assert_eq!(played.items, "100.000 ms: 0 cloud 2 by timer from 60 ms\n");

    let patient = Config { commit: Commit::Patient, ..Config::default() };
    let played = play(script(), patient, &[0]).await;
    assert_eq!(played.items, "200.000 ms: 0 cloud 3 by arrival from 200 ms\n");
}

/// A slow network fills the queue, which shuts the gate until the queue is empty (D4).
#[tokio::test(start_paused = true)]
async fn a_slow_network_fills_the_queue_and_shuts_the_gate_until_it_is_empty() {
    let mut script = Script::new();
    let slow = CloudScript { priority: 1, deadline_ms: 100, act: |_| Never, limit: 2, calls: 1 };
    script.clouds.push(slow);
    // One call is under way, two requests wait, and the fourth is refused. At 100 ms the first
    // timer fires and the second call starts. One request still waits, so the gate stays shut. At
    // 130 ms the queue is empty.
    let played = play_default(script, &[0, 10, 20, 30, 105, 130]).await;
    let cloud = &played.tally.sources[1];
    assert_eq!(cloud.refused.get(&OfferRefusal::Queue), Some(&2));
    assert_eq!(cloud.admitted, 4);
    assert_eq!(
        played.items,
        "50.000 ms: 3 local by arrival from 50 ms\n100.000 ms: 0 local by timer from 20 ms\n\
         110.000 ms: 1 local by timer from 30 ms\n120.000 ms: 2 local by timer from 40 ms\n\
         125.000 ms: 4 local by arrival from 125 ms\n230.000 ms: 5 local by timer from 150 ms\n"
    );
    assert_eq!(cloud.sent_bytes, 400);
}

/// Each message of a long run in which everything goes wrong is answered once (D1, D11).
#[tokio::test(start_paused = true)]
async fn every_message_of_a_long_run_with_everything_going_wrong_is_answered_once() {
    let local = |t| match t % 11 {
        3 => Fails(15),
        7 => Panics(5),
        _ => Answers(20 + t % 40),
    };
    let script = Script { local, deadline: Some(Duration::from_millis(55)), ..Script::new() }
        .cloud(5, 60, |t| if t % 3 == 0 { Never } else { Answers(t * 7 % 90) })
        .cloud(9, 45, |t| if t % 5 == 0 { Fails(t * 3 % 50) } else { Answers(t * 13 % 70) })
        .cloud(2, 80, |t| if t % 7 == 0 { Panics(t % 20) } else { Answers(t * 11 % 120) });
    let messages: Vec<u64> = (0..500).map(|i| i * 7).collect();
    for commit in Commit::ALL {
        let script = Script { clouds: script.clouds.clone(), ..script };
        let played =
            play(script, Config { window: 6, commit, ..Config::default() }, &messages).await;
        let lines = || played.items.lines();
        assert_eq!(lines().filter(|line| !line.contains("preliminary")).count(), 500);
        let finals = |of: fn(&SourceTally) -> u64| played.tally.sources.iter().map(of).sum::<u64>();
        let counted = [finals(|source| source.preliminary), finals(|source| source.finals)];
        let items = ["preliminary", "final"]
            .map(|ending| lines().filter(|line| line.contains(ending)).count() as u64);
        assert_eq!(items, counted);
        assert_eq!(items.iter().all(|count| *count > 100), commit == Commit::Progressive);
        let CountedOutcomes { forwarded, missed, refused } = tallied(&played.tally);
        assert_eq!(forwarded + missed + refused, 500);
        assert!(forwarded > 300 && missed > 0 && refused > 0, "{:?}", played.tally);
    }
}

struct CountedOutcomes {
    forwarded: u64,
    missed: u64,
    refused: u64,
}

fn tallied(tally: &fuseline_tokio::Tally) -> CountedOutcomes {
    let refused = tally.refused.values().sum();
    CountedOutcomes { forwarded: tally.forwarded(), missed: tally.missed, refused }
}

/// Latency is measured only for accepted messages, because a refused message is not computed (E3).
#[tokio::test(start_paused = true)]
async fn a_latency_is_measured_of_the_messages_that_were_taken_on() {
    let latency = Latency::measured(1, Duration::ZERO);
    let config = Config { window: 1, latency: Some(latency.clone()), ..Config::default() };
    // The second message of each pair comes before the first one is answered.
    let messages: Vec<u64> = (0..16).flat_map(|pair| [100 * pair, 100 * pair + 5]).collect();
    let played = play(Script::new(), config, &messages).await;
    assert_eq!(played.tally.refused, [(OpenRefusal::Full, 16)].into());
    assert_eq!(latency.estimate().with_clouds(), Duration::from_millis(20));
}
