//! The machine's answers, and the decisions that a trace records for them.

use fuseline_core::{Admission, Commit, Firing, Opening, Outcome, Priority};
use fuseline_traces::Decision;

use super::reason::{drop_reason, offer_refusal, open_refusal};

/// The answer to one input, with the timestamp and priority of the input. `p` is any number, as in
/// a trace (A18).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[must_use = "a forwarded result must be sent and a missed timestamp reported"]
pub enum Answer<const CLOUDS: usize> {
    /// The answer to an open (F1).
    Open {
        /// The timestamp.
        t: u64,
        /// The machine's answer.
        opening: Opening,
    },
    /// The answer to an offer (F2).
    Offer {
        /// The timestamp.
        t: u64,
        /// The cloud's priority.
        p: u64,
        /// The machine's answer.
        admission: Admission,
    },
    /// The answer to a result (F3).
    Result {
        /// The timestamp.
        t: u64,
        /// The source's priority.
        p: u64,
        /// The machine's answer.
        outcome: Outcome<CLOUDS>,
    },
    /// The answer to a failure (F4).
    Fail {
        /// The timestamp.
        t: u64,
        /// The source's priority.
        p: u64,
        /// The machine's answer.
        outcome: Outcome<CLOUDS>,
    },
    /// A tick, which has no answer of its own.
    Tick,
}

impl<const CLOUDS: usize> Answer<CLOUDS> {
    /// Passes the decisions that a trace records for this answer to `decide`, in order.
    ///
    /// `commit` is the machine's commit rule. `at` is the instant of the answer in ns.
    pub fn decisions(&self, commit: Commit, at: u64, mut decide: impl FnMut(Decision)) {
        match *self {
            Self::Open { opening: Opening::Accepted, .. } | Self::Tick => {}
            Self::Open { t, opening: Opening::Refused(why) } => {
                decide(Decision::RefuseOpen { at, t, why: open_refusal(why) });
            }
            Self::Offer { t, p, admission: Admission::Admitted { due } } => {
                decide(Decision::Request { at, t, p, due: due.as_nanos() });
            }
            Self::Offer { t, p, admission: Admission::Refused(why) } => {
                decide(Decision::RefuseOffer { at, t, p, why: offer_refusal(why) });
            }
            Self::Result { t, p, outcome } | Self::Fail { t, p, outcome } => {
                conclude(at, t, p, &outcome, &mut decide);
                // An output that retires its timestamp is followed by the timestamp's end (F9).
                if let (Commit::Progressive, Outcome::Forwarded { by, .. }) = (commit, outcome) {
                    decide(Decision::Final { at, t, p: number(by) });
                }
            }
        }
    }
}

/// Passes the decisions that a trace records for a firing to `decide` (F5). `at` is the instant in
/// ns at which it was served.
pub fn decisions_of<const CLOUDS: usize>(
    at: u64,
    firing: &Firing<CLOUDS>,
    mut decide: impl FnMut(Decision),
) {
    let t = firing.timestamp.as_u64();
    for p in firing.timers.iter() {
        decide(Decision::Timer { at, t, p: number(p) });
    }
    // A firing is never dropped or held, so no decision names a source. Under progressive it sends
    // nothing either.
    conclude(at, t, 0, &firing.outcome, decide);
}

fn conclude<const CLOUDS: usize>(
    at: u64,
    t: u64,
    p: u64,
    outcome: &Outcome<CLOUDS>,
    mut decide: impl FnMut(Decision),
) {
    match outcome {
        Outcome::Dropped(why) => decide(Decision::Drop { at, t, p, why: drop_reason(*why) }),
        Outcome::Held => decide(Decision::Hold { at, t, p }),
        Outcome::Waiting => {}
        Outcome::Missed => decide(Decision::Miss { at, t }),
        Outcome::Final { by } => decide(Decision::Final { at, t, p: number(*by) }),
        Outcome::Preliminary { by, cancelled } | Outcome::Forwarded { by, cancelled } => {
            decide(Decision::Emit { at, t, p: number(*by) });
            for p in cancelled.iter() {
                decide(Decision::Cancel { at, t, p: number(p) });
            }
        }
    }
}

fn number(priority: Priority) -> u64 {
    priority.as_u16().into()
}
