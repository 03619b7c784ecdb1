//! A run as plain data: the configuration, the messages, and the disruptions. `draw` makes it, and
//! `shrink` makes it smaller.

use std::fmt;
use std::time::Duration;

use fuseline_tokio::Commit;

/// A run of one operator. It is drawn from its seed, and can be made smaller by hand.
#[derive(Clone, PartialEq, Debug)]
pub struct Scenario {
    /// The seed that it was drawn from.
    pub seed: u64,
    /// The greatest number of open messages.
    pub window: u16,
    /// The commit rule.
    pub commit: Commit,
    /// The operator may lag behind the camera by this many messages.
    pub input_len: usize,
    /// Readers may lag behind the operator by this many items.
    pub output_len: usize,
    /// The computation on board.
    pub local: OnBoard,
    /// The clouds, as they are registered.
    pub clouds: Vec<ScenarioCloud>,
    /// The link that all calls share, if its rate is limited.
    pub link: Option<ScenarioLink>,
    /// The gate's limit for side requests and how many may be under way, if there are any.
    pub side: Option<(u64, usize)>,
    /// `Some` if late results are given as hints, and `Some(true)` if their handler panics.
    pub hints: Option<bool>,
    /// `true` if somebody takes the metrics, which costs as much as a source.
    pub metered: bool,
    /// The disk that takes the recording.
    pub disk: Disk,
    /// The readers of the output. The first one is there from the start.
    pub readers: Vec<ReaderPlan>,
    /// The instants at which the process stands still, and for how long.
    pub stalls: Vec<(Duration, Duration)>,
    /// The messages, in order.
    pub frames: Vec<MessageScript>,
    /// The end of the run.
    pub end: Finish,
}

/// The local computation.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OnBoard {
    /// The number of computations that run at once.
    pub at_once: usize,
    /// The number of computations that may wait; as many as the window if not given.
    pub waiting: Option<usize>,
    /// `true` to skip a waiting computation once its message has its output.
    pub skip_answered: bool,
    /// The time that it may take.
    pub deadline: Option<Duration>,
}

/// A cloud.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ScenarioCloud {
    /// Its priority.
    pub p: u16,
    /// Its gate's limit.
    pub limit: u64,
    /// Its gate's resume.
    pub resume: u64,
    /// The number of calls that may be under way.
    pub calls: usize,
    /// The time for which calls run on past their due instants.
    pub linger: Duration,
    /// The deadline that its policy chooses, if it has one. Zero is a policy that sometimes panics.
    pub policy: Option<Duration>,
}

/// A link: requests wait for the uplink, and results for the downlink. A request that finds no room
/// fails, and a result never arrives.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ScenarioLink {
    /// The rates up and down, in bits per second.
    pub rates: [u64; 2],
    /// The number of bytes that may wait in each direction.
    pub queue_bytes: u64,
    /// The bytes of a request and of a result.
    pub bytes: [usize; 2],
}

/// A disk that takes a recording.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Disk {
    /// The recording is written whole, in parts of this many bytes if that is given.
    Whole(Option<u64>),
    /// After this many parts of this many bytes the disk is full.
    FullAfter(u64, u64),
}

/// A reader of the output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ReaderPlan {
    /// The number of the first reader's items after which it joins.
    pub joins_after: usize,
    /// The time that it takes for each item.
    pub pace: Duration,
    /// The number of items after which it stands still, and for how long.
    pub lag: Option<(usize, Duration)>,
    /// The number of items after which it leaves.
    pub leaves_after: Option<usize>,
}

/// A message, and everybody's action about it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MessageScript {
    /// The time after the previous message.
    pub gap: Duration,
    /// The number of turns that others have before it is written.
    pub yields: u8,
    /// Local's action.
    pub local: SourceAction,
    /// The offer to each cloud, and the cloud's action.
    pub offers: Vec<OfferAction>,
    /// The side request.
    pub side: OfferAction,
}

/// A message handler's action about a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum OfferAction {
    /// It makes no request.
    Nothing,
    /// It panics.
    Panics,
    /// It offers a request with this deadline, and the cloud then acts like this.
    Offers(Duration, SourceAction),
}

/// A source's action once it is called.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SourceAction {
    /// The time that it takes.
    pub after: Duration,
    /// The number of turns that others have before it begins and before it ends.
    pub yields: u8,
    /// The end of the call.
    pub result: CallResult,
}

/// States how a call or a computation ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CallResult {
    /// Returns a result.
    Answers,
    /// Returns an error: a connection that was refused or reset.
    Fails,
    /// Panics.
    Panics,
    /// Panics before it has begun.
    PanicsAtOnce,
    /// Returns a response that the response handler refuses.
    BadResponse,
    /// Returns a response at which the response handler panics.
    PanickingResponse,
    /// Never ends: a half-open connection, or a black hole.
    Hangs,
    /// Never ends, and panics when it is dropped.
    HangsAndPanics,
}

/// States how a run ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Finish {
    /// The input ends, and every message has its output.
    Input,
    /// The same, and nobody keeps the running operator any more.
    Alone,
    /// The operator is stopped at this instant.
    Stop(Duration),
    /// The runtime is dropped at this instant, with everything in it.
    Crash(Duration),
}

impl Scenario {
    /// Returns the action of source `p` about this message, if it is called.
    pub(crate) fn act(&self, serial: usize, p: u16) -> Option<SourceAction> {
        let frame = self.frames.get(serial)?;
        if p == 0 {
            return Some(frame.local);
        }
        let index = self.clouds.iter().position(|cloud| cloud.p == p)?;
        match frame.offers.get(index)? {
            OfferAction::Offers(_, act) => Some(*act),
            OfferAction::Nothing | OfferAction::Panics => None,
        }
    }
}

impl SourceAction {
    /// Returns an action that gives a result after this long.
    #[must_use]
    pub const fn answers(after: Duration) -> Self {
        Self { after, yields: 0, result: CallResult::Answers }
    }
}

impl fmt::Display for Scenario {
    /// Writes the configuration, then one line for each message.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, window, commit, input_len, output_len, .. } = self;
        writeln!(
            f,
            "seed {seed}: window {window}, {commit}, input {input_len}, output {output_len}"
        )?;
        writeln!(f, "  local   {:?}", self.local)?;
        for cloud in &self.clouds {
            writeln!(f, "  cloud   {cloud:?}")?;
        }
        if let Some(link) = &self.link {
            writeln!(f, "  link    {link:?}")?;
        }
        if let Some((limit, calls)) = self.side {
            writeln!(f, "  side    limit {limit}, {calls} calls")?;
        }
        if let Some(panics) = self.hints {
            writeln!(f, "  hints   {}", if panics { "their handler panics" } else { "taken" })?;
        }
        writeln!(f, "  disk    {:?}", self.disk)?;
        for reader in &self.readers {
            writeln!(f, "  reader  {reader:?}")?;
        }
        for (at, len) in &self.stalls {
            writeln!(f, "  stall   at {at:?} for {len:?}")?;
        }
        writeln!(f, "  end     {:?}", self.end)?;
        for (serial, frame) in self.frames.iter().enumerate() {
            write!(f, "  message {serial}: {:?} later", frame.gap)?;
            if frame.yields > 0 {
                write!(f, ", {} yields", frame.yields)?;
            }
            write!(f, ", local {}", frame.local)?;
            for (cloud, offer) in self.clouds.iter().zip(&frame.offers) {
                write!(f, ", cloud {} {offer}", cloud.p)?;
            }
            if self.side.is_some() {
                write!(f, ", side {}", frame.side)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

impl fmt::Display for OfferAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("is not asked"),
            Self::Panics => f.write_str("has a handler that panics"),
            Self::Offers(deadline, act) => write!(f, "within {deadline:?} {act}"),
        }
    }
}

impl fmt::Display for SourceAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} after {:?}", self.result, self.after)?;
        if self.yields > 0 { write!(f, " and {} yields", self.yields) } else { Ok(()) }
    }
}
