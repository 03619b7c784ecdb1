//! The machine's answers, and the decisions that a trace has for them.

use fuseline_core::{Admission, Commit, Firing, Opening, Outcome, Priority};
use fuseline_traces::Decision;

use crate::reason::{drop_reason, offer_refusal, open_refusal};

/// The answer to one input, with what the input was about. `p` is any number, as in a trace (A18).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[must_use = "a forwarded result must be sent and a missed timestamp reported"]
pub enum Answer<const CLOUDS: usize> {
    /// To an open (F1).
    Open {
        /// The timestamp.
        t: u64,
        /// What became of it.
        opening: Opening,
    },
    /// To an offer (F2).
    Offer {
        /// The timestamp.
        t: u64,
        /// The cloud.
        p: u64,
        /// What became of it.
        admission: Admission,
    },
    /// To a result (F3).
    Result {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u64,
        /// What became of it.
        outcome: Outcome<CLOUDS>,
    },
    /// To a failure (F4).
    Fail {
        /// The timestamp.
        t: u64,
        /// The source.
        p: u64,
        /// What became of it.
        outcome: Outcome<CLOUDS>,
    },
    /// A tick, which has no answer of its own.
    Tick,
}

impl<const CLOUDS: usize> Answer<CLOUDS> {
    /// Gives the trace's decisions under this commit rule to `decide`, in order; `at` is the instant of the answer, in ns.
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
                // F9: an output that retires its timestamp is followed by its end.
                if let (Commit::Progressive, Outcome::Forwarded { by, .. }) = (commit, outcome) {
                    decide(Decision::Final { at, t, p: number(by) });
                }
            }
        }
    }
}

/// Gives the trace's decisions for a firing (F5) to `decide`; `at` is when it was served, in ns.
pub fn decisions_of<const CLOUDS: usize>(
    at: u64,
    firing: &Firing<CLOUDS>,
    mut decide: impl FnMut(Decision),
) {
    let t = firing.timestamp.as_u64();
    for p in firing.timers.iter() {
        decide(Decision::Timer { at, t, p: number(p) });
    }
    // A firing is never dropped or held, so no decision names a source; nor does it send anything under progressive.
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
