//! The simulated parts: sources that follow their acts, a camera, readers, a process that stands still.

use std::future::pending;
use std::panic::resume_unwind;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Policy, Situation};
use fuseline_tokio::deadline::{Chosen, End, Reason};
use fuseline_tokio::{Call, Error, Items, Local, Operator, Setup, Writer};
use tokio::task::yield_now;
use tokio::time::{advance, sleep, sleep_until};

use crate::simulate::log::{Seen, Stop, World};
use crate::simulate::scenario::{Act, Ask, How};
use crate::simulate::value::{Frame, Told, Value};

/// The operator whose sources do as the scenario says.
pub(crate) struct Script(pub(crate) Arc<World>);

type BoxFuture = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A call on its way, from its begin to the response handler.
struct Way {
    world: Arc<World>,
    /// Its place in the log.
    place: usize,
    told: Told,
    how: How,
}

/// How a call goes that asks nothing of the rules.
struct Beside(Arc<World>);

/// A policy as a remote has it.
struct Fixed {
    world: Arc<World>,
    p: u16,
    deadline: Duration,
    asked: u32,
}

impl Operator for Script {
    type Input = Frame;
    type Output = Value;

    fn setup(self, setup: &mut Setup<Frame, Value>) -> Local<Frame, Value> {
        let Self(world) = self;
        for (place, remote) in world.scenario.clouds.iter().copied().enumerate() {
            let (here, asking) = (Arc::clone(&world), Arc::clone(&world));
            let handle = move |(serial, act): (usize, Act), call: Call| {
                let left = Some(call.deadline);
                call.sent(1);
                let way = Way::begin(&here, (remote.p, call.timestamp, serial), left, act.how);
                travel(way, act)
            };
            let message_handler = move |frame: &Frame, t: u64| {
                asking.log().asked.push((remote.p, t));
                ask(frame.serial, asking.scenario.frames[frame.serial].asks[place])
            };
            let cloud = setup.use_cloud(handle, message_handler, Way::respond, remote.p);
            cloud.name = name(remote.p);
            (cloud.limit, cloud.resume, cloud.calls) = (remote.limit, remote.resume, remote.calls);
            cloud.linger = remote.linger;
            cloud.policy = remote.policy.map(|deadline| {
                let world = Arc::clone(&world);
                Box::new(Fixed { world, p: remote.p, deadline, asked: 0 }) as Box<dyn Policy + Send>
            });
        }
        if let Some((limit, calls)) = world.scenario.aside {
            beside(&world, setup, limit, calls);
        }
        if let Some(panics) = world.scenario.hints {
            let world = Arc::clone(&world);
            setup.use_hints(move |hint| {
                world.hear(&hint);
                if panics {
                    panic("the handler of hints panics");
                }
            });
        }
        let plan = world.scenario.local;
        let mut local = Local::futures(plan.at_once, move |frame: Arc<Frame>, t| {
            let act = world.scenario.frames[frame.serial].local;
            let way = Way::begin(&world, (0, t, frame.serial), None, act.how);
            if act.how == How::PanicsAtOnce {
                way.end(Stop::Failed);
                panic(&words(way.told));
            }
            async move {
                let value = travel(way, act).await.and_then(Way::respond);
                // Local has the message as long as it computes.
                drop(frame);
                value
            }
        });
        (local.deadline, local.waiting) = (plan.deadline, plan.waiting);
        local.skip_answered = plan.skip_answered;
        local
    }
}

/// The calls beside the rules.
fn beside(world: &Arc<World>, setup: &mut Setup<Frame, Value>, limit: u64, calls: usize) {
    let (handling, asking, answered) = (Arc::clone(world), Arc::clone(world), Arc::clone(world));
    let handle = move |(_, act): (usize, Act), _: Call| {
        let here = Beside::begin(&handling);
        async move {
            wait(act).await;
            let done = match act.how {
                How::Fails => Err("the aside fails".into()),
                How::Panics | How::PanicsAtOnce => panic("the aside panics"),
                How::Hangs | How::HangsAndPanics => pending().await,
                How::Answers | How::BadResponse | How::PanickingResponse => Ok(act.how),
            };
            drop(here);
            done
        }
    };
    let message_handler =
        move |frame: &Frame, _| ask(frame.serial, asking.scenario.frames[frame.serial].aside);
    let response_handler = move |how| {
        answered.log().asides[3] += 1;
        match how {
            How::PanickingResponse => panic("the response handler panics"),
            How::BadResponse => Err("the response handler refuses".into()),
            _ => Ok(()),
        }
    };
    let aside = setup.use_aside(handle, message_handler, response_handler);
    (aside.limit, aside.resume, aside.calls) = (limit, limit - 1, calls);
}

fn ask(serial: usize, ask: Ask) -> Option<((usize, Act), Duration)> {
    match ask {
        Ask::Nothing => None,
        Ask::Panics => panic("the message handler panics"),
        Ask::Offers(deadline, act) => Some(((serial, act), deadline)),
    }
}

/// To the response, if there is one.
async fn travel(mut way: Way, act: Act) -> Result<Way, Error> {
    if act.how == How::PanicsAtOnce {
        way.end(Stop::Failed);
        panic(&words(way.told));
    }
    wait(act).await;
    match act.how {
        How::Hangs | How::HangsAndPanics => pending().await,
        How::Fails => {
            way.end(Stop::Failed);
            Err(words(way.told).into())
        }
        How::Panics | How::PanicsAtOnce => {
            way.end(Stop::Failed);
            panic(&words(way.told))
        }
        How::Answers | How::BadResponse | How::PanickingResponse => {
            way.told.at = way.world.now();
            Ok(way)
        }
    }
}

async fn wait(act: Act) {
    turns(act.yields).await;
    if !act.after.is_zero() {
        sleep(act.after).await;
        turns(act.yields).await;
    }
}

async fn turns(count: u8) {
    for _ in 0..count {
        yield_now().await;
    }
}

impl Way {
    fn begin(
        world: &Arc<World>,
        (p, t, serial): (u16, u64, usize),
        left: Option<Duration>,
        how: How,
    ) -> Self {
        let begun = world.now();
        let mut log = world.log();
        log.calls.push(Seen { p, t, serial, begun, left, end: None });
        let place = log.calls.len() - 1;
        drop(log);
        Self { world: Arc::clone(world), place, told: Told { p, t, serial, at: begun }, how }
    }

    /// The response handler. The result counts as made when it is done.
    fn respond(self) -> Result<Value, Error> {
        match self.how {
            How::PanickingResponse => {
                self.end(Stop::Failed);
                panic(&words(self.told))
            }
            How::BadResponse => {
                self.end(Stop::Failed);
                Err(words(self.told).into())
            }
            _ => {
                self.end(Stop::Answered);
                Ok(Value::new(self.told, &self.world.values))
            }
        }
    }

    fn end(&self, stop: Stop) {
        let at = self.world.now();
        self.world.log().calls[self.place].end.get_or_insert((at, stop));
    }
}

impl Drop for Way {
    fn drop(&mut self) {
        self.end(Stop::Dropped);
        if self.how == How::HangsAndPanics && !std::thread::panicking() {
            panic("it panics when it is dropped");
        }
    }
}

impl Beside {
    fn begin(world: &Arc<World>) -> Self {
        let mut log = world.log();
        log.asides[0] += 1;
        log.asides[1] += 1;
        log.asides[2] = log.asides[2].max(log.asides[1]);
        drop(log);
        Self(Arc::clone(world))
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.0.log().asides[1] -= 1;
    }
}

impl Policy for Fixed {
    fn decide(&mut self, _: &Situation<'_>, _: Duration) -> Chosen {
        self.asked += 1;
        if self.deadline.is_zero() && self.asked.is_multiple_of(3) {
            panic("the policy panics");
        }
        let deadline = self.deadline.max(Duration::from_millis(1));
        Chosen { deadline, reason: Reason::Constant }
    }

    fn ended(&mut self, end: End) {
        self.world.log().ends.push((self.p, end));
        if self.deadline.is_zero() {
            panic("the policy panics");
        }
    }
}

/// Writes the messages, each at its time; one that finds no room is not taken in.
pub(crate) async fn camera(world: Arc<World>, mut writer: Writer<Frame>) {
    let mut at = Duration::ZERO;
    for (serial, message) in world.scenario.frames.iter().enumerate() {
        at += message.gap;
        if !message.gap.is_zero() {
            sleep_until(world.at(at)).await;
        }
        turns(message.yields).await;
        if let Ok(t) = writer.write(Frame::new(serial, &world.frames)) {
            let now = world.now();
            let mut log = world.log();
            // Timestamps count from 0.
            debug_assert_eq!(t, log.written.len() as u64);
            log.written.push((serial, now));
        }
    }
}

/// Reads items as the scenario's reader does; the first one lets the others join.
pub(crate) fn audience(world: Arc<World>, place: usize, items: Items<Value>) -> BoxFuture {
    Box::pin(listen(world, place, items))
}

async fn listen(world: Arc<World>, place: usize, mut items: Items<Value>) {
    let plan = world.scenario.readers[place];
    let mut count = 0;
    loop {
        if place == 0 {
            for (other, joining) in world.scenario.readers.iter().enumerate().skip(1) {
                if joining.joins_after == count {
                    tokio::spawn(audience(Arc::clone(&world), other, items.another()));
                }
            }
        }
        if plan.leaves_after == Some(count) {
            world.log().gone[place] = true;
            return;
        }
        if let Some((_, lag)) = plan.lag.filter(|(after, _)| *after == count) {
            sleep(lag).await;
        }
        let Some(item) = items.read().await else { return };
        world.read(place, &item);
        drop(item);
        count += 1;
        if !plan.pace.is_zero() {
            sleep(plan.pace).await;
        }
    }
}

/// Stands still now and then: the clock goes on, and nobody has a turn.
pub(crate) async fn stall(world: Arc<World>) {
    for (at, len) in &world.scenario.stalls {
        sleep_until(world.at(*at)).await;
        let from = world.now();
        let to = from + crate::simulate::log::nanos(*len);
        world.log().stalls.push((from, to));
        advance(*len).await;
    }
}

/// A cloud's name.
pub(crate) fn name(p: u16) -> String {
    format!("cloud {p}")
}

/// Why a source fails: its words name it and its message.
pub(crate) fn words(told: Told) -> String {
    format!("{} fails {} as message {}", told.p, told.t, told.serial)
}

/// A panic that prints nothing.
fn panic(words: &str) -> ! {
    resume_unwind(Box::new(words.to_owned()))
}
