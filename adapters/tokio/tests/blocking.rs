//! An operator for programs without a runtime: [`BlockingOperator`].

use std::future::pending;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use fuseline_tokio::{
    BlockingOperator, Config, Ending, Lineage, Local, Recording, Setup, Trace, WriteError,
};
use fuseline_traces::judge;

use crate::support::ClosureOperator;

const MS: Duration = Duration::from_millis(1);

/// Local at once, and a cloud that answers at once.
fn with_cloud(setup: &mut Setup<u64, String>) -> Local<u64, String> {
    let handle = |n: u64, _| async move { Ok(n) };
    setup.use_cloud(handle, |n, _| Some((*n, 30_000 * MS)), |n| Ok(format!("cloud {n}")), 1);
    Local::blocking(|n, _| Ok(format!("local {n}")))
}

#[test]
fn one_thread_writes_and_another_reads_each_item_and_the_trace_conforms() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let trace = Some(Trace { path: path.clone(), recording: Recording::default() });
    let config = Config { trace, ..Config::default() };
    let operator = BlockingOperator::start(ClosureOperator(with_cloud), config).unwrap();
    let mut read = Vec::new();
    thread::scope(|scope| {
        scope.spawn(|| {
            for n in 0..200 {
                while let Err(WriteError::Full(_)) = operator.write(n) {
                    thread::yield_now();
                }
            }
            operator.close();
        });
        while let Some(item) = operator.read() {
            read.push(item.timestamp);
        }
    });
    let (unread, tally) = operator.finish().unwrap();
    read.sort_unstable();
    assert_eq!((read, unread.len()), ((0..200).collect(), 0));
    assert_eq!(tally.messages + tally.refused.values().sum::<u64>(), 200);
    let verdict = judge("trace", std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    assert!(verdict.unwrap().violations.is_empty());
}

#[test]
fn an_item_that_comes_after_the_limit_of_one_read_is_the_next_ones() {
    let (release, released) = mpsc::channel::<()>();
    let local = ClosureOperator(|_: &mut Setup<u64, String>| {
        let mut local = Local::blocking(move |n, _| {
            released.recv()?;
            Ok(format!("local {n}"))
        });
        local.deadline = None;
        local
    });
    let operator = BlockingOperator::start(local, Config::default()).unwrap();
    operator.write(7).unwrap();
    assert!(operator.read_within(MS).is_err());
    release.send(()).unwrap();
    let item = operator.read().unwrap();
    assert_eq!(item.forwarded().unwrap().value, "local 7");
}

#[test]
fn a_message_has_its_lineage() {
    let operator = BlockingOperator::start(ClosureOperator(with_cloud), Config::default()).unwrap();
    let lineage = Lineage::new("camera", 41, Instant::now());
    operator.write_with(7, std::sync::Arc::new(lineage)).unwrap();
    let item = operator.read().unwrap();
    let origin = item.lineage.as_ref().unwrap().origin.as_ref().unwrap();
    assert_eq!((&*origin.stream, origin.seq), ("camera", Some(41)));
}

#[test]
fn a_local_that_hangs_keeps_neither_the_items_nor_the_programs_end() {
    let (_hold, held) = mpsc::channel::<()>();
    let hangs = ClosureOperator(|_: &mut Setup<u64, String>| {
        let mut local = Local::blocking(move |_, _| {
            held.recv()?;
            Ok(String::new())
        });
        local.deadline = Some(50 * MS);
        local
    });
    let operator = BlockingOperator::start(hangs, Config::default()).unwrap();
    operator.write(0).unwrap();
    let (unread, tally) = operator.finish().unwrap();
    assert!(matches!(unread[0].ending, Ending::Missed));
    assert_eq!(tally.sources[0].lost, 1);
}

#[test]
fn a_stop_ends_the_items_although_a_message_is_open() {
    let never = ClosureOperator(|_: &mut Setup<u64, String>| {
        let mut local = Local::future(|_, _| pending());
        local.deadline = None;
        local
    });
    let operator = BlockingOperator::start(never, Config::default()).unwrap();
    operator.write(0).unwrap();
    operator.stop();
    assert!(operator.read().is_none());
}
