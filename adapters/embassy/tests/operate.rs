//! Runs the operator on the host, with a clock that the test moves. Its reports make a trace, in
//! which the strict judge finds no violation.

use std::sync::{Mutex, PoisonError};

use embassy_futures::block_on;
use embassy_futures::select::select;
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, MockDriver};
use fuseline_core::{Cloud, Commit, Deadline, Fusion, Held, Priority, Timestamp};
use fuseline_embassy::{Arrival, Report, operate};
use fuseline_engine::arbiter::{Answer, decisions_of};
use fuseline_traces::{Decision, Input, judge};

const CLOUD: Priority = Priority::new(1);

/// A result's value, with its message and its source. It cannot be copied.
#[derive(PartialEq, Eq, Debug)]
struct Value(u64, Priority);

fn result(t: Timestamp, source: Priority) -> Arrival<Value> {
    Arrival::Result(t, source, Value(t.as_u64(), source))
}

/// Returns what the operator received, as a line of the trace.
fn input(at: u64, arrival: Option<Arrival>) -> Input {
    let number = |p: Priority| u64::from(p.as_u16());
    match arrival {
        None => Input::Tick { at },
        Some(Arrival::Message(t, limit)) => {
            Input::Open { at, t: t.as_u64(), deadline: limit.map(Deadline::as_nanos) }
        }
        Some(Arrival::Request(t, p, deadline, backlog)) => {
            let deadline = deadline.as_nanos();
            Input::Offer { at, t: t.as_u64(), p: number(p), deadline, backlog }
        }
        Some(Arrival::Result(t, p, ())) => Input::Result { at, t: t.as_u64(), p: number(p) },
        Some(Arrival::Failure(t, p)) => Input::Fail { at, t: t.as_u64(), p: number(p) },
    }
}

/// Appends the lines of a report to the trace.
fn record(trace: &mut Vec<u8>, commit: Commit, at: u64, reported: &Report<Value, 1>) {
    let mut lines = Vec::new();
    let mut decide = |decision: Decision| lines.push(decision);
    match *reported {
        Report::Took(arrival) => {
            input(at, arrival).write(trace);
            trace.push(b'\n');
        }
        Report::Fired(firing, _) => decisions_of(at, &firing, decide),
        Report::Opened(t, opening) => {
            Answer::<1>::Open { t: t.as_u64(), opening }.decisions(commit, at, &mut decide);
        }
        Report::Offered(t, p, admission) => {
            let (t, p) = (t.as_u64(), p.as_u16().into());
            Answer::<1>::Offer { t, p, admission }.decisions(commit, at, &mut decide);
        }
        Report::Concluded(t, p, outcome, _) => {
            let (t, p) = (t.as_u64(), p.as_u16().into());
            Answer::Result { t, p, outcome }.decisions(commit, at, &mut decide);
        }
    }
    for line in lines {
        line.write(trace);
        trace.push(b'\n');
    }
}

/// Lets the operator take its inputs, then moves the clock by this many milliseconds.
async fn pass(millis: u64) {
    for _ in 0..4 {
        yield_now().await;
    }
    for _ in 0..millis {
        MockDriver::get().advance(Duration::from_millis(1));
        yield_now().await;
    }
}

/// Plays six messages under this rule. Returns the trace, which conforms, and the values that were
/// sent.
fn play(commit: Commit, word: &str) -> (String, Vec<Value>) {
    // All tests share one clock.
    static CLOCK: Mutex<()> = Mutex::new(());
    let _clock = CLOCK.lock().unwrap_or_else(PoisonError::into_inner);
    let inbox = Channel::<NoopRawMutex, Arrival<Value>, 8>::new();
    let clouds = [Cloud::new(CLOUD, 31)];
    let mut fusion = Fusion::<1, 4>::new(4, commit, &clouds).expect("a configuration");
    let mut held = Held::new();
    let mut sent = Vec::new();
    let header =
        format!(r#"{{"fuseline":1,"window":4,"commit":"{word}","clouds":[{{"p":1,"limit":31}}]}}"#);
    let mut trace = format!("{header}\n").into_bytes();
    let script = async {
        for t in (0..6).map(Timestamp::new) {
            inbox.send(Arrival::Message(t, Some(Deadline::from_millis(80)))).await;
            inbox.send(Arrival::Request(t, CLOUD, Deadline::from_millis(40), 0)).await;
            pass(10).await;
            match t.as_u64() {
                // Neither source answers, so the message is missed at local's deadline.
                4 => pass(80).await,
                // The cloud's call fails, and local's result comes afterwards.
                3 => {
                    inbox.send(Arrival::Failure(t, CLOUD)).await;
                    inbox.send(result(t, Priority::LOCAL)).await;
                }
                // Local's result is held when the script ends and the operator is dropped.
                5 => inbox.send(result(t, Priority::LOCAL)).await,
                // Local's result is held until the cloud's timer fires. The cloud's result comes
                // too late.
                2 => {
                    inbox.send(result(t, Priority::LOCAL)).await;
                    pass(60).await;
                    inbox.send(result(t, CLOUD)).await;
                }
                _ => {
                    inbox.send(result(t, Priority::LOCAL)).await;
                    pass(10).await;
                    inbox.send(result(t, CLOUD)).await;
                }
            }
            pass(5).await;
        }
    };
    let mut reported = |at: fuseline_core::Instant, reported: Report<Value, 1>| {
        record(&mut trace, commit, at.as_nanos(), &reported);
        if let Report::Fired(_, Some(value)) | Report::Concluded(.., Some(value)) = reported {
            sent.push(value);
        }
    };
    block_on(select(operate(&mut fusion, &mut held, inbox.receiver(), &mut reported), script));
    let again = operate(&mut fusion, &mut held, inbox.receiver(), reported);
    block_on(select(again, pass(60)));

    let verdict = judge("operate", trace.as_slice()).expect("a trace");
    let text = String::from_utf8(trace).expect("UTF-8");
    assert!(verdict.violations.is_empty() && verdict.judged == 6, "{verdict:?}\n{text}");
    // A tick at the due instant itself, not before it nor later.
    assert!(text.contains(r#"{"ev":"tick","at":"#), "{text}");
    assert_eq!((fusion.len(), held.len()), (0, 0));
    (text, sent)
}

fn counts<const N: usize>(trace: &str, events: [&str; N]) -> [usize; N] {
    events.map(|ev| trace.matches(&format!(r#""ev":"{ev}""#)).count())
}

#[test]
fn six_messages_are_decided_and_the_judge_finds_nothing() {
    let (trace, sent) = play(Commit::Eager, "eager");
    assert_eq!(counts(&trace, ["emit", "miss", "timer"]), [5, 1, 4], "{trace}");
    let (local, cloud) = (Priority::LOCAL, CLOUD);
    let values = [(0, cloud), (1, cloud), (2, local), (3, local), (5, local)];
    assert_eq!(sent, values.map(|(t, source)| Value(t, source)));
}

/// F9.
#[test]
fn under_progressive_each_better_value_is_sent_at_once_and_what_was_sent_last_is_final() {
    let (trace, sent) = play(Commit::Progressive, "progressive");
    assert_eq!(
        counts(&trace, ["emit", "final", "miss", "timer", "hold"]),
        [7, 5, 1, 4, 0],
        "{trace}"
    );
    let (local, cloud) = (Priority::LOCAL, CLOUD);
    let values =
        [(0, local), (0, cloud), (1, local), (1, cloud), (2, local), (3, local), (5, local)];
    assert_eq!(sent, values.map(|(t, source)| Value(t, source)));
}
