//! [`Join`] combines several streams into one, aligned by the origin of their messages (E5, E6,
//! E7).
//!
//! The engine's [`Aligner`] decides which messages form a set and when it is given. This module has
//! the clock and the streams.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_engine::{
    Aligner, Ending, Item, JoinArrival, JoinBounds, JoinCause, JoinDropReason, Joined, Latency,
    LatestInput, Lineage, Reserve, lock,
};
use tokio::runtime::Handle;
use tokio::task::JoinHandle;
use tokio::time::{Instant, Sleep, sleep_until};
use tracing::{Instrument, debug, error, info_span};

use crate::items::Items;
use crate::operator::SpawnError;
use crate::outbox::Outbox;
use crate::panics::reason;
use crate::stream::{Reader, StreamMessage, stream};

/// Joins several streams. The messages that come from the same origin timestamp are put into one
/// `S`, which begins as its default.
///
/// ```
/// # use fuseline_tokio::{Join, JoinConfig, Lineage, stream};
/// # use std::time::{Duration, Instant};
/// # #[tokio::main(flavor = "current_thread")] async fn main() {
/// #[derive(Default)]
/// struct Frames { left: Option<u8>, right: Option<u8> }
///
/// let (mut left, left_frames) = stream(4);
/// let (mut right, right_frames) = stream(4);
/// let mut join = Join::new(JoinConfig { wait: Duration::from_millis(20), ..JoinConfig::default() });
/// join.aligned("left", left_frames, |frames: &mut Frames, frame, _| frames.left = Some(*frame));
/// join.aligned("right", right_frames, |frames, frame, _| frames.right = Some(*frame));
/// let (_running, mut sets) = join.spawn().unwrap();
/// left.write_with(1, Lineage::new("left", 7, Instant::now())).unwrap();
/// right.write_with(2, Lineage::new("right", 7, Instant::now())).unwrap();
/// let set = sets.read().await.unwrap();
/// assert_eq!((set.key, set.set.left, set.set.right), (7, Some(1), Some(2)));
/// # }
/// ```
pub struct Join<S> {
    config: JoinConfig,
    aligned: Vec<AlignedSource<S>>,
    latest: Vec<(LatestInput, LatestSource<S>)>,
    origin: Option<Arc<str>>,
    on_drop: Option<DropHandler>,
}

/// Configures how long, and for how many sets, a join waits.
#[derive(Clone, PartialEq, Debug)]
pub struct JoinConfig {
    /// The join's name in logs; `join` by default.
    pub name: String,
    /// The time that a set waits after its first message; 50 ms by default.
    pub wait: Duration,
    /// The number of sets that may wait; 16 by default. If another one begins, the oldest is given
    /// incomplete.
    pub window: usize,
    /// The latencies of the operators downstream; none by default. A set is given at the latest
    /// when only the time that they need on board is left of an end-to-end deadline.
    pub reserve: Vec<Latency>,
    /// The number of sets that a reader may lag behind; at least 1, 16 by default. While a reader
    /// lags further behind, no message is accepted.
    pub output_len: usize,
}

/// A message that a join did not use.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct JoinDrop {
    /// The name of the input.
    pub input: Arc<str>,
    /// The key by which the message would have been joined.
    pub key: Option<u64>,
    /// The reason why it was not joined.
    pub why: JoinDropReason,
}

/// A join that was started. Dropping this handle leaves the join running. The join ends after its
/// aligned inputs.
#[derive(Debug)]
pub struct RunningJoin {
    task: JoinHandle<()>,
    tally: Arc<Mutex<JoinTally>>,
}

/// The counts of a join.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct JoinTally {
    /// The sets that were given, by cause.
    pub given: BTreeMap<JoinCause, u64>,
    /// The sets that lacked an input, by input.
    pub missing: BTreeMap<Arc<str>, u64>,
    /// The messages that were dropped, by input and reason.
    pub dropped: BTreeMap<(Arc<str>, JoinDropReason), u64>,
}

type DropHandler = Box<dyn FnMut(&JoinDrop) + Send>;
type PollAligned<S> = Box<dyn FnMut(&mut Context<'_>) -> Poll<Option<AlignedMessage<S>>> + Send>;
type PollLatest<S> = Box<dyn FnMut(&mut Context<'_>) -> Poll<Option<LatestValue<S>>> + Send>;

struct AlignedSource<S> {
    name: Arc<str>,
    poll: PollAligned<S>,
    is_open: bool,
}

struct AlignedMessage<S> {
    key: Option<u64>,
    lineage: Option<Arc<Lineage>>,
    is_last: bool,
    put: Box<dyn FnOnce(&mut S) + Send>,
}

struct LatestSource<S> {
    poll: PollLatest<S>,
    is_open: bool,
}

struct LatestValue<S> {
    lineage: Option<Arc<Lineage>>,
    put: Box<dyn Fn(&mut S) + Send + Sync>,
}

struct JoinTask<S> {
    aligner: Aligner<S>,
    aligned: Vec<AlignedSource<S>>,
    latest: Vec<LatestSource<S>>,
    on_drop: Option<DropHandler>,
    reserve: Vec<Latency>,
    output: Outbox<Joined<S>>,
    tally: Arc<Mutex<JoinTally>>,
    timer: Pin<Box<Sleep>>,
    /// The index of the aligned input whose turn it is.
    turn: usize,
}

impl Default for JoinConfig {
    fn default() -> Self {
        let (wait, window, output_len) = (Duration::from_millis(50), 16, 16);
        Self { name: "join".into(), wait, window, reserve: Vec::new(), output_len }
    }
}

impl<S: Default + Send + Sync + 'static> Join<S> {
    /// Creates a join without inputs.
    #[must_use]
    pub const fn new(config: JoinConfig) -> Self {
        Self { config, aligned: Vec::new(), latest: Vec::new(), origin: None, on_drop: None }
    }

    /// Adds an input whose messages are aligned by the [timestamp of their
    /// origin](crate::Origin::seq), because sensors that are triggered together give their
    /// messages the same numbers. A message without that timestamp is dropped.
    ///
    /// `put` puts a message into its set, and must not block.
    pub fn aligned<T: Send + Sync + 'static>(
        &mut self,
        name: impl Into<Arc<str>>,
        input: Reader<T>,
        put: impl Fn(&mut S, Arc<T>, Option<&Lineage>) + Send + Sync + 'static,
    ) -> &mut Self {
        self.aligned_by(name, input, |_, lineage| lineage?.origin.as_ref()?.seq, put)
    }

    /// Adds an input whose messages are aligned by a key of your own. A key whose set was given
    /// never opens another set.
    pub fn aligned_by<T: Send + Sync + 'static>(
        &mut self,
        name: impl Into<Arc<str>>,
        mut input: Reader<T>,
        key: impl Fn(&T, Option<&Lineage>) -> Option<u64> + Send + 'static,
        put: impl Fn(&mut S, Arc<T>, Option<&Lineage>) + Send + Sync + 'static,
    ) -> &mut Self {
        let put = Arc::new(put);
        let poll = move |context: &mut Context<'_>| {
            let polled = input.poll_numbered(context);
            polled.map(|message| {
                let StreamMessage { message, lineage, .. } = message?;
                let key = key(&message, lineage.as_deref());
                let (put, of) = (Arc::clone(&put), lineage.clone());
                let put = Box::new(move |set: &mut S| put(set, message, of.as_deref()));
                Some(AlignedMessage { key, lineage, is_last: true, put })
            })
        };
        self.add(name.into(), Box::new(poll))
    }

    /// Adds an input that is an operator's output, aligned by the timestamp of its origin. A
    /// message that was missed counts as present.
    ///
    /// If a message has several items, the set has the last one, or the last one so far if the set
    /// is due. `put` is called with each item except a [final](crate::Ending::Final) one.
    pub fn items<O: Send + Sync + 'static>(
        &mut self,
        name: impl Into<Arc<str>>,
        mut input: Items<O>,
        put: impl Fn(&mut S, Arc<Item<O>>) + Send + Sync + 'static,
    ) -> &mut Self {
        let put = Arc::new(put);
        let poll = move |context: &mut Context<'_>| {
            let polled = input.poll_numbered(context);
            polled.map(|message| {
                let StreamMessage { message: item, lineage, .. } = message?;
                let key = lineage.as_ref().and_then(|it| it.origin.as_ref()?.seq);
                let (is_last, put) = (item.is_last(), Arc::clone(&put));
                let put = Box::new(move |set: &mut S| {
                    // The set already has the value.
                    if !matches!(item.ending, Ending::Final(_)) {
                        put(set, item);
                    }
                });
                Some(AlignedMessage { key, lineage, is_last, put })
            })
        };
        self.add(name.into(), Box::new(poll))
    }

    /// Adds an input that gives each set its latest message, such as the vehicle's position. No set
    /// waits for this input. If that message is older than `max_age`, counted from its capture or
    /// otherwise from its arrival, the input is missing.
    pub fn latest<T: Send + Sync + 'static>(
        &mut self,
        name: impl Into<Arc<str>>,
        input: Reader<T>,
        max_age: Duration,
        put: impl Fn(&mut S, Arc<T>, Option<&Lineage>) + Send + Sync + 'static,
    ) -> &mut Self {
        self.add_latest(name.into(), input, max_age, |_| true, put)
    }

    /// Adds an operator's output as an input that gives each set its latest item. A
    /// [final](crate::Ending::Final) item is skipped, because its value came before.
    pub fn latest_items<O: Send + Sync + 'static>(
        &mut self,
        name: impl Into<Arc<str>>,
        input: Items<O>,
        max_age: Duration,
        put: impl Fn(&mut S, Arc<Item<O>>) + Send + Sync + 'static,
    ) -> &mut Self {
        let has_value = |item: &Item<O>| !matches!(item.ending, Ending::Final(_));
        self.add_latest(name.into(), input, max_age, has_value, move |set, item, _| put(set, item))
    }

    /// Declares that each set belongs to the message of this [`latest`](Self::latest) input, if
    /// that message is present. The set's lineage then has the message's origin and capture. The
    /// aligned inputs still determine when its end-to-end deadline is due. So a control command
    /// belongs to the frame behind its plan, and is as old as that frame.
    pub fn origin_of(&mut self, latest: impl Into<Arc<str>>) -> &mut Self {
        self.origin = Some(latest.into());
        self
    }

    /// Sets the function that is called with each message that is dropped. It must not block.
    pub fn on_drop(&mut self, on_drop: impl FnMut(&JoinDrop) + Send + 'static) -> &mut Self {
        self.on_drop = Some(Box::new(on_drop));
        self
    }

    /// Starts the join on the current runtime. Returns the running join, and its sets in the order
    /// in which they are complete or due.
    ///
    /// # Errors
    /// Returns [`NoRuntime`](SpawnError::NoRuntime), [`NoOutput`](SpawnError::NoOutput) or
    /// [`NoInput`](SpawnError::NoInput).
    pub fn spawn(mut self) -> Result<(RunningJoin, Reader<Joined<S>>), SpawnError> {
        let runtime = Handle::try_current().map_err(|_| SpawnError::NoRuntime)?;
        let JoinConfig { name, wait, window, reserve, output_len } = self.config;
        if output_len == 0 {
            return Err(SpawnError::NoOutput);
        }
        if let Some(origin) = self.origin {
            let input = self.latest.iter_mut().map(|(input, _)| input).find(|it| it.name == origin);
            input.ok_or(SpawnError::NoInput { name: origin.to_string() })?.is_origin = true;
        }
        let bounds = JoinBounds { wait, window, reserve: Duration::ZERO };
        let names = self.aligned.iter().map(|input| Arc::clone(&input.name));
        let (latest_inputs, latest): (Vec<_>, Vec<_>) = self.latest.into_iter().unzip();
        let (writer, sets) = stream(output_len);
        let tally = Arc::<Mutex<JoinTally>>::default();
        let task = JoinTask {
            aligner: Aligner::new(names, bounds).with_latest(latest_inputs),
            aligned: self.aligned,
            latest,
            on_drop: self.on_drop,
            reserve,
            output: Outbox::new(writer, |joined: &Joined<S>| joined.lineage.clone()),
            tally: Arc::clone(&tally),
            timer: Box::pin(sleep_until(Instant::now())),
            turn: 0,
        };
        let task = runtime.spawn(task.run().instrument(info_span!("join", name)));
        Ok((RunningJoin { task, tally }, sets))
    }

    fn add(&mut self, name: Arc<str>, poll: PollAligned<S>) -> &mut Self {
        self.aligned.push(AlignedSource { name, poll, is_open: true });
        self
    }

    fn add_latest<T: Send + Sync + 'static>(
        &mut self,
        name: Arc<str>,
        mut input: Reader<T>,
        max_age: Duration,
        is_wanted: impl Fn(&T) -> bool + Send + 'static,
        put: impl Fn(&mut S, Arc<T>, Option<&Lineage>) + Send + Sync + 'static,
    ) -> &mut Self {
        let put = Arc::new(put);
        let poll = move |context: &mut Context<'_>| loop {
            let polled = input.poll_numbered(context);
            if matches!(&polled, Poll::Ready(Some(it)) if !is_wanted(&it.message)) {
                continue;
            }
            return polled.map(|message| {
                let StreamMessage { message, lineage, .. } = message?;
                let (put, of) = (Arc::clone(&put), lineage.clone());
                let put = move |set: &mut S| {
                    guarded(|| put(set, Arc::clone(&message), of.as_deref()));
                };
                Some(LatestValue { lineage, put: Box::new(put) })
            });
        };
        let source = LatestSource { poll: Box::new(poll), is_open: true };
        self.latest.push((LatestInput { name, max_age, is_origin: false }, source));
        self
    }
}

impl RunningJoin {
    /// Returns the counts so far.
    #[must_use]
    pub fn tally(&self) -> JoinTally {
        lock(&self.tally).clone()
    }

    /// Waits until the aligned inputs have ended and every set was given, and returns the counts.
    pub async fn join(self) -> JoinTally {
        // The task fails only if the runtime was shut down, which ends the join too.
        let _ = self.task.await;
        let tally = lock(&self.tally);
        tally.clone()
    }
}

impl<S: Default + Send + Sync + 'static> JoinTask<S> {
    async fn run(mut self) {
        loop {
            self.give();
            let is_over = self.aligner.is_over();
            if is_over && self.output.is_delivered() {
                return;
            }
            poll_fn(|context| self.poll_event(context, is_over)).await;
        }
    }

    /// Accepts one message, or sends the sets that are due. While a reader lags, it does neither.
    fn poll_event(&mut self, context: &mut Context<'_>, is_over: bool) -> Poll<()> {
        let was_waiting = !self.output.is_delivered();
        if self.output.poll_delivered(context).is_pending() {
            return Poll::Pending;
        }
        if is_over || was_waiting {
            return Poll::Ready(());
        }
        for (index, latest) in self.latest.iter_mut().enumerate() {
            while latest.is_open
                && let Poll::Ready(value) = (latest.poll)(context)
            {
                match value {
                    Some(LatestValue { lineage, put }) => {
                        self.aligner.set_latest(now(), index, lineage, put);
                    }
                    None => latest.is_open = false,
                }
            }
        }
        for _ in 0..self.aligned.len() {
            let index = self.turn;
            self.turn = (index + 1) % self.aligned.len();
            let source = &mut self.aligned[index];
            if source.is_open
                && let Poll::Ready(message) = (source.poll)(context)
            {
                self.arrived(index, message);
                return Poll::Ready(());
            }
        }
        let Some(due) = self.aligner.next_due() else { return Poll::Pending };
        self.timer.as_mut().reset(due.into());
        self.timer.as_mut().poll(context).map(|()| self.aligner.tick(now()))
    }

    fn arrived(&mut self, index: usize, message: Option<AlignedMessage<S>>) {
        let now = now();
        let Some(AlignedMessage { key, lineage, is_last, put }) = message else {
            self.aligned[index].is_open = false;
            self.aligner.end(now, index);
            return;
        };
        let reserve: Reserve = self.reserve.iter().sum();
        self.aligner.set_reserve(reserve.on_board());
        let lineage = lineage.as_ref();
        let arrival = JoinArrival { input: index, key, lineage, is_last };
        let joined = self.aligner.arrive(now, arrival, |set| guarded(|| put(set)));
        let Err(why) = joined else { return };
        let dropped = JoinDrop { input: Arc::clone(&self.aligned[index].name), key, why };
        debug!(input = &*dropped.input, key, ?why, "message dropped");
        self.count(|tally| {
            *tally.dropped.entry((Arc::clone(&dropped.input), why)).or_default() += 1;
        });
        if let Some(on_drop) = &mut self.on_drop {
            guarded(|| on_drop(&dropped));
        }
    }

    /// Sends the sets that are given.
    fn give(&mut self) {
        while let Some(joined) = self.aligner.next_set(Instant::now()) {
            self.count(|tally| {
                *tally.given.entry(joined.cause).or_default() += 1;
                for missing in &joined.missing {
                    *tally.missing.entry(Arc::clone(missing)).or_default() += 1;
                }
            });
            self.output.push(joined);
        }
    }

    fn count(&self, count: impl FnOnce(&mut JoinTally)) {
        count(&mut lock(&self.tally));
    }
}

fn now() -> std::time::Instant {
    Instant::now().into_std()
}

/// Calls a handler. A panic in it costs its own message only (D7).
fn guarded(handler: impl FnOnce()) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(handler)) {
        error!(why = reason(&*panic), "a handler of the join panicked");
    }
}
