//! Connects the state machine to the trace format.
//!
//! It applies one input, answers in the core's own types, and converts the answer to lines of a
//! trace. It decides nothing itself. Nothing else translates the core's answers and reasons to
//! those of `fuseline-traces`.
//!
//! ```rust
//! use fuseline_engine::arbiter::{Answer, Arbiter};
//! use fuseline_core::Opening;
//! use fuseline_traces::{Input, Line, parse};
//!
//! let header = br#"{"fuseline":1,"window":16,"clouds":[{"p":1,"limit":31}]}"#;
//! let Ok(Line::Header(header)) = parse(header) else { panic!("a header") };
//! let mut arbiter = Arbiter::<3, 16>::new(&header)?;
//!
//! // As types: first the firings, then the input's own answer.
//! let open = Input::Open { at: 0, t: 7, deadline: None };
//! let answer = arbiter.apply(&open, |_, firing| println!("{firing:?}"));
//! assert_eq!(answer, Answer::Open { t: 7, opening: Opening::Accepted });
//!
//! // As lines.
//! let mut lines = Vec::new();
//! arbiter.decide(&Input::Result { at: 1, t: 7, p: 0 }, |decision| lines.push(decision.to_string()));
//! assert_eq!(lines, [r#"{"ev":"emit","at":1,"t":7,"p":0}"#]);
//! # Ok::<(), fuseline_core::ConfigError>(())
//! ```

mod answer;
mod reason;

use fuseline_core::{
    Admission, Cloud, Commit, ConfigError, Deadline, DropReason, Firing, Fusion, Instant,
    OfferRefusal, Outcome, Priority, Timestamp,
};
use fuseline_traces as trace;
use fuseline_traces::{Decision, Header, Input};

pub use answer::{Answer, decisions_of};
pub use reason::{drop_reason, offer_refusal, open_refusal};

/// The greatest number of clouds in a header.
pub const CLOUDS: usize = 15;

/// Runs one operator's machine: takes the numbers of a trace and answers in the core's types.
///
/// Timestamps, priorities and instants are plain numbers here because any number is a legal input
/// (A18), even a priority that no cloud can have. Instants and durations are in nanoseconds. The
/// default capacities suffice for any [`Header`]. Two arbiters are equal if their machines are.
///
/// - constructor: [`new`](Self::new)
/// - inputs: [`apply`](Self::apply) answers in the core's types, [`decide`](Self::decide) in
///   decisions of a trace
/// - queries: [`next_due`](Self::next_due), [`now`](Self::now),
///   [`offer_refusal`](Self::offer_refusal), [`fusion`](Self::fusion)
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Arbiter<const CLOUDS: usize = 15, const WINDOW: usize = 1024> {
    /// The machine is boxed because the largest takes 190 KiB.
    fusion: Box<Fusion<CLOUDS, WINDOW>>,
}

impl<const CLOUDS: usize, const WINDOW: usize> Arbiter<CLOUDS, WINDOW> {
    /// Creates a machine with this configuration and no open timestamp.
    ///
    /// # Errors
    /// Returns the first [`ConfigError`] that holds.
    pub fn new(header: &Header) -> Result<Self, ConfigError> {
        let cloud = |cloud: &trace::Cloud| Cloud {
            priority: Priority::new(cloud.p),
            limit: cloud.limit,
            resume: cloud.resume,
        };
        let clouds: Vec<Cloud> = header.clouds.iter().map(cloud).collect();
        let commit = match header.commit {
            trace::Commit::Eager => Commit::Eager,
            trace::Commit::Patient => Commit::Patient,
            trace::Commit::Progressive => Commit::Progressive,
        };
        Ok(Self { fusion: Box::new(Fusion::new(usize::from(header.window), commit, &clouds)?) })
    }

    /// Applies an input and returns its answer.
    ///
    /// First passes each firing that is due to `fired`, with the instant in ns at which it is
    /// served (F5).
    pub fn apply(
        &mut self,
        input: &Input,
        mut fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Answer<CLOUDS> {
        // Timers are served at the clock's instant, which never goes back (F0).
        let served = self.now().max(input.at());
        let now = Instant::from_nanos(input.at());
        let mut ready = self.fusion.ready(now, |firing| fired(served, &firing));
        match *input {
            Input::Open { t, deadline, .. } => {
                let deadline = deadline.map(Deadline::from_nanos);
                Answer::Open { t, opening: ready.open(Timestamp::new(t), deadline) }
            }
            Input::Offer { t, p, deadline, backlog, .. } => {
                let deadline = Deadline::from_nanos(deadline);
                let admission = match priority(p) {
                    Some(known) => ready.offer(Timestamp::new(t), known, deadline, backlog),
                    // A priority beyond 16 bits cannot be registered, so it is unknown (F2).
                    None => Admission::Refused(OfferRefusal::Unknown),
                };
                Answer::Offer { t, p, admission }
            }
            Input::Result { t, p, .. } => {
                let outcome = match priority(p) {
                    Some(known) => ready.result(Timestamp::new(t), known),
                    // Unknown, as for an offer (F3).
                    None => Outcome::Dropped(DropReason::Unknown),
                };
                Answer::Result { t, p, outcome }
            }
            Input::Fail { t, p, .. } => {
                let outcome = match priority(p) {
                    Some(known) => ready.fail(Timestamp::new(t), known),
                    // Unknown, as for an offer (F4).
                    None => Outcome::Dropped(DropReason::Unknown),
                };
                Answer::Fail { t, p, outcome }
            }
            Input::Tick { .. } => Answer::Tick,
        }
    }

    /// Applies an input and passes its decisions to `decide`, in the order of the trace.
    pub fn decide(&mut self, input: &Input, mut decide: impl FnMut(Decision)) {
        let answer = self.apply(input, |at, firing| decisions_of(at, firing, &mut decide));
        answer.decisions(self.fusion.commit(), self.now(), decide);
    }

    /// Returns the earliest instant, in ns, at which a timer is due, or `None` if no timer is
    /// armed. Tick then.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.fusion.next_due().map(Instant::as_nanos)
    }

    /// Returns the machine's clock in ns.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.fusion.now().as_nanos()
    }

    /// Returns the reason why an offer would be refused now, or `None` if it would be admitted
    /// (F2). Changes nothing.
    ///
    /// `deadline` is in ns. Timers that are due after [`now`](Self::now) have not fired; to fire
    /// them, [`apply`](Self::apply) an [`Input::Tick`] first.
    #[must_use]
    pub fn offer_refusal(
        &self,
        (t, p): (u64, u64),
        deadline: u64,
        backlog: u64,
    ) -> Option<OfferRefusal> {
        // Unknown, as for an offer (F2).
        let Some(p) = priority(p) else { return Some(OfferRefusal::Unknown) };
        let deadline = Deadline::from_nanos(deadline);
        self.fusion.offer_refusal(Timestamp::new(t), p, deadline, backlog)
    }

    /// Returns the machine, for further queries.
    #[must_use]
    pub fn fusion(&self) -> &Fusion<CLOUDS, WINDOW> {
        &self.fusion
    }
}

/// Returns the priority with this number, or `None` if no cloud can have it (A18).
fn priority(p: u64) -> Option<Priority> {
    u16::try_from(p).ok().map(Priority::new)
}
