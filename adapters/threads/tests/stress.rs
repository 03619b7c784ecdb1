//! Sends thousands of messages through the machine on real threads, with values. Each has one
//! ending, and no value is lost.
#![cfg(not(loom))]

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread;

use fuseline_core::{
    Cloud, Commit, Deadline, Firing, Instant, OpenRefusal, Outcome, Priority, Timestamp,
};
use fuseline_threads::{Call, CallOutcome, Message, Shared, ValueOwner};

const MESSAGES: u64 = 20_000;
const CLOUDS: usize = 2;
const WINDOW: usize = 4;

/// A value that knows its message and its source, and counts how many of its kind are alive.
struct Value<'a> {
    t: Timestamp,
    p: Priority,
    alive: &'a AtomicU32,
}

impl<'a> Value<'a> {
    fn new(t: Timestamp, p: Priority, alive: &'a AtomicU32) -> Self {
        alive.fetch_add(1, Ordering::Relaxed);
        Self { t, p, alive }
    }
}

impl Drop for Value<'_> {
    fn drop(&mut self) {
        self.alive.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The number of endings of each message, and the clock, which the owner moves.
struct Answers {
    clock: AtomicU64,
    forwarded: Vec<AtomicU32>,
    missed: Vec<AtomicU32>,
}

impl Answers {
    fn now(&self) -> Instant {
        Instant::from_nanos(self.clock.load(Ordering::Relaxed))
    }

    fn count(&self, t: Timestamp, outcome: &Outcome<CLOUDS>, value: Option<&Value>) {
        let t_index = usize::try_from(t.as_u64()).unwrap();
        match outcome {
            Outcome::Forwarded { by, .. } => {
                let value = value.expect("whoever forwards has a value");
                assert_eq!((value.t, value.p), (t, *by));
                self.forwarded[t_index].fetch_add(1, Ordering::Relaxed);
            }
            Outcome::Missed => drop(self.missed[t_index].fetch_add(1, Ordering::Relaxed)),
            Outcome::Preliminary { by, .. } => {
                let value = value.expect("whoever forwards has a value");
                assert_eq!((value.t, value.p), (t, *by));
            }
            Outcome::Final { .. } => {
                self.forwarded[t_index].fetch_add(1, Ordering::Relaxed);
            }
            Outcome::Dropped(_) | Outcome::Held | Outcome::Waiting => {}
        }
    }

    fn fired(&self, expired: Option<(Firing<CLOUDS>, Option<Value>)>) {
        if let Some((firing, value)) = expired {
            self.count(firing.timestamp, &firing.outcome, value.as_ref());
        }
    }

    fn reply(&self, t: Timestamp, reply: &CallOutcome<Value, CLOUDS>) {
        let is_dropped = matches!(reply.outcome, Outcome::Dropped(_));
        assert!(is_dropped || reply.unused.is_none());
        if let Some(firing) = &reply.fired {
            self.count(t, &firing.outcome, reply.forwarded.as_ref());
        }
        self.count(t, &reply.outcome, reply.forwarded.as_ref());
    }
}

type Calls<'a> = mpsc::Receiver<Call<'a, Value<'a>, CLOUDS, WINDOW>>;

/// Runs a source. Every third call fails, and every second one takes its time.
fn source<'a>(p: u16, calls: Calls<'a>, answers: &Answers, alive: &'a AtomicU32) {
    for (number, call) in (u64::from(p)..).zip(calls) {
        if number % 2 == 0 {
            thread::yield_now();
        }
        let (t, now) = (call.timestamp(), answers.now());
        let reply = if number % 3 == 0 {
            call.fail(now)
        } else {
            call.result(now, Value::new(t, Priority::new(p), alive))
        };
        answers.reply(t, &reply);
    }
}

/// Runs the timer for each message until none of its timers is armed.
fn timer<'a>(messages: mpsc::Receiver<Message<'a, Value<'a>, CLOUDS, WINDOW>>, answers: &Answers) {
    for message in messages {
        while message.next_due().is_some() {
            answers.fired(message.expire(answers.now()));
            thread::yield_now();
        }
    }
}

fn owner<'a>(
    mut intake: ValueOwner<'a, Value<'a>, CLOUDS, WINDOW>,
    sources: &[mpsc::Sender<Call<'a, Value<'a>, CLOUDS, WINDOW>>; 3],
    timers: &mpsc::Sender<Message<'a, Value<'a>, CLOUDS, WINDOW>>,
    answers: &Answers,
) {
    for t in (0..MESSAGES).map(Timestamp::new) {
        let deadline = Some(Deadline::from_nanos(12));
        let (message, local) = loop {
            answers.clock.fetch_add(1, Ordering::Relaxed);
            match intake.open(answers.now(), t, deadline) {
                Ok(opened) => break opened,
                Err(OpenRefusal::Full) => thread::yield_now(),
                Err(why) => panic!("{t:?} was refused {why:?}"),
            }
        };
        timers.send(message.clone()).unwrap();
        sources[0].send(local).unwrap();
        for p in [1, 2] {
            let deadline = Deadline::from_nanos(4 * u64::from(p));
            let cloud = Priority::new(p);
            let (fired, call) = intake.offer(answers.now(), &message, cloud, deadline, 0);
            answers.fired(fired);
            if let Ok((call, _)) = call {
                sources[usize::from(p)].send(call).unwrap();
            }
        }
    }
    answers.clock.store(u64::MAX, Ordering::Relaxed);
}

/// Each message is forwarded or missed once (P1, P11).
#[test]
fn p1_thousands_of_messages_are_each_answered_once() {
    for commit in [Commit::Eager, Commit::Patient, Commit::Progressive] {
        let alive = AtomicU32::new(0);
        let zeros = || (0..MESSAGES).map(|_| AtomicU32::new(0)).collect();
        let answers = Answers { clock: AtomicU64::new(0), forwarded: zeros(), missed: zeros() };
        let clouds = [1, 2].map(|p| Cloud::new(Priority::new(p), 1));
        let mut shared = Shared::new(WINDOW, commit, &clouds).unwrap();
        let intake = ValueOwner::new(&mut shared);
        thread::scope(|scope| {
            let (answers, alive) = (&answers, &alive);
            let (timers, messages) = mpsc::channel();
            scope.spawn(move || timer(messages, answers));
            let sources = [0, 1, 2].map(|p| {
                let (sender, calls) = mpsc::channel();
                scope.spawn(move || source(p, calls, answers, alive));
                sender
            });
            scope.spawn(move || owner(intake, &sources, &timers, answers));
        });
        let mut by_end = [0; 2];
        for (t, (forwarded, missed)) in answers.forwarded.iter().zip(&answers.missed).enumerate() {
            let ends = [forwarded, missed].map(|end| end.load(Ordering::Relaxed));
            assert_eq!(ends[0] + ends[1], 1, "message {t}: {ends:?} forwarded and missed");
            by_end = [by_end[0] + ends[0], by_end[1] + ends[1]];
        }
        assert!(by_end[0] > 0, "nothing was forwarded");
        println!("{commit:?}: forwarded and missed: {by_end:?}");
        assert_eq!(alive.load(Ordering::Relaxed), 0, "values are still alive");
    }
}
