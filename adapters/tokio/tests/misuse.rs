//! Tests misuse from Rust. Each case is refused with the remedy or reported, and none is silent.
//!
//! The line `misuse:` of each says what the caller does and what happens; `docs/safety/make` makes the book's table of them.
//! `fuseline-faults` removes each check of `docs/safety/misuse-guards` once, and its case must fail.

use std::future::pending;
use std::time::Duration;

use fuseline_tokio::deadline::{Chosen, Classes, End, Guard, Parameters, Policy, Situation, Span};
use fuseline_tokio::{
    Commit, Config, Ending, EngineConfigError, Error, Local, OfferRefusal, OpenRefusal, Setup,
    SpawnError, WriteError, spawn, stream,
};
use tokio::time::{advance, sleep};

use crate::support::{ClosureOperator, RunResult, play};

#[expect(dead_code, reason = "it is of the other tests too")]
mod support;

const MS: Duration = Duration::from_millis(1);

type Clouds = Setup<u64, String>;

/// Returns a local computation that takes 20 ms.
fn local() -> Local<u64, String> {
    Local::future(|n, _| async move {
        sleep(20 * MS).await;
        Ok(format!("local {n}"))
    })
}

fn cloud(setup: &mut Clouds, priority: u16, deadline: Duration) -> &mut fuseline_tokio::Cloud {
    let handle = |n: u64, _| async move { Ok(n) };
    setup.use_cloud(handle, move |n, _| Some((*n, deadline)), |n| Ok(format!("{n}")), priority)
}

/// Plays messages on a paused clock.
async fn played(
    prepare: impl FnOnce(&mut Clouds) -> Local<u64, String>,
    config: Config,
    at: &[u64],
) -> RunResult {
    play(ClosureOperator(prepare), config, at).await
}

fn refused(prepare: impl FnOnce(&mut Clouds), config: Config) -> SpawnError {
    let operator = ClosureOperator(|setup: &mut Clouds| {
        prepare(setup);
        local()
    });
    spawn(operator, config, stream(1).1).unwrap_err()
}

/// misuse: gives two clouds one priority | not started: `SpawnError::Config`
#[tokio::test]
async fn two_clouds_of_one_priority() {
    let error = refused(
        |setup| {
            cloud(setup, 1, MS);
            cloud(setup, 1, MS);
        },
        Config::default(),
    );
    assert!(error.to_string().contains("two clouds with priority 1"), "{error}");
}

/// misuse: gives a cloud the priority 0, which is local's | not started: `SpawnError::Config`
#[tokio::test]
async fn a_cloud_of_priority_0() {
    let error = refused(
        |setup| {
            cloud(setup, 0, MS);
        },
        Config::default(),
    );
    assert!(error.to_string().contains("priority 0"), "{error}");
}

/// misuse: gives a gate that never opens again | not started: `SpawnError::Config`
#[tokio::test]
async fn a_gate_that_never_opens() {
    let error = refused(|setup| cloud(setup, 1, MS).resume = 99, Config::default());
    assert!(error.to_string().contains("resume below its limit"), "{error}");
}

/// misuse: gives a window of 0 | not started: `SpawnError::Config`
#[tokio::test]
async fn a_window_of_0() {
    let error = refused(|_| (), Config { window: 0, ..Config::default() });
    assert!(matches!(error, SpawnError::Config(_)), "{error}");
}

/// misuse: gives an output no room | not started: `SpawnError::NoOutput`
#[tokio::test]
async fn an_output_without_room() {
    let error = refused(|_| (), Config { output_len: 0, ..Config::default() });
    assert!(matches!(error, SpawnError::NoOutput), "{error}");
}

/// misuse: starts an operator outside of a runtime | not started: `SpawnError::NoRuntime`
#[test]
fn no_runtime() {
    let error = refused(|_| (), Config::default());
    assert!(matches!(error, SpawnError::NoRuntime), "{error}");
}

/// misuse: gives a side request a gate that never opens | not started: `SpawnError::SideRequest`
#[tokio::test]
async fn a_side_request_whose_gate_never_opens() {
    let prepare = |setup: &mut Clouds| {
        let handle = |(), _| pending::<Result<(), Error>>();
        setup.use_side_request(handle, |_, _| Some(((), MS)), |()| Ok(())).resume = 99;
    };
    let error = refused(prepare, Config::default());
    assert!(matches!(error, SpawnError::SideRequest { .. }), "{error}");
}

/// misuse: uses a guard under progressive | not started: `SpawnError::Config`
#[tokio::test]
async fn a_guard_under_progressive() {
    let prepare = |setup: &mut Clouds| {
        let guard = Guard::new(Parameters::default()).unwrap();
        cloud(setup, 1, MS).policy = Some(Box::new(guard));
    };
    let config = Config { commit: Commit::Progressive, ..Config::default() };
    assert!(matches!(
        refused(prepare, config),
        SpawnError::Config(EngineConfigError::OneOutput { .. })
    ));
}

/// misuse: gives milliseconds for a figure in seconds | refused with the range: `Invalid`
#[test]
fn milliseconds_for_seconds() {
    let local_response = Span::exactly(Duration::from_secs(301));
    let error = Guard::new(Parameters { local_response, ..Parameters::default() }).unwrap_err();
    assert!(error.to_string().contains("60 s"), "{error}");
}

/// misuse: gives a guard no hazards | refused: `Invalid`
#[test]
fn no_hazards() {
    assert!(Classes::new(&[]).is_err());
}

/// misuse: offers a deadline of 0 | the request is refused `deadline`, and counted
#[tokio::test(start_paused = true)]
async fn a_deadline_of_0() {
    let prepare = |setup: &mut Clouds| {
        cloud(setup, 1, Duration::ZERO);
        local()
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[1].refused.get(&OfferRefusal::Deadline), Some(&1));
}

/// misuse: offers milliseconds as seconds | refused `deadline` above `Config::greatest_deadline`, counted, and logged at the first
#[tokio::test(start_paused = true)]
async fn a_deadline_in_a_wrong_unit() {
    let prepare = |setup: &mut Clouds| {
        cloud(setup, 1, Duration::from_secs(400));
        local()
    };
    let RunResult { items, tally, .. } = played(prepare, Config::default(), &[0]).await;
    assert_eq!(tally.sources[1].refused.get(&OfferRefusal::Deadline), Some(&1));
    assert!(items.starts_with("20.000 ms: 0 local 0"), "{items}");
}

/// misuse: gives local milliseconds as seconds | not started: `SpawnError::LocalDeadline`
#[tokio::test]
async fn a_deadline_of_local_in_a_wrong_unit() {
    let operator = ClosureOperator(|_: &mut Clouds| {
        let mut local = local();
        local.deadline = Some(Duration::from_secs(400));
        local
    });
    let error = spawn(operator, Config::default(), stream(1).1).unwrap_err();
    assert!(matches!(error, SpawnError::LocalDeadline { .. }), "{error}");
}

/// misuse: offers what is left of a budget that is used up, `budget - age` | no request; counted as a failure of the handler
#[tokio::test(start_paused = true)]
async fn a_budget_that_is_used_up() {
    #![expect(clippy::unchecked_time_subtraction, reason = "it is the mistake")]
    let prepare = |setup: &mut Clouds| {
        let handle = |n: u64, _| async move { Ok(n) };
        let message_handler = |n: &u64, _| Some((*n, 30 * MS - 50 * MS));
        setup.use_cloud(handle, message_handler, |n| Ok(format!("{n}")), 1);
        local()
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[1].handler_failures, 1);
}

/// misuse: gives local a deadline of 0 | each message is an item, refused `deadline`
#[tokio::test(start_paused = true)]
async fn a_deadline_of_0_for_local() {
    let prepare = |_: &mut Clouds| {
        let mut local = local();
        local.deadline = Some(Duration::ZERO);
        local
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.refused.get(&OpenRefusal::Deadline), Some(&1));
}

/// misuse: computes on board what never ends | missed after a second; counted as lost, and logged
#[tokio::test(start_paused = true)]
async fn a_local_that_never_ends() {
    let prepare = |_: &mut Clouds| Local::future(|_, _| pending());
    let RunResult { items, tally, .. } = played(prepare, Config::default(), &[0]).await;
    assert_eq!(items, "1000.000 ms: 0 missed\n");
    assert_eq!(tally.sources[0].lost, 1);
}

/// misuse: blocks in a handle | counted in `SourceTally::held_up`, and logged
#[tokio::test(start_paused = true)]
async fn a_handle_that_blocks() {
    let prepare = |setup: &mut Clouds| {
        let handle = |n: u64, _| async move {
            // The clock advances within one poll.
            advance(400 * MS).await;
            Ok(n)
        };
        setup.use_cloud(handle, |n, _| Some((*n, 900 * MS)), |n| Ok(format!("{n}")), 1);
        local()
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[1].held_up, 1);
}

/// misuse: panics in a message handler | no request; counted in `SourceTally::handler_failures`, and logged
#[tokio::test(start_paused = true)]
async fn a_message_handler_that_panics() {
    let prepare = |setup: &mut Clouds| {
        let handle = |n: u64, _| async move { Ok(n) };
        setup.use_cloud(handle, |_, _| panic!("on purpose"), |n| Ok(format!("{n}")), 1);
        local()
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[1].handler_failures, 1);
}

/// misuse: panics in a policy | no request; counted in `SourceTally::policy_failures`, and logged
#[tokio::test(start_paused = true)]
async fn a_policy_that_panics() {
    struct Panics;
    impl Policy for Panics {
        fn decide(&mut self, _: &Situation<'_>, _: Duration) -> Chosen {
            panic!("on purpose")
        }
        fn ended(&mut self, _: End) {}
    }
    let prepare = |setup: &mut Clouds| {
        cloud(setup, 1, 100 * MS).policy = Some(Box::new(Panics));
        local()
    };
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[1].policy_failures, 1);
}

/// misuse: panics in a handle or in local | a failure with the reason
#[tokio::test(start_paused = true)]
async fn a_computation_that_panics() {
    let prepare = |_: &mut Clouds| Local::future(|_, _| async { panic!("on purpose") });
    let tally = played(prepare, Config::default(), &[0]).await.tally;
    assert_eq!(tally.sources[0].reasons.iter().next(), Some(("it panicked: on purpose", 1)));
}

/// misuse: writes more than the window holds | an item, refused `full`
#[tokio::test(start_paused = true)]
async fn more_than_the_window() {
    let config = Config { window: 1, ..Config::default() };
    let items = played(|_| local(), config, &[0, 1]).await.items;
    assert!(items.contains("1 refused full"), "{items}");
}

/// misuse: writes into a full stream, or one that nobody reads | `WriteError`, with the message
#[tokio::test]
async fn a_full_stream() {
    let (mut writer, reader) = stream(1);
    writer.write(1).unwrap();
    assert!(matches!(writer.write(2), Err(WriteError::Full(2))));
    drop(reader);
    assert!(matches!(writer.write(3), Err(WriteError::Closed(3))));
}

/// misuse: never reads the output | new messages wait, and the stream of inputs refuses more
#[tokio::test(start_paused = true)]
async fn an_output_that_nobody_reads() {
    let config = Config { output_len: 1, window: 1, ..Config::default() };
    let (mut writer, input) = stream(1);
    let (_running, mut output) =
        spawn(ClosureOperator(|_: &mut Clouds| local()), config, input).unwrap();
    let mut written = 0;
    for _ in 0..20 {
        written += usize::from(writer.write(7).is_ok());
        sleep(50 * MS).await;
    }
    assert!(written < 20, "{written}");
    assert!(matches!(output.read().await.unwrap().ending, Ending::Forwarded(_)));
}

/// misuse: stops an operator twice | the second does nothing; `join` ends
#[tokio::test]
async fn stopped_twice() {
    let (_writer, input) = stream(1);
    let operator = ClosureOperator(|_: &mut Clouds| local());
    let (running, _output) = spawn(operator, Config::default(), input).unwrap();
    running.stop();
    running.stop();
    running.join().await.unwrap();
}
