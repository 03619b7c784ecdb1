//! Checks the promises from inputs and decisions alone.
//!
//! A ledger knows no rule of decision: it records what was requested, what came and what was sent.
//! It forgets what no promise needs any more, so that ledgers with the same future are equal. A
//! retired timestamp leaves nothing behind. A due instant outlives its timer only while it is the
//! latest of its timestamp or of its timestamp's requests.

use std::fmt;

use fuseline_traces::{
    Cloud, Commit, Decision, DropReason, Header, Input, OfferRefusal, OpenRefusal,
};

use crate::history::History;

/// The part of an operator's configuration that a ledger needs.
#[derive(Clone, Copy, Debug)]
pub struct OperatorConfig<'a> {
    /// The greatest number of timestamps that may be open.
    pub window: usize,
    /// The commit rule.
    pub commit: Commit,
    /// The registered clouds.
    pub clouds: &'a [Cloud],
}

/// A promise that a ledger checks, with its name in SPEC.md. P10 is missing because it takes two
/// runs.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[expect(missing_docs, reason = "its name in SPEC.md says it, and is what it displays")]
pub enum Promise {
    P1,
    P2,
    P3,
    P4,
    P5,
    P6,
    P7,
    P8,
    P9,
    P11,
    P12,
}

/// A violated promise.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Violation {
    /// The promise.
    pub promise: Promise,
    /// A description of the violation.
    pub what: String,
}

/// Records what was requested, what came and what was sent, over all timestamps of one operator.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub struct Ledger {
    now: u64,
    newest: Option<u64>,
    /// The open timestamps, ascending.
    open: Vec<(u64, History)>,
}

impl Ledger {
    /// Records an input, and returns the promises that the machine violated.
    ///
    /// `fired` has the decisions of timers before the input, and `own` the decisions about the
    /// input. `next_due` is the machine's next due instant afterwards, in ns. Violations after the
    /// first one mean little.
    pub fn enter<'a>(
        &mut self,
        terms: OperatorConfig<'_>,
        input: &Input,
        fired: impl IntoIterator<Item = &'a Decision>,
        own: &[Decision],
        next_due: Option<u64>,
    ) -> Vec<Violation> {
        let mut violations = Vec::new();
        self.now = self.now.max(input.at());
        for decision in fired {
            if terms.is_progressive() && matches!(decision, Decision::Emit { .. }) {
                // The result would have been sent when it came (F9).
                violate(&mut violations, Promise::P6, || format!("{decision} comes by a timer"));
            }
            self.decide(terms, decision, &mut violations);
        }
        if !self.is_accounted(terms, input, own) {
            violate(&mut violations, Promise::P11, || format!("{input} is answered by {own:?}"));
        }
        self.arrive(terms, input, own);
        for decision in own {
            self.decide(terms, decision, &mut violations);
        }
        for (_, history) in &mut self.open {
            history.forget(self.now);
        }
        self.balance(terms, next_due, &mut violations);
        violations
    }

    /// Returns the greatest instant seen, in ns.
    #[must_use]
    pub const fn now(&self) -> u64 {
        self.now
    }

    /// Returns the open timestamps with their histories, ascending.
    #[must_use]
    pub fn open(&self) -> &[(u64, History)] {
        &self.open
    }

    /// Returns the history of an open timestamp.
    #[must_use]
    pub fn history(&self, t: u64) -> Option<&History> {
        let index = self.open.binary_search_by_key(&t, |(open, _)| *open).ok()?;
        Some(&self.open[index].1)
    }

    /// Returns the number of live timers.
    #[must_use]
    pub fn timer_count(&self) -> usize {
        self.open.iter().map(|(_, history)| history.timers().count()).sum()
    }

    /// Returns `true` if `t` or a later timestamp was ever opened.
    #[must_use]
    pub fn was_reached(&self, t: u64) -> bool {
        self.newest.is_some_and(|newest| t <= newest)
    }

    /// Returns `true` if the input has one outcome of its kind, and the reason of a refusal or drop
    /// holds (P11).
    fn is_accounted(&self, terms: OperatorConfig<'_>, input: &Input, own: &[Decision]) -> bool {
        // The pending clouds are cancelled, and never local (F7).
        let are_cancels =
            |rest: &[Decision]| rest.iter().all(|d| matches!(d, Decision::Cancel { p: 1.., .. }));
        match (input, own) {
            (Input::Open { .. } | Input::Fail { .. } | Input::Tick { .. }, []) => true,
            (Input::Open { t, deadline, .. }, [Decision::RefuseOpen { t: of, why, .. }]) => {
                t == of && self.open_refusal_holds(terms, *t, *deadline, *why)
            }
            (
                Input::Offer { t, p, deadline, backlog, .. },
                [Decision::RefuseOffer { t: of, p: q, why, .. }],
            ) => {
                (t, p) == (of, q)
                    && self.offer_refusal_holds(terms, (*t, *p), *deadline, *backlog, *why)
            }
            (Input::Offer { t, p, .. }, [Decision::Request { t: of, p: q, .. }]) => {
                (t, p) == (of, q)
            }
            (Input::Result { t, p, .. }, [Decision::Hold { t: of, p: q, .. }]) => {
                (t, p) == (of, q) && !terms.is_progressive()
            }
            (
                Input::Result { t, p, .. } | Input::Fail { t, p, .. },
                [Decision::Drop { t: of, p: q, why, .. }],
            ) => (t, p) == (of, q) && self.drop_holds(terms, *t, *p, *why),
            (Input::Result { t, p, .. }, [Decision::Emit { t: of, p: q, .. }, rest @ ..])
                if terms.is_progressive() =>
            {
                let rest = match rest {
                    [rest @ .., Decision::Final { t: of, p: q, .. }] if (t, p) == (of, q) => rest,
                    _ => rest,
                };
                (t, p) == (of, q) && are_cancels(rest)
            }
            (Input::Fail { t, .. }, [Decision::Final { t: of, .. }]) if terms.is_progressive() => {
                t == of
            }
            (
                Input::Result { t, .. } | Input::Fail { t, .. },
                [Decision::Emit { t: of, .. }, rest @ ..],
            ) => t == of && are_cancels(rest) && !terms.is_progressive(),
            (Input::Fail { t, .. }, [Decision::Miss { t: of, .. }]) => t == of,
            _ => false,
        }
    }

    fn open_refusal_holds(
        &self,
        terms: OperatorConfig<'_>,
        t: u64,
        deadline: Option<u64>,
        why: OpenRefusal,
    ) -> bool {
        match why {
            OpenRefusal::Order => self.was_reached(t),
            OpenRefusal::Full => self.open.len() >= terms.window,
            OpenRefusal::Deadline => deadline.is_some_and(|deadline| self.is_past(deadline)),
        }
    }

    fn offer_refusal_holds(
        &self,
        terms: OperatorConfig<'_>,
        (t, p): (u64, u64),
        deadline: u64,
        backlog: u64,
        why: OfferRefusal,
    ) -> bool {
        let history = self.history(t);
        match why {
            OfferRefusal::Unknown => terms.cloud(p).is_none() || !self.was_reached(t),
            OfferRefusal::Closed => history.is_none(),
            OfferRefusal::Duplicate => history.is_some_and(|history| history.is_requested(p)),
            OfferRefusal::Outranked => history.and_then(History::best).is_some_and(|best| best > p),
            OfferRefusal::Deadline => self.is_past(deadline),
            OfferRefusal::Queue => terms.cloud(p).is_some_and(|cloud| backlog > cloud.resume),
        }
    }

    fn drop_holds(&self, terms: OperatorConfig<'_>, t: u64, p: u64, why: DropReason) -> bool {
        let history = self.history(t);
        let is_requested = history.is_some_and(|history| history.is_requested(p));
        let is_held = history.is_some_and(|history| history.is_held(p));
        let is_pending = history.is_some_and(|history| history.is_pending(p));
        match why {
            DropReason::Unknown => (p > 0 && terms.cloud(p).is_none()) || !self.was_reached(t),
            DropReason::Superseded => history.is_none_or(|history| {
                terms.is_progressive() && history.best().is_some_and(|best| best > p)
            }),
            DropReason::Unsolicited => !is_requested,
            DropReason::Duplicate => is_held,
            DropReason::Late => is_requested && !is_held && !is_pending,
        }
    }

    /// Records what came, unless it was refused or dropped.
    fn arrive(&mut self, terms: OperatorConfig<'_>, input: &Input, own: &[Decision]) {
        if own.iter().any(is_refused_or_dropped) {
            return;
        }
        let now = self.now;
        match *input {
            // A timestamp that is opened again is not new; its second output is one too many (P1).
            Input::Open { t, .. } if self.was_reached(t) => {}
            Input::Open { t, deadline, .. } => {
                self.newest = Some(t);
                let due = deadline.map(|deadline| now.saturating_add(deadline));
                self.open.push((t, History::new(due)));
            }
            Input::Offer { t, p, deadline, .. } => {
                if let Some(history) = self.history_mut(t) {
                    history.ask(p, Some(now.saturating_add(deadline)));
                }
            }
            Input::Result { t, p, .. } => {
                if let Some(history) = self.history_mut(t) {
                    // A result after its timer or a failure is late too (P2).
                    let is_past = history.due(p).is_some_and(|due| due <= now);
                    history.hold(p, is_past || !history.is_pending(p));
                    // Holding a result may end its timer (P8).
                    if p == 0 || terms.commit != Commit::Eager {
                        history.disarm(p);
                    }
                }
            }
            Input::Fail { t, p, .. } => {
                if let Some(history) = self.history_mut(t) {
                    history.close(p);
                    history.disarm(p);
                }
            }
            Input::Tick { .. } => {}
        }
    }

    /// Records a decision, and compares it with the history of its timestamp.
    fn decide(
        &mut self,
        terms: OperatorConfig<'_>,
        decision: &Decision,
        violations: &mut Vec<Violation>,
    ) {
        match *decision {
            Decision::Timer { t, p, .. } => {
                let now = self.now;
                let due = self.history_mut(t).and_then(|history| {
                    history.close(p);
                    history.disarm(p)
                });
                if due.is_none_or(|due| due > now) {
                    violate(violations, Promise::P8, || {
                        format!("the timer of ({t}, {p}), due at {due:?}, fired at {now}")
                    });
                }
            }
            Decision::Emit { t, p, .. } if terms.is_progressive() => self.improve(t, p, violations),
            Decision::Final { t, p, .. } => match self.retire(t) {
                None => violate(violations, Promise::P1, || format!("{t} is final, not open")),
                Some(history) => {
                    let best = history.best();
                    if best != Some(p) {
                        violate(violations, Promise::P3, || {
                            format!("{p} is final for {t}, the best output is {best:?}")
                        });
                    }
                    if history.pending().next().is_some() {
                        violate(violations, Promise::P7, || {
                            format!("{t} is final with a better result to come")
                        });
                    }
                }
            },
            Decision::Emit { t, p, .. } => match self.retire(t) {
                None => violate(violations, Promise::P1, || format!("{t} is forwarded, not open")),
                Some(history) => {
                    if history.is_held_late(p) {
                        violate(violations, Promise::P2, || format!("({t}, {p}) came too late"));
                    }
                    let best = history.best();
                    if best != Some(p) {
                        violate(violations, Promise::P3, || {
                            format!("{p} is forwarded for {t}, the best available is {best:?}")
                        });
                    }
                }
            },
            Decision::Miss { t, .. } => match self.retire(t) {
                None => violate(violations, Promise::P1, || format!("{t} is missed, not open")),
                Some(history) => {
                    if history.best().is_some() {
                        violate(violations, Promise::P5, || {
                            format!("{t} is missed with a result available")
                        });
                    }
                    if history.is_held(0) {
                        violate(violations, Promise::P12, || {
                            format!("{t} is missed, and local's result was accepted")
                        });
                    }
                    if history.pending().next().is_some() {
                        violate(violations, Promise::P7, || {
                            format!("{t} is missed with a result to come")
                        });
                    }
                }
            },
            Decision::Hold { t, p: 0, .. } => {
                if self.history(t).is_some_and(History::is_local_alone) {
                    violate(violations, Promise::P6, || format!("local is held for {t}, alone"));
                }
            }
            Decision::Request { t, p, due, .. } => {
                let noted = self.history(t).and_then(|history| history.due(p));
                if noted != Some(due) {
                    violate(violations, Promise::P8, || {
                        format!("({t}, {p}) is due at {due}, it was asked for {noted:?}")
                    });
                }
            }
            Decision::Hold { .. }
            | Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Drop { .. }
            | Decision::Cancel { .. } => {}
        }
    }

    /// Records that a result is sent while its timestamp stays open, and what it outranks is no
    /// longer awaited (F9).
    fn improve(&mut self, t: u64, p: u64, violations: &mut Vec<Violation>) {
        let Some(history) = self.history_mut(t) else {
            return violate(violations, Promise::P1, || format!("{t} is forwarded, not open"));
        };
        if history.is_held_late(p) {
            violate(violations, Promise::P2, || format!("({t}, {p}) came too late"));
        }
        let best = history.best();
        if best != Some(p) {
            violate(violations, Promise::P1, || {
                format!("{p} is forwarded for {t} after {best:?}, which outranks it")
            });
        }
        let outranked: Vec<u64> = history.pending().take_while(|q| *q < p).collect();
        for q in outranked {
            history.close(q);
            history.disarm(q);
        }
    }

    /// Checks what must hold between inputs.
    fn balance(
        &self,
        terms: OperatorConfig<'_>,
        next_due: Option<u64>,
        violations: &mut Vec<Violation>,
    ) {
        let now = self.now;
        if self.open.len() > terms.window {
            violate(violations, Promise::P9, || "more are open than the window allows".to_owned());
        }
        for (t, history) in &self.open {
            let best = history.best();
            if best.is_some_and(|best| !history.may_improve_on(best)) {
                violate(violations, Promise::P4, || format!("{best:?} is held for {t} in vain"));
            }
            let is_limited = history.is_limited();
            let waits_for_local = !is_limited && history.is_pending(0);
            if history.timers().next().is_none() && !waits_for_local {
                violate(violations, Promise::P7, || format!("{t} waits for nothing"));
            }
            if !history.is_pending(0) && history.are_requests_over(now) {
                violate(violations, Promise::P12, || {
                    format!("{t} outlives local's arrival and the due instants of its requests")
                });
            }
            let is_over = history.is_over(now);
            if is_over && is_limited {
                violate(violations, Promise::P7, || format!("{t} outlives its latest due instant"));
            }
            if is_over && history.is_held(0) {
                violate(violations, Promise::P5, || {
                    format!("local is held for {t} beyond the latest due instant")
                });
            }
        }
        let timers = self.open.iter().flat_map(|(_, history)| history.timers());
        let least = timers.map(|(_, due)| due).min();
        if least != next_due {
            violate(violations, Promise::P8, || {
                format!("{least:?} is due next, the machine says {next_due:?}")
            });
        }
        if least.is_some_and(|due| due <= now) {
            violate(violations, Promise::P8, || format!("what is due at {least:?} is not served"));
        }
    }

    /// Returns `true` if a deadline given now is over at once.
    const fn is_past(&self, deadline: u64) -> bool {
        self.now.saturating_add(deadline) <= self.now
    }

    fn history_mut(&mut self, t: u64) -> Option<&mut History> {
        let index = self.open.binary_search_by_key(&t, |(open, _)| *open).ok()?;
        Some(&mut self.open[index].1)
    }

    fn retire(&mut self, t: u64) -> Option<History> {
        let index = self.open.binary_search_by_key(&t, |(open, _)| *open).ok()?;
        Some(self.open.remove(index).1)
    }
}

impl OperatorConfig<'_> {
    fn is_progressive(&self) -> bool {
        self.commit == Commit::Progressive
    }

    /// Returns the registered cloud with this priority.
    fn cloud(&self, p: u64) -> Option<&Cloud> {
        self.clouds.iter().find(|cloud| u64::from(cloud.p) == p)
    }
}

impl<'a> From<&'a Header> for OperatorConfig<'a> {
    fn from(header: &'a Header) -> Self {
        Self { window: header.window.into(), commit: header.commit, clouds: &header.clouds }
    }
}

impl Promise {
    /// Returns the promise's identifier and short name in SPEC.md.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::P1 => "P1 once",
            Self::P2 => "P2 never late",
            Self::P3 => "P3 best available",
            Self::P4 => "P4 prompt",
            Self::P5 => "P5 local floor",
            Self::P6 => "P6 free without cloud",
            Self::P7 => "P7 no stall",
            Self::P8 => "P8 timers",
            Self::P9 => "P9 bounded",
            Self::P11 => "P11 accounted",
            Self::P12 => "P12 bounded wait",
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.promise.name(), self.what)
    }
}

const fn is_refused_or_dropped(decision: &Decision) -> bool {
    matches!(
        decision,
        Decision::RefuseOpen { .. } | Decision::RefuseOffer { .. } | Decision::Drop { .. }
    )
}

/// Splits the decisions after an input into the decisions of timers before it and the decisions
/// about the input itself.
#[must_use]
pub fn split<'a>(input: &Input, decisions: &'a [Decision]) -> (&'a [Decision], &'a [Decision]) {
    // Under progressive a result's emit may be followed by its cancels and a final (F9).
    let is_main = |decision: &Decision| match decision {
        Decision::Cancel { .. } => false,
        Decision::Final { .. } => !matches!(input, Input::Result { .. }),
        _ => true,
    };
    let Some(last) = decisions.iter().rposition(is_main) else { return (decisions, &[]) };
    let is_own = match input {
        Input::Offer { .. } | Input::Result { .. } => true,
        Input::Open { .. } => matches!(decisions[last], Decision::RefuseOpen { .. }),
        // If a firing had retired the timestamp, the failure would have been dropped after it.
        Input::Fail { t, .. } => match decisions[last] {
            Decision::Drop { .. } => true,
            Decision::Emit { t: of, .. }
            | Decision::Final { t: of, .. }
            | Decision::Miss { t: of, .. } => of == *t,
            Decision::Timer { .. }
            | Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Request { .. }
            | Decision::Hold { .. }
            | Decision::Cancel { .. } => false,
        },
        Input::Tick { .. } => false,
    };
    decisions.split_at(if is_own { last } else { decisions.len() })
}

fn violate(violations: &mut Vec<Violation>, promise: Promise, what: impl FnOnce() -> String) {
    violations.push(Violation { promise, what: what() });
}
