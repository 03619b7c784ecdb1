//! The simulated parts around the operator: sources that follow the scenario, a camera, readers,
//! and a process that stalls.
//!
//! They write their observations into the log, and judge nothing.

use std::future::pending;
use std::panic::resume_unwind;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Policy, Situation};
use fuseline_tokio::deadline::{Chosen, End, LinkDirection, Reason};
use fuseline_tokio::{Call, Error, Items, Local, Operator, Setup, Writer};
use fuseline_traces::nanos;
use tokio::task::yield_now;
use tokio::time::{advance, sleep, sleep_until};

use crate::simulate::log::{CallStop, LoggedCall, SimulationState};
use crate::simulate::scenario::{CallResult, OfferAction, SourceAction};
use crate::simulate::value::{Frame, ResultValue, ValueLabel};

/// The operator, whose sources follow the scenario.
pub(crate) struct Script(pub(crate) Arc<SimulationState>);

type BoxFuture = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A call on its way, from its beginning to the response handler.
struct CallInProgress {
    simulation: Arc<SimulationState>,
    /// Its index in the log.
    index: usize,
    reported: ValueLabel,
    result: CallResult,
}

/// A side request, which the rules do not know.
struct ExtraCall(Arc<SimulationState>);

/// A cloud's policy, with one deadline.
struct FixedPolicy {
    simulation: Arc<SimulationState>,
    p: u16,
    deadline: Duration,
    requested: u32,
}

impl Operator for Script {
    type Input = Frame;
    type Output = ResultValue;

    fn setup(self, setup: &mut Setup<Frame, ResultValue>) -> Local<Frame, ResultValue> {
        let Self(simulation) = self;
        for (index, remote) in simulation.scenario.clouds.iter().copied().enumerate() {
            let (here, asking) = (Arc::clone(&simulation), Arc::clone(&simulation));
            let handle = move |(serial, act): (usize, SourceAction), call: Call| {
                let time_left = Some(call.deadline);
                call.sent(1);
                let call_in_progress = CallInProgress::begin(
                    &here,
                    (remote.p, call.timestamp, serial),
                    time_left,
                    act.result,
                );
                travel(call_in_progress, act)
            };
            let message_handler = move |frame: &Frame, t: u64| {
                asking.log().requested.push((remote.p, t));
                requested_action(frame.serial, asking.scenario.frames[frame.serial].offers[index])
            };
            let cloud = setup.use_cloud(handle, message_handler, CallInProgress::respond, remote.p);
            cloud.name = name(remote.p);
            (cloud.limit, cloud.resume, cloud.calls) =
                (Some(remote.limit), remote.resume, remote.calls);
            cloud.linger = remote.linger;
            cloud.policy = remote.policy.map(|deadline| {
                let simulation = Arc::clone(&simulation);
                Box::new(FixedPolicy { simulation, p: remote.p, deadline, requested: 0 })
                    as Box<dyn Policy + Send>
            });
        }
        if let Some((limit, calls)) = simulation.scenario.side {
            beside(&simulation, setup, limit, calls);
        }
        if let Some(panics) = simulation.scenario.hints {
            let simulation = Arc::clone(&simulation);
            setup.on_late_result(move |hint| {
                simulation.record_hint(&hint);
                if panics {
                    panic("the handler of hints panics");
                }
            });
        }
        let plan = simulation.scenario.local;
        let mut local = Local::futures(plan.at_once, move |frame: Arc<Frame>, t| {
            let act = simulation.scenario.frames[frame.serial].local;
            let call_in_progress =
                CallInProgress::begin(&simulation, (0, t, frame.serial), None, act.result);
            if act.result == CallResult::PanicsAtOnce {
                call_in_progress.end(CallStop::Failed);
                panic(&failure_text(call_in_progress.reported));
            }
            async move {
                let value = travel(call_in_progress, act).await.and_then(CallInProgress::respond);
                // Local keeps the message while it computes.
                drop(frame);
                value
            }
        });
        (local.deadline, local.waiting) = (plan.deadline, plan.waiting);
        local.skip_answered = plan.skip_answered;
        local
    }
}

/// Makes the side requests.
fn beside(
    simulation: &Arc<SimulationState>,
    setup: &mut Setup<Frame, ResultValue>,
    limit: u64,
    calls: usize,
) {
    let (handling, asking, answered) =
        (Arc::clone(simulation), Arc::clone(simulation), Arc::clone(simulation));
    let handle = move |(_, act): (usize, SourceAction), _: Call| {
        let here = ExtraCall::begin(&handling);
        let link = Arc::clone(&handling);
        async move {
            if !link.pass(LinkDirection::Uplink).await {
                return Err("the link has no room".into());
            }
            wait(act).await;
            let done = match act.result {
                CallResult::Fails => Err("the side request fails".into()),
                CallResult::Panics | CallResult::PanicsAtOnce => panic("the side request panics"),
                CallResult::Hangs | CallResult::HangsAndPanics => pending().await,
                CallResult::Answers | CallResult::BadResponse | CallResult::PanickingResponse => {
                    if !link.pass(LinkDirection::Downlink).await {
                        pending::<()>().await;
                    }
                    Ok(act.result)
                }
            };
            drop(here);
            done
        }
    };
    let message_handler = move |frame: &Frame, _| {
        requested_action(frame.serial, asking.scenario.frames[frame.serial].side)
    };
    let response_handler = move |result| {
        answered.log().sides[3] += 1;
        match result {
            CallResult::PanickingResponse => panic("the response handler panics"),
            CallResult::BadResponse => Err("the response handler refuses".into()),
            _ => Ok(()),
        }
    };
    let side = setup.use_side_request(handle, message_handler, response_handler);
    (side.limit, side.resume, side.calls) = (limit, limit - 1, calls);
}

fn requested_action(
    serial: usize,
    offer: OfferAction,
) -> Option<((usize, SourceAction), Duration)> {
    match offer {
        OfferAction::Nothing => None,
        OfferAction::Panics => panic("the message handler panics"),
        OfferAction::Offers(deadline, act) => Some(((serial, act), deadline)),
    }
}

/// Plays a call up to its response, if there is one.
async fn travel(
    mut call_in_progress: CallInProgress,
    act: SourceAction,
) -> Result<CallInProgress, Error> {
    if act.result == CallResult::PanicsAtOnce {
        call_in_progress.end(CallStop::Failed);
        panic(&failure_text(call_in_progress.reported));
    }
    let is_remote = call_in_progress.reported.p > 0;
    let simulation = Arc::clone(&call_in_progress.simulation);
    if is_remote && !simulation.pass(LinkDirection::Uplink).await {
        simulation.log().calls[call_in_progress.index].has_no_room = true;
        // The source is not reached, so it takes no action of its own.
        call_in_progress.result = CallResult::Fails;
        call_in_progress.end(CallStop::Failed);
        return Err(failure_text(call_in_progress.reported).into());
    }
    wait(act).await;
    match act.result {
        CallResult::Hangs | CallResult::HangsAndPanics => pending().await,
        CallResult::Fails => {
            call_in_progress.end(CallStop::Failed);
            Err(failure_text(call_in_progress.reported).into())
        }
        CallResult::Panics | CallResult::PanicsAtOnce => {
            call_in_progress.end(CallStop::Failed);
            panic(&failure_text(call_in_progress.reported))
        }
        CallResult::Answers | CallResult::BadResponse | CallResult::PanickingResponse => {
            if is_remote && !simulation.pass(LinkDirection::Downlink).await {
                pending::<()>().await;
            }
            call_in_progress.reported.at = simulation.now();
            Ok(call_in_progress)
        }
    }
}

async fn wait(act: SourceAction) {
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

impl CallInProgress {
    fn begin(
        simulation: &Arc<SimulationState>,
        (p, t, serial): (u16, u64, usize),
        time_left: Option<Duration>,
        result: CallResult,
    ) -> Self {
        let begun = simulation.now();
        let mut log = simulation.log();
        log.calls.push(LoggedCall {
            p,
            t,
            serial,
            begun,
            time_left,
            has_no_room: false,
            end: None,
        });
        let index = log.calls.len() - 1;
        drop(log);
        Self {
            simulation: Arc::clone(simulation),
            index,
            reported: ValueLabel { p, t, serial, at: begun },
            result,
        }
    }

    /// Plays the response handler. The result counts as made when it is done.
    fn respond(self) -> Result<ResultValue, Error> {
        match self.result {
            CallResult::PanickingResponse => {
                self.end(CallStop::Failed);
                panic(&failure_text(self.reported))
            }
            CallResult::BadResponse => {
                self.end(CallStop::Failed);
                Err(failure_text(self.reported).into())
            }
            _ => {
                self.end(CallStop::Answered);
                Ok(ResultValue::new(self.reported, &self.simulation.values))
            }
        }
    }

    fn end(&self, stop: CallStop) {
        let at = self.simulation.now();
        self.simulation.log().calls[self.index].end.get_or_insert((at, stop));
    }
}

impl Drop for CallInProgress {
    fn drop(&mut self) {
        self.end(CallStop::DroppedResult);
        if self.result == CallResult::HangsAndPanics && !std::thread::panicking() {
            panic("it panics when it is dropped");
        }
    }
}

impl ExtraCall {
    fn begin(simulation: &Arc<SimulationState>) -> Self {
        let mut log = simulation.log();
        log.sides[0] += 1;
        log.sides[1] += 1;
        log.sides[2] = log.sides[2].max(log.sides[1]);
        drop(log);
        Self(Arc::clone(simulation))
    }
}

impl Drop for ExtraCall {
    fn drop(&mut self) {
        self.0.log().sides[1] -= 1;
    }
}

impl Policy for FixedPolicy {
    fn decide(&mut self, _: &Situation<'_>, _: Duration) -> Chosen {
        self.requested += 1;
        if self.deadline.is_zero() && self.requested.is_multiple_of(3) {
            panic("the policy panics");
        }
        let deadline = self.deadline.max(Duration::from_millis(1));
        Chosen { deadline, reason: Reason::Constant }
    }

    fn ended(&mut self, end: End) {
        self.simulation.log().ends.push((self.p, end));
        if self.deadline.is_zero() {
            panic("the policy panics");
        }
    }
}

/// Writes the messages, each at its time. A message that finds no room is not accepted.
pub(crate) async fn camera(simulation: Arc<SimulationState>, mut writer: Writer<Frame>) {
    let mut at = Duration::ZERO;
    for (serial, message) in simulation.scenario.frames.iter().enumerate() {
        at += message.gap;
        if !message.gap.is_zero() {
            sleep_until(simulation.at(at)).await;
        }
        turns(message.yields).await;
        if let Ok(t) = writer.write(Frame::new(serial, &simulation.frames)) {
            let now = simulation.now();
            let mut log = simulation.log();
            // Timestamps count from 0.
            debug_assert_eq!(t, log.written.len() as u64);
            log.written.push((serial, now));
        }
    }
}

/// Reads items as the scenario's reader does. The first reader lets the others join.
pub(crate) fn audience(
    simulation: Arc<SimulationState>,
    index: usize,
    items: Items<ResultValue>,
) -> BoxFuture {
    Box::pin(listen(simulation, index, items))
}

async fn listen(simulation: Arc<SimulationState>, index: usize, mut items: Items<ResultValue>) {
    let plan = simulation.scenario.readers[index];
    let mut count = 0;
    loop {
        if index == 0 {
            for (other, joining) in simulation.scenario.readers.iter().enumerate().skip(1) {
                if joining.joins_after == count {
                    tokio::spawn(audience(Arc::clone(&simulation), other, items.new_reader()));
                }
            }
        }
        if plan.leaves_after == Some(count) {
            simulation.log().has_left[index] = true;
            return;
        }
        if let Some((_, lag)) = plan.lag.filter(|(after, _)| *after == count) {
            sleep(lag).await;
        }
        let Some(item) = items.read().await else { return };
        simulation.read(index, &item);
        drop(item);
        count += 1;
        if !plan.pace.is_zero() {
            sleep(plan.pace).await;
        }
    }
}

/// Makes the process stand still now and then: the clock advances, and nobody has a turn.
pub(crate) async fn stall(simulation: Arc<SimulationState>) {
    for (at, len) in &simulation.scenario.stalls {
        sleep_until(simulation.at(*at)).await;
        let from = simulation.now();
        let to = from + nanos(*len);
        simulation.log().stalls.push((from, to));
        advance(*len).await;
    }
}

pub(crate) fn name(p: u16) -> String {
    format!("cloud {p}")
}

/// Returns the reason why a source fails, which names the source and its message.
pub(crate) fn failure_text(reported: ValueLabel) -> String {
    format!("{} fails {} as message {}", reported.p, reported.t, reported.serial)
}

/// Panics without printing anything.
fn panic(words: &str) -> ! {
    resume_unwind(Box::new(words.to_owned()))
}
