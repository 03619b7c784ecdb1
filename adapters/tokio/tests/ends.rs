//! Tests that an operator ends in order, whatever is still under way or waits to be read.

use std::time::Duration;

use crate::support::{ClosureOperator, play};
use fuseline_tokio::{Call, Config, Error, Local, Setup, spawn, stream};
use tokio::time::timeout;

/// A lingering call is dropped when the operator ends. If that panics, no item and no line of the
/// trace is lost (D7, D10).
#[tokio::test(start_paused = true)]
async fn a_call_that_panics_when_it_is_dropped_at_the_end_costs_neither_items_nor_trace() {
    play_with_calls_that_panic_on_drop(Duration::from_secs(1)).await;
}

/// If dropping an aborted call panics, no item and no line of the trace is lost (D6, D7).
#[tokio::test(start_paused = true)]
async fn a_call_that_panics_when_it_is_aborted_costs_neither_items_nor_trace() {
    play_with_calls_that_panic_on_drop(Duration::ZERO).await;
}

async fn play_with_calls_that_panic_on_drop(linger: Duration) {
    struct PanicsOnDrop;
    impl Drop for PanicsOnDrop {
        fn drop(&mut self) {
            panic!("on purpose");
        }
    }
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let handle = |_: u64, _: Call| async {
            let _bomb = PanicsOnDrop;
            std::future::pending::<Result<String, Error>>().await
        };
        let deadline = Duration::from_millis(30);
        let cloud = setup.use_cloud(handle, move |m, _| Some((*m, deadline)), Ok, 1);
        (cloud.linger, cloud.calls) = (linger, 2);
        Local::future(|_, _| async { Ok("local".to_owned()) })
    });
    let played = play(operator, Config::default(), &[0, 100]);
    let played = timeout(Duration::from_secs(60), played).await.expect("its output ends");
    let items = "30.000 ms: 0 local by timer from 0 ms\n130.000 ms: 1 local by timer from 100 ms\n";
    assert_eq!(played.items, items);
    assert_eq!(played.trace.matches(r#""ev":"emit""#).count(), 2);
}

/// A stop loses no item that was decided, even if the item still waits for room (D1).
#[tokio::test(start_paused = true)]
async fn a_stop_loses_no_item_that_was_decided_and_finds_room() {
    let operator = ClosureOperator(|_: &mut Setup<u64, String>| {
        Local::futures(2, |_, _| async { Ok("local".to_owned()) })
    });
    let (mut writer, input) = stream(2);
    let config = Config { output_len: 1, ..Config::default() };
    let (running, mut output) = spawn(operator, config, input).unwrap();
    assert_eq!((writer.write(0), writer.write(1)), (Ok(0), Ok(1)));
    tokio::time::sleep(Duration::from_millis(1)).await;
    assert_eq!(output.read().await.map(|item| item.timestamp), Some(0));
    running.stop();
    assert_eq!(output.read().await.map(|item| item.timestamp), Some(1));
    assert!(output.read().await.is_none());
}
