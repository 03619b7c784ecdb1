//! The detector: each frame is computed on board and by a cloud, and the best result in time goes
//! on.

use std::collections::VecDeque;
use std::net::UdpSocket;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;
use std::{env, thread};

use cu29::prelude::*;
use fuseline_core::{self as core, Admission, Firing, Held, Opening, Outcome, Priority, Timestamp};
use fuseline_engine::arbiter::{Answer, Arbiter, decisions_of};
use fuseline_traces::{Cloud, Commit, Decision, Header, Input, Recorder, Recording};

const LOCAL: u64 = 0;
const CLOUD: u64 = 1;
/// The deadline of local and of the cloud.
const LOCAL_DEADLINE_NS: u64 = 100_000_000;
const CLOUD_DEADLINE_NS: u64 = 40_000_000;
const CLOUD_ADDRESS: &str = "127.0.0.1:50129";

/// A task with local on a thread and one cloud behind a socket. Its clock is Copper's, and it is
/// called a thousand times a second.
#[derive(Reflect)]
pub struct Detector {
    arbiter: Arbiter<1, 16>,
    held: Held<u64, 16>,
    recorder: Recorder,
    /// Frames for local, and its results.
    jobs: Sender<u64>,
    computed: Receiver<(u64, Option<u64>)>,
    cloud: UdpSocket,
    /// Detections, each of which needs a copper list of its own.
    outputs: VecDeque<(u64, Option<u64>)>,
    /// A fault on purpose: results are sent as they come, whatever the core says.
    is_impatient: bool,
}

// The core's state is not in Copper's keyframes: a run is replayed from its trace.
impl Freezable for Detector {}

impl CuTask for Detector {
    type Resources<'r> = ();
    type Input<'m> = input_msg!(u64);
    type Output<'m> = output_msg!((u64, Option<u64>));

    fn new(_: Option<&ComponentConfig>, (): ()) -> CuResult<Self> {
        let cloud = Cloud { p: 1, name: Some("cloud".to_owned()), limit: 8, resume: 0 };
        let operator = Some("detector".to_owned());
        let (window, commit) = (16, Commit::Eager);
        let header = Header { operator, window, commit, clouds: vec![cloud] };
        let trace = env::var("FUSELINE_TRACE").unwrap_or_else(|_| "copper.jsonl".to_owned());
        let recorder = Recorder::create(&trace, &header, Recording::default());
        let socket = UdpSocket::bind("127.0.0.1:0").and_then(|socket| {
            socket.connect(CLOUD_ADDRESS)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        });
        let (jobs, received) = channel();
        let (sender, computed) = channel();
        thread::spawn(move || compute(&received, &sender));
        Ok(Self {
            arbiter: Arbiter::new(&header).map_err(|error| cannot("configure", error))?,
            held: Held::new(),
            recorder: recorder.map_err(|error| cannot("record", error))?,
            jobs,
            computed,
            cloud: socket.map_err(|error| cannot("reach the cloud", error))?,
            outputs: VecDeque::new(),
            is_impatient: env::var_os("IMPATIENT").is_some(),
        })
    }

    fn process(
        &mut self,
        context: &CuContext,
        input: &Self::Input<'_>,
        output: &mut Self::Output<'_>,
    ) -> CuResult<()> {
        let at = context.now().as_nanos();
        if let Some(frame) = input.payload() {
            self.open(at, *frame);
        }
        while let Ok((t, computed)) = self.computed.try_recv() {
            match computed {
                Some(value) => self.apply(&Input::Result { at, t, p: LOCAL }, value),
                None => self.apply(&Input::Fail { at, t, p: LOCAL }, 0),
            };
        }
        let mut reply = [0; 16];
        while let Ok(16) = self.cloud.recv(&mut reply) {
            let [t, value] = numbers(reply);
            self.apply(&Input::Result { at, t, p: CLOUD }, value);
        }
        if self.arbiter.next_due().is_some_and(|due| due <= at) {
            self.apply(&Input::Tick { at }, 0);
        }
        output.clear_payload();
        if let Some(detection) = self.outputs.pop_front() {
            output.set_payload(detection);
        }
        Ok(())
    }

    fn stop(&mut self, context: &CuContext) -> CuResult<()> {
        if self.arbiter.next_due().is_some() {
            self.apply(&Input::Tick { at: context.now().as_nanos() }, 0);
        }
        self.recorder.flush();
        match self.recorder.error() {
            Some(error) => Err(cannot("record", error)),
            None => Ok(()),
        }
    }
}

impl Detector {
    fn open(&mut self, at: u64, t: u64) {
        if !self.apply(&Input::Open { at, t, deadline: Some(LOCAL_DEADLINE_NS) }, 0) {
            return;
        }
        // If the thread has ended or the request is lost, timers answer the message.
        let _ = self.jobs.send(t);
        let (p, deadline, backlog) = (CLOUD, CLOUD_DEADLINE_NS, 0);
        if self.apply(&Input::Offer { at, t, p, deadline, backlog }, 0) {
            let _ = self.cloud.send(&t.to_le_bytes());
        }
    }

    /// Gives the core an input, whose result has this value, records it, and puts what is sent into
    /// the outputs. Returns whether the message is accepted, or the request admitted.
    fn apply(&mut self, input: &Input, value: u64) -> bool {
        let Self { arbiter, held, outputs, .. } = self;
        let mut decisions = Vec::new();
        let answer = arbiter.apply(input, |at, firing: &Firing<1>| {
            decisions_of(at, firing, |decision| decisions.push(decision));
            let sent = held.firing(firing);
            put(outputs, firing.timestamp.as_u64(), sent, &firing.outcome);
        });
        answer.decisions(core::Commit::Eager, arbiter.now(), |decision| decisions.push(decision));
        match answer {
            Answer::Open { t, opening: Opening::Refused(_) } => outputs.push_back((t, None)),
            Answer::Result { t, p, outcome: Outcome::Held } if self.is_impatient => {
                outputs.push_back((t, Some(value)));
                decisions = vec![Decision::Emit { at: arbiter.now(), t, p }];
            }
            Answer::Result { t, p, outcome } => {
                let p = Priority::new(p as u16);
                let sent = held.result(Timestamp::new(t), p, value, &outcome);
                put(outputs, t, sent, &outcome);
            }
            Answer::Fail { t, outcome, .. } => {
                let sent = held.failure(Timestamp::new(t), &outcome);
                put(outputs, t, sent, &outcome);
            }
            Answer::Open { .. } | Answer::Offer { .. } | Answer::Tick => {}
        }
        self.recorder.input(input);
        decisions.iter().for_each(|decision| self.recorder.decision(decision));
        match answer {
            Answer::Open { opening, .. } => opening == Opening::Accepted,
            Answer::Offer { admission, .. } => matches!(admission, Admission::Admitted { .. }),
            Answer::Result { .. } | Answer::Fail { .. } | Answer::Tick => false,
        }
    }
}

/// Puts what a message ends with into the outputs.
fn put(
    outputs: &mut VecDeque<(u64, Option<u64>)>,
    t: u64,
    sent: Option<u64>,
    outcome: &Outcome<1>,
) {
    if matches!(outcome, Outcome::Forwarded { .. } | Outcome::Missed) {
        outputs.push_back((t, sent));
    }
}

/// Local: takes 15 ms, and fails for every seventh frame.
fn compute(jobs: &Receiver<u64>, computed: &Sender<(u64, Option<u64>)>) {
    for t in jobs {
        thread::sleep(Duration::from_millis(15));
        let value = (t % 7 != 6).then_some(5_000 + t);
        if computed.send((t, value)).is_err() {
            return;
        }
    }
}

/// The cloud: takes 25 ms, and loses every third request.
pub fn serve_cloud() {
    let socket = UdpSocket::bind(CLOUD_ADDRESS).expect("a free port");
    let mut request = [0; 8];
    while let Ok((8, from)) = socket.recv_from(&mut request) {
        let t = u64::from_le_bytes(request);
        thread::sleep(Duration::from_millis(25));
        if t % 3 != 2 {
            let reply = [t.to_le_bytes(), (4_900 + t).to_le_bytes()].concat();
            let _ = socket.send_to(&reply, from);
        }
    }
}

fn numbers(bytes: [u8; 16]) -> [u64; 2] {
    let both = u128::from_le_bytes(bytes);
    [both as u64, (both >> 64) as u64]
}

fn cannot(what: &str, why: impl std::fmt::Display) -> CuError {
    CuError::from(format!("the detector cannot {what}: {why}"))
}
