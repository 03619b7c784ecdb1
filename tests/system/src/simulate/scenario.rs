//! One run as plain data: what is configured, what comes, and what goes wrong. `draw` makes it, `shrink` makes it smaller.

use std::fmt;
use std::time::Duration;

use fuseline_tokio::Commit;

/// One run of one operator. It is drawn from its seed and can be made smaller by hand.
#[derive(Clone, PartialEq, Debug)]
pub struct Scenario {
    /// Where it was drawn from.
    pub seed: u64,
    /// How many messages may be open.
    pub window: u16,
    /// The commit rule.
    pub commit: Commit,
    /// How far the operator may lag behind the camera.
    pub input_len: usize,
    /// How far readers may lag behind the operator.
    pub output_len: usize,
    /// The computation on board.
    pub local: OnBoard,
    /// The clouds, as they are registered.
    pub clouds: Vec<ScenarioCloud>,
    /// The link that all calls share, if it has a width.
    pub link: Option<ScenarioLink>,
    /// Side requests, if there are any: the gate's limit and how many may be under way.
    pub side: Option<(u64, usize)>,
    /// Whether late results are handed on as hints, and whether their handler panics.
    pub hints: Option<bool>,
    /// Whether somebody takes the metrics, which costs as much as a source.
    pub metered: bool,
    /// What becomes of the recording.
    pub disk: Disk,
    /// Who reads the output; the first is there from the start.
    pub readers: Vec<ReaderPlan>,
    /// When the process stands still, and for how long.
    pub stalls: Vec<(Duration, Duration)>,
    /// The messages, in order.
    pub frames: Vec<MessageScript>,
    /// How the run ends.
    pub end: Finish,
}

/// The local computation.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OnBoard {
    /// How many run at once.
    pub at_once: usize,
    /// How many more may wait; as many as the window if not given.
    pub waiting: Option<usize>,
    /// Whether one that waits is skipped once its message is answered.
    pub skip_answered: bool,
    /// How long it may take.
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
    /// How many calls may be under way.
    pub calls: usize,
    /// How long calls run on past their due instants.
    pub linger: Duration,
    /// The deadline that its policy chooses, if it has one; zero is a policy that panics now and then.
    pub policy: Option<Duration>,
}

/// A link: requests wait for the uplink, replies for the downlink. A request that finds no room fails, a reply never comes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ScenarioLink {
    /// Up and down, in bits a second.
    pub rates: [u64; 2],
    /// How many bytes may wait for each.
    pub queue_bytes: u64,
    /// Of a request and of a reply.
    pub bytes: [usize; 2],
}

/// What becomes of a recording.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Disk {
    /// It is written whole, in parts of so many bytes if it is given.
    Whole(Option<u64>),
    /// After so many parts of so many bytes the disk is full.
    FullAfter(u64, u64),
}

/// A reader of the output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ReaderPlan {
    /// After how many items of the first reader it joins.
    pub joins_after: usize,
    /// How long it takes for each item.
    pub pace: Duration,
    /// After how many items it stands still for how long.
    pub lag: Option<(usize, Duration)>,
    /// After how many items it leaves.
    pub leaves_after: Option<usize>,
}

/// One message, and what everybody does about it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MessageScript {
    /// How long after the one before it comes.
    pub gap: Duration,
    /// How often others have their turn before it is written.
    pub yields: u8,
    /// What local does.
    pub local: SourceAction,
    /// What is offered to each cloud, and what it does.
    pub offers: Vec<OfferAction>,
    /// The side request.
    pub side: OfferAction,
}

/// What a message handler does with a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum OfferAction {
    /// It makes no request.
    Nothing,
    /// It panics.
    Panics,
    /// It offers a request with this deadline; the cloud then acts so.
    Offers(Duration, SourceAction),
}

/// What a source does once it is called.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SourceAction {
    /// How long it takes.
    pub after: Duration,
    /// How often others have their turn before it begins and before it ends.
    pub yields: u8,
    /// How it ends.
    pub result: CallResult,
}

/// How a call or a computation ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CallResult {
    /// With a result.
    Answers,
    /// With an error: a connection that was refused or reset.
    Fails,
    /// With a panic.
    Panics,
    /// Before it has begun, with a panic.
    PanicsAtOnce,
    /// With a response that the response handler refuses.
    BadResponse,
    /// With a response at which the response handler panics.
    PanickingResponse,
    /// Not at all: a half-open connection, a black hole.
    Hangs,
    /// Not at all, and it panics when it is dropped.
    HangsAndPanics,
}

/// How a run ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Finish {
    /// The input ends, and all is answered.
    Input,
    /// The same, and nobody holds the running operator any more.
    Alone,
    /// The operator is stopped at this instant.
    Stop(Duration),
    /// The runtime is dropped at this instant, with all that is in it.
    Crash(Duration),
}

impl Scenario {
    /// What source `p` does about this message, if it is called.
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
    /// Answers after this long.
    #[must_use]
    pub const fn answers(after: Duration) -> Self {
        Self { after, yields: 0, result: CallResult::Answers }
    }
}

impl fmt::Display for Scenario {
    /// The configuration, then a line a message.
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
