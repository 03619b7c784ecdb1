//! A multi-threaded executor without an async runtime. One thread computes local, one thread for
//! each cloud returns its results, and one thread serves all timers. The thread that gets
//! `Forwarded` sends the output. Run it with `cargo run -p fuseline-threads --example executor`.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant as Clock};

use fuseline_core::{Cloud, Commit, Deadline, Instant, Priority, Timestamp};
use fuseline_threads::{Call, Message, Shared, ValueOwner};

const CLOUDS: usize = 2;
const WINDOW: usize = 16;
const FRAMES: u64 = 100;
const PERIOD: Duration = Duration::from_millis(5);
const DEADLINE: Deadline = Deadline::from_millis(25);

type Output = (Timestamp, &'static str);
type Frame<'a> = Message<'a, &'static str, CLOUDS, WINDOW>;
type Work<'a> = Call<'a, &'static str, CLOUDS, WINDOW>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let clouds = [1, 2].map(|p| Cloud::new(Priority::new(p), 31));
    let mut shared = Shared::new(WINDOW, Commit::Eager, &clouds)?;
    let intake = ValueOwner::new(&mut shared);
    let start = Clock::now();
    let (output, outputs) = channel();
    thread::scope(|scope| {
        // The milliseconds that each source usually takes; all of them are usually in time.
        let sources =
            [("local", 8), ("near cloud", 11), ("far cloud", 18)].map(|(name, millis)| {
                let (sender, work) = channel();
                let output = output.clone();
                scope.spawn(move || source(name, millis, work, start, &output));
                sender
            });
        let (timers, requests) = channel();
        scope.spawn(move || timer(&requests, start, &output));
        scope.spawn(move || owner(intake, start, &sources, &timers));

        let mut tally = BTreeMap::<&str, usize>::new();
        for (_, by) in outputs {
            *tally.entry(by).or_default() += 1;
        }
        println!("{FRAMES} frames: {tally:?}");
    });
    Ok(())
}

/// Opens each frame, sends it to all sources, and sets the timer for its due instant.
fn owner<'a>(
    mut intake: ValueOwner<'a, &'static str, CLOUDS, WINDOW>,
    start: Clock,
    sources: &[Sender<Work<'a>>; 3],
    timers: &Sender<(Instant, Frame<'a>)>,
) {
    for t in (0..FRAMES).map(Timestamp::new) {
        thread::sleep(PERIOD);
        let now = now(start);
        let (frame, local) = match intake.open(now, t, None) {
            Ok(opened) => opened,
            Err(why) => {
                println!("{t:?} is refused {why:?}");
                continue;
            }
        };
        for p in [1, 2] {
            // The frame was just opened, so no timer is due.
            let (_, call) = intake.offer(now, &frame, Priority::new(p), DEADLINE, 0);
            if let Ok((call, due)) = call {
                timers.send((due, frame.clone())).expect("the timer listens");
                sources[usize::from(p)].send(call).expect("the cloud listens");
            }
        }
        // Local is asked last, so that its result waits for the clouds' results.
        sources[0].send(local).expect("local listens");
    }
}

/// Computes each call in its usual time; every eighth call takes three times as long.
fn source(
    name: &'static str,
    millis: u64,
    work: Receiver<Work<'_>>,
    start: Clock,
    output: &Sender<Output>,
) {
    thread::scope(|scope| {
        for (number, call) in work.into_iter().enumerate() {
            let factor = if number % 8 == 7 { 3 } else { 1 };
            let output = output.clone();
            scope.spawn(move || {
                thread::sleep(Duration::from_millis(millis * factor));
                let t = call.timestamp();
                let reply = call.result(now(start), name);
                if let Some(value) = reply.forwarded {
                    output.send((t, value)).expect("main listens");
                }
            });
        }
    });
}

/// Runs the timer thread, which sleeps until the next due instant or the next request.
fn timer<'a>(requests: &Receiver<(Instant, Frame<'a>)>, start: Clock, output: &Sender<Output>) {
    let mut waiting: Vec<(Reverse<Instant>, Frame<'a>)> = Vec::new();
    let mut is_open = true;
    while is_open || !waiting.is_empty() {
        let now = now(start);
        while let Some((_, frame)) = waiting.pop_if(|(due, _)| due.0 <= now) {
            if let Some((firing, Some(value))) = frame.expire(now) {
                output.send((firing.timestamp, value)).expect("main listens");
            }
        }
        let next = waiting.last().map_or(u64::MAX, |(due, _)| due.0.as_nanos());
        let pause = Duration::from_nanos(next.saturating_sub(now.as_nanos()));
        match requests.recv_timeout(pause) {
            Ok((due, frame)) => {
                let at = waiting.partition_point(|(waits, _)| *waits <= Reverse(due));
                waiting.insert(at, (Reverse(due), frame));
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                is_open = false;
                thread::sleep(pause.min(PERIOD));
            }
        }
    }
}

fn now(start: Clock) -> Instant {
    Instant::from_nanos(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX))
}
