//! Tests threads and blocking: handlers that block an operator are counted and logged, encoding
//! runs on a thread of its own, and a local computation that hangs is replaced or reported.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::Duration;

use fuseline_tokio::{
    Call, CarriedState, Config, EncodeOnce, Ending, Error, Local, Running, Setup, Tally, Writer,
    spawn, stream,
};
use tokio::runtime::Builder;
use tokio::task::spawn_blocking;
use tokio::time::{advance, sleep};

use crate::support::{ClosureOperator, play};

const MS: Duration = Duration::from_millis(1);

/// Registers one cloud with this handle, and returns a local computation that answers at once.
fn with_cloud<Fut>(
    setup: &mut Setup<u64, String>,
    handle: impl Fn(u64, Call) -> Fut + Send + Sync + 'static,
) -> Local<u64, String>
where
    Fut: Future<Output = Result<u64, Error>> + Send + 'static,
{
    setup.use_cloud(handle, |n, _| Some((*n, 30_000 * MS)), |n| Ok(format!("cloud {n}")), 1);
    Local::future(|n, _| async move { Ok(format!("local {n}")) })
}

#[tokio::test(start_paused = true)]
async fn a_handle_that_blocks_its_thread_is_counted_and_one_that_waits_is_not() {
    let operator = |is_blocking: bool| {
        ClosureOperator(move |setup: &mut Setup<u64, String>| {
            with_cloud(setup, move |n, _| async move {
                if is_blocking {
                    // This advances the paused clock within one poll, so nothing else runs in the
                    // meantime.
                    advance(400 * MS).await;
                } else {
                    sleep(400 * MS).await;
                }
                Ok(n)
            })
        })
    };
    let tally = play(operator(false), Config::default(), &[0, 1000]).await.tally;
    assert_eq!((tally.sources[1].held_up, tally.greatest_lag), (0, Duration::ZERO));
    let tally = play(operator(true), Config::default(), &[0, 1000]).await.tally;
    assert_eq!((tally.sources[1].held_up, tally.greatest_lag), (2, 400 * MS));
}

#[tokio::test(start_paused = true)]
async fn a_message_handler_that_panics_and_a_situation_are_counted() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        setup.use_situation(|_, _| panic!("on purpose"));
        let handle = |n: u64, _| async move { Ok(n) };
        setup.use_cloud(handle, |_, _| panic!("on purpose"), |n| Ok(format!("cloud {n}")), 1);
        Local::future(|n, _| async move { Ok(format!("local {n}")) })
    });
    let tally = play(operator, Config::default(), &[0, 10]).await.tally;
    assert_eq!((tally.handler_failures, tally.sources[1].handler_failures), (2, 2));
}

/// Handlers of states, substitutes and hints that panic are counted (D11).
#[tokio::test(start_paused = true)]
async fn handlers_of_states_substitutes_and_hints_that_panic_are_counted() {
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        setup.use_state(&CarriedState::new(()), |_| panic!("on purpose"));
        setup.use_substitute(|_| panic!("on purpose"));
        setup.on_late_result(|_| panic!("on purpose"));
        let mut local = Local::future(|n, _| async move {
            if *n == 1 {
                sleep(20 * MS).await;
            }
            Ok(format!("local {n}"))
        });
        local.deadline = Some(10 * MS);
        local
    });
    // Two results are sent. One message is missed, and its result is late.
    let tally = play(operator, Config::default(), &[0, 10, 50]).await.tally;
    assert_eq!((tally.forwarded(), tally.missed, tally.handler_failures), (2, 1, 4));
}

#[tokio::test]
async fn what_blocks_the_thread_is_counted_and_encoding_is_not() {
    let blocking = ClosureOperator(|setup: &mut Setup<u64, String>| {
        with_cloud(setup, |n, _| async move {
            thread::sleep(200 * MS);
            Ok(n)
        })
    });
    let warned = Config { lag_warning: 100 * MS, ..Config::default() };
    let tally = real_time(blocking, warned.clone(), 2).await.1;
    assert_eq!(tally.sources[1].held_up, 2);
    assert!(tally.greatest_lag >= 200 * MS);

    let (seen, left) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(Vec::new())));
    let (names, deadlines) = (Arc::clone(&seen), Arc::clone(&left));
    let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
        let once = EncodeOnce::new(move |n: u64| {
            names.lock().unwrap().push(thread::current().id());
            thread::sleep(200 * MS);
            if n == 1 { Err("on purpose".into()) } else { Ok(n + 100) }
        });
        let send = move |n: u64, call: Call| {
            deadlines.lock().unwrap().push(call.deadline);
            async move { Ok(n) }
        };
        let message_handler = once.message_handler(|n: &u64, _| Some((*n, 30_000 * MS)));
        let response_handler = |n: u64| Ok(format!("cloud {n}"));
        setup.use_cloud(once.handle(send), message_handler, response_handler, 1);
        Local::future(|n, _| async move { Ok(format!("local {n}")) })
    });
    let warned = Config { lag_warning: 30_000 * MS, ..Config::default() };
    let (items, tally) = real_time(operator, warned, 2).await;
    assert_eq!(items, ["cloud 100", "local 1"]);
    assert_eq!(tally.sources[1].held_up, 0);
    assert!(seen.lock().unwrap().iter().all(|thread| *thread != thread::current().id()));
    assert!(left.lock().unwrap().iter().all(|left| *left <= 29_800 * MS));
}

/// An encoding does not begin after its call was aborted. The only thread for blocking work is busy
/// until then (D6).
#[test]
fn an_encoding_does_not_begin_once_its_call_was_aborted() {
    let runtime = Builder::new_current_thread().enable_all().max_blocking_threads(1).build();
    let (held, begun) = (Hold::default(), Arc::new(AtomicUsize::new(0)));
    runtime.unwrap().block_on(async {
        let (busy, count) = (Arc::clone(&held), Arc::clone(&begun));
        let blocked = spawn_blocking(move || hold(&busy));
        let operator = ClosureOperator(move |setup: &mut Setup<u64, String>| {
            let encode = move |n: u64| Ok(n + count.fetch_add(1, Ordering::Relaxed) as u64);
            let once = EncodeOnce::new(encode);
            let handle = once.handle(|n: u64, _| async move { Ok(n) });
            let message_handler = once.message_handler(|n: &u64, _| Some((*n, 50 * MS)));
            setup.use_cloud(handle, message_handler, |n| Ok(n.to_string()), 1);
            Local::future(|n, _| async move { Ok(format!("local {n}")) })
        });
        let (mut writer, input) = stream(8);
        let (running, mut output) = spawn(operator, Config::default(), input).unwrap();
        writer.write(0).unwrap();
        let item = output.read().await.unwrap();
        assert_eq!(item.forwarded().unwrap().value, "local 0");
        // Let this thread drop the aborted call.
        for _ in 0..100 {
            tokio::task::yield_now().await;
        }
        release(&held);
        running.stop();
        running.join().await.unwrap();
        blocked.await.unwrap();
        // When this task has run, all tasks that were queued earlier have run too.
        spawn_blocking(|| ()).await.unwrap();
    });
    assert_eq!(begun.load(Ordering::Relaxed), 0);
}

/// A lock that holds threads until it is released.
type Hold = Arc<(Mutex<bool>, Condvar)>;

fn hold(hold: &Hold) {
    let released = hold.0.lock().unwrap();
    drop(hold.1.wait_timeout_while(released, Duration::from_secs(60), |it| !*it).unwrap());
}

fn release(hold: &Hold) {
    *hold.0.lock().unwrap() = true;
    hold.1.notify_all();
}

#[tokio::test]
async fn a_local_that_hangs_is_reported_and_replaced_if_it_can_be_made_anew() {
    let held = Hold::default();
    let compute = |held: Hold| {
        move |n: &u64, _: u64| {
            if *n == 0 {
                hold(&held);
            }
            Ok(format!("local {n}"))
        }
    };
    let anew = Arc::clone(&held);
    let mut local = Local::threads(1, move || compute(Arc::clone(&anew)));
    local.deadline = Some(200 * MS);
    let operator = ClosureOperator(move |_: &mut Setup<u64, String>| local);
    // On a busy host later messages may be missed too, but not all of them.
    let is_over = |items: &[String]| items.len() == 100 || items.iter().any(|it| it != "missed");
    let (items, _) = real_time_until(operator, Config::default(), is_over).await;
    assert_eq!(items[0], "missed");
    assert!(items.len() < 100, "no thread took the place of the one that hangs");

    // A single blocking function may keep state, so it never runs twice at the same time and is not
    // replaced.
    let mut local = Local::blocking(compute(Arc::clone(&held)));
    (local.deadline, local.replaceable) = (Some(200 * MS), 9);
    let operator = ClosureOperator(move |_: &mut Setup<u64, String>| local);
    let (items, tally) = real_time(operator, Config::default(), 2).await;
    assert_eq!(items, ["missed"; 2]);
    assert!(tally.sources[0].lost >= 1);
    release(&held);
}

/// Once a hung computation has ended, there are as many threads as before (D8).
#[tokio::test]
async fn a_thread_that_was_replaced_ends_with_its_computation() {
    let (held, thread) = (Hold::default(), Arc::new(()));
    let (hung, mine) = (Arc::clone(&held), Arc::clone(&thread));
    // A thread drops its compute function when it ends, so clones of `thread` count the threads.
    let mut local = Local::threads(1, move || {
        let (hung, mine) = (Arc::clone(&hung), Arc::clone(&mine));
        move |n: &u64, _: u64| {
            drop(Arc::clone(&mine));
            if *n == 0 {
                hold(&hung);
            }
            Ok(format!("local {n}"))
        }
    });
    local.deadline = Some(200 * MS);
    let operator = ClosureOperator(move |_: &mut Setup<u64, String>| local);
    let (mut writer, input) = stream(8);
    let (running, mut output) = spawn(operator, Config::default(), input).unwrap();
    writer.write(0).unwrap();
    assert!(matches!(output.read().await.unwrap().ending, Ending::Missed));
    let threads = || Arc::strong_count(&thread) - 2;
    let wait = async |count| {
        for _ in 0..20_000 {
            if threads() == count {
                return;
            }
            sleep(MS).await;
        }
        panic!("{} threads, not {count}", threads());
    };
    wait(2).await;
    release(&held);
    wait(1).await;
    running.stop();
    running.join().await.unwrap();
}

#[test]
fn local_has_a_deadline_of_a_second_unless_it_is_set() {
    let second = Some(1000 * MS);
    assert_eq!(Local::<u64, u64>::blocking(|n, _| Ok(*n)).deadline, second);
    assert_eq!(Local::<u64, u64>::threads(2, || |n: &u64, _| Ok(*n)).deadline, second);
    assert_eq!(Local::<u64, u64>::future(|n, _| async move { Ok(*n) }).deadline, second);
}

/// Writes this many messages, each after the item of the previous one was read. Returns the
/// outcomes and the tally.
async fn real_time<F>(
    operator: ClosureOperator<F>,
    config: Config,
    len: usize,
) -> (Vec<String>, Tally)
where
    F: FnOnce(&mut Setup<u64, String>) -> Local<u64, String>,
{
    real_time_until(operator, config, |items| items.len() == len).await
}

/// Does the same, but until `is_over` accepts the outcomes.
async fn real_time_until<F>(
    operator: ClosureOperator<F>,
    config: Config,
    is_over: impl Fn(&[String]) -> bool,
) -> (Vec<String>, Tally)
where
    F: FnOnce(&mut Setup<u64, String>) -> Local<u64, String>,
{
    let (mut writer, input): (Writer<u64>, _) = stream(8);
    let (running, mut output): (Running, _) = spawn(operator, config, input).unwrap();
    let mut items = Vec::new();
    while !is_over(&items) {
        writer.write(items.len() as u64).unwrap();
        let item = output.read().await.unwrap();
        items.push(match &item.ending {
            Ending::Forwarded(forwarded) => forwarded.value.clone(),
            Ending::Missed => "missed".into(),
            other => panic!("{other:?}"),
        });
    }
    let tally = running.tally();
    drop(writer);
    running.stop();
    running.join().await.unwrap();
    (items, tally)
}
