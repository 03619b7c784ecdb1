//! One operator with local and two clouds, and a hand-written `select!` for the same three sources.
//! The bench `adapter` times them, and the binary `messages` runs them to count instructions.

use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

use fuseline_tokio::{Config, Error, Items, Local, Operator, Setup, Writer, spawn, stream};
use futures_util::task::AtomicWaker;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc;
use tokio::task::yield_now;
use tokio::time::{interval, sleep};

/// Long enough that no timer fires.
const LONG: Duration = Duration::from_secs(10);

/// States how a bench's sources take their time; local's first, then the clouds'.
#[derive(Clone, Copy)]
pub struct Pace {
    /// Its row of the table.
    pub name: &'static str,
    /// The number of messages that a turn has.
    pub messages: u64,
    /// The time from one message to the next, or `None` if each waits for the previous answer.
    period: Option<Duration>,
    /// The operator's window.
    window: u16,
    sources: [Take; 3],
}

/// The way in which a source takes its time.
#[derive(Clone, Copy)]
enum Take {
    /// Waits for this many rounds of the runtime.
    Rounds(u32),
    Sleeps(Duration),
}

/// One message after the other, of sources that need the runtime alone.
pub const BACK_TO_BACK: Pace = Pace {
    name: "back to back",
    messages: 20_000,
    period: None,
    window: 16,
    sources: [Take::Rounds(1), Take::Rounds(2), Take::Rounds(3)],
};

/// A message each 5 ms.
pub const PACED: Pace = Pace {
    name: "200 Hz, sources of 5, 10 and 20 ms",
    messages: 200,
    period: Some(Duration::from_millis(5)),
    // A host that stalls must not make the operator refuse anything.
    window: 128,
    sources: [
        Take::Sleeps(Duration::from_millis(5)),
        Take::Sleeps(Duration::from_millis(10)),
        Take::Sleeps(Duration::from_millis(20)),
    ],
};

/// Makes the runtime that both sides run on.
///
/// # Panics
/// If the system refuses it.
#[must_use]
pub fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().expect("a runtime")
}

async fn source(take: Take, value: u64) -> u64 {
    match take {
        Take::Rounds(remaining) => Rounds { remaining, alarm: None }.await,
        Take::Sleeps(time) => sleep(time).await,
    }
    value
}

/// Ready once the runtime has woken it this many times. Extra polls do not help it, unlike
/// `yield_now` and like an answer from a network. `select!` polls all sources whenever one of them
/// is ready.
struct Rounds {
    remaining: u32,
    alarm: Option<Arc<Alarm>>,
}

struct Alarm {
    is_woken: AtomicBool,
    task: AtomicWaker,
}

impl Future for Rounds {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        let alarm = Arc::clone(self.alarm.get_or_insert_with(|| {
            Arc::new(Alarm { is_woken: AtomicBool::new(true), task: AtomicWaker::new() })
        }));
        alarm.task.register(context.waker());
        if !alarm.is_woken.swap(false, Ordering::AcqRel) {
            return Poll::Pending;
        }
        if self.remaining == 0 {
            return Poll::Ready(());
        }
        self.remaining -= 1;
        let waker = Waker::from(alarm);
        pin!(yield_now()).poll(&mut Context::from_waker(&waker))
    }
}

impl Wake for Alarm {
    fn wake(self: Arc<Self>) {
        self.is_woken.store(true, Ordering::Release);
        self.task.wake();
    }
}

/// An operator with three sources, of which the best is always in time.
struct Fused(Pace);

impl Operator for Fused {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        let [local, clouds @ ..] = self.0.sources;
        for (priority, take) in (1..).zip(clouds) {
            let handle = move |value, _| async move { Ok(source(take, value).await) };
            let response_handler = move |value| Ok(value + u64::from(priority));
            let send = |message: &u64, _| Some((*message, LONG));
            // This has the same reason as the window.
            setup.use_cloud(handle, send, response_handler, priority).calls = 128;
        }
        Local::futures(1024, move |message: Arc<u64>, _| async move {
            Ok::<_, Error>(source(local, *message).await)
        })
    }
}

/// By an operator.
///
/// # Panics
/// If a message is answered by another than the best source.
pub async fn with_adapter(pace: Pace) {
    let (mut writer, input) = stream(1024);
    let config = Config { window: pace.window, output_len: 1024, ..Config::default() };
    let (_, mut output) = spawn(Fused(pace), config, input).expect("it is configured");
    let mut sum = 0;
    match pace.period {
        None => {
            for t in 0..pace.messages {
                writer.write(t).expect("the operator reads");
                sum += best(&mut output).await;
            }
        }
        Some(period) => {
            let feeder = tokio::spawn(feed(writer, pace.messages, period));
            for _ in 0..pace.messages {
                sum += best(&mut output).await;
            }
            feeder.await.expect("it does not panic");
        }
    }
    assert_best(pace, sum);
}

async fn best(output: &mut Items<u64>) -> u64 {
    let item = output.read().await.expect("an item for each message");
    item.forwarded().expect("sources do not fail").value
}

async fn feed(mut writer: Writer<u64>, messages: u64, period: Duration) {
    let mut ticks = interval(period);
    for t in 0..messages {
        ticks.tick().await;
        writer.write(t).expect("the operator reads");
    }
}

/// By hand.
///
/// # Panics
/// As [`with_adapter`].
pub async fn with_select(pace: Pace) {
    let (sender, mut output) = mpsc::channel(1024);
    let mut sum = 0;
    match pace.period {
        None => {
            for t in 0..pace.messages {
                tokio::spawn(by_hand(pace.sources, t, sender.clone()));
                sum += output.recv().await.expect("an answer for each message");
            }
        }
        Some(period) => {
            let feeder = tokio::spawn(async move {
                let mut ticks = interval(period);
                for t in 0..pace.messages {
                    ticks.tick().await;
                    tokio::spawn(by_hand(pace.sources, t, sender.clone()));
                }
            });
            for _ in 0..pace.messages {
                sum += output.recv().await.expect("an answer for each message");
            }
            feeder.await.expect("it does not panic");
        }
    }
    assert_best(pace, sum);
}

/// Handles one message as one would without the library: one task, one deadline for both clouds,
/// and no window, queue, gate, count, trace or reason.
async fn by_hand(sources: [Take; 3], message: u64, output: mpsc::Sender<u64>) {
    let [local, one, two] = sources;
    let mut local = pin!(source(local, message));
    let mut one = pin!(source(one, message + 1));
    let mut two = pin!(source(two, message + 2));
    let mut timer = pin!(sleep(LONG));
    let (mut has_local, mut has_one, mut best) = (false, false, None);
    let answer = loop {
        tokio::select! {
            value = &mut two => break value,
            value = &mut one, if !has_one => {
                has_one = true;
                best = Some(value);
            }
            value = &mut local, if !has_local => {
                has_local = true;
                best = best.or(Some(value));
            }
            () = &mut timer, if best.is_some() => break best.unwrap_or_default(),
        }
    };
    output.send(answer).await.expect("somebody waits for it");
}

/// Checks that the best source, which adds 2, answered every message.
fn assert_best(pace: Pace, sum: u64) {
    let expected: u64 = (0..pace.messages).map(|message| message + 2).sum();
    assert_eq!(sum, expected);
}
