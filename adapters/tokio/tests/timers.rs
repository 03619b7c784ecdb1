//! Tests the kernel's timers, which a paused clock does not move. The tests check what the timers
//! do, not how fast.
#![cfg(target_os = "linux")]

use std::future::pending;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{Config, Error, Local, Operator, Setup, Timers, spawn, stream};
use tokio::runtime::Builder;
use tokio::time::timeout;

const MS: Duration = Duration::from_millis(1);
/// Far longer than a test takes, so that a timer that never fires does not stop the tests forever.
const LONG: Duration = Duration::from_secs(60);

/// An operator whose cloud never answers. Each message is the deadline of its request.
struct UnansweredOperator;

impl Operator for UnansweredOperator {
    type Input = Duration;
    type Output = Duration;

    fn setup(self, setup: &mut Setup<Duration, Duration>) -> Local<Duration, Duration> {
        let message_handler = |message: &Duration, _| Some(((), *message));
        setup.use_cloud(|(), _| pending::<Result<Duration, Error>>(), message_handler, Ok, 1);
        Local::futures(8, |message: Arc<Duration>, _| async move { Ok(*message) })
    }
}

fn config() -> Config {
    Config { timers: Timers::Kernel, greatest_deadline: Duration::MAX, ..Config::default() }
}

/// Each item is sent by its own timer and none before it, even after the timer was set to an
/// earlier instant or to one in the past (P8, D9).
async fn the_timer_goes_off_at_each_due_instant_and_not_before() {
    let (mut writer, input) = stream(8);
    let (running, mut output) = spawn(UnansweredOperator, config(), input).unwrap();
    writer.write(60 * LONG).unwrap();
    for deadline in [30 * MS, 7 * MS, Duration::from_nanos(1), 11 * MS] {
        writer.write(deadline).unwrap();
        let item = timeout(LONG, output.read()).await.expect("it goes off").unwrap();
        assert_eq!(item.forwarded().unwrap().value, deadline);
        assert!(item.latency() >= deadline, "{:?} of {deadline:?}", item.latency());
    }
    // With several at once, the earliest comes first, whatever the order of the messages.
    for deadline in [40 * MS, 10 * MS, 25 * MS] {
        writer.write(deadline).unwrap();
    }
    for deadline in [10 * MS, 25 * MS, 40 * MS] {
        let item = timeout(LONG, output.read()).await.expect("it goes off").unwrap();
        assert_eq!(item.forwarded().unwrap().value, deadline);
        assert!(item.latency() >= deadline);
    }
    running.stop();
    drop(output);
    assert_eq!(running.join().await.unwrap().forwarded(), 7);
}

#[test]
fn on_one_thread_the_timer_goes_off_at_each_due_instant_and_not_before() {
    let runtime = Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(the_timer_goes_off_at_each_due_instant_and_not_before());
}

#[test]
fn on_several_threads_the_timer_goes_off_at_each_due_instant_and_not_before() {
    let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(the_timer_goes_off_at_each_due_instant_and_not_before());
}

#[test]
#[should_panic(expected = "enable_io")]
fn a_runtime_without_io_is_reported_at_the_start() {
    let runtime = Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(async {
        let (_, input) = stream(1);
        let _ = spawn(UnansweredOperator, config(), input);
    });
}
