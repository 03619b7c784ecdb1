//! What the promises speak of, kept apart from the machine: what was asked, what came, what went.
//!
//! It is read off inputs and decisions alone. What no promise needs any more is forgotten, so that
//! two histories with one future are one state: a retired timestamp leaves nothing, and a due
//! instant is kept beyond its timer only while it is the latest that its timestamp had.

use fuseline_core::{Instant, Priority, Timestamp};
use fuseline_traces::{Commit, Decision, DropReason, Input, OfferRefusal, OpenRefusal};

use crate::claim::{Claim, Claims};
use crate::config::Config;
use crate::machine::{Answer, Machine};
use crate::set::{PRIORITIES, Set};

/// The accounts of one operator.
#[derive(Clone, PartialEq, Eq, Hash, Default, Debug)]
pub(crate) struct Ghost {
    now: u64,
    newest: Option<u64>,
    /// In ascending order.
    open: Vec<Account>,
}

/// One open timestamp.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Account {
    pub(crate) t: u64,
    limited: bool,
    pub(crate) requested: Set,
    pub(crate) pending: Set,
    pub(crate) held: Set,
    /// Those of the held that came when their time was over.
    late: Set,
    /// The due instants of the live timers by priority; local's is the deadline.
    live: [Option<u64>; PRIORITIES],
    /// The latest due instant of timers live no more, while it is to come and no live one is later.
    stale: Option<u64>,
}

impl Ghost {
    /// The greatest instant seen.
    pub(crate) const fn now(&self) -> u64 {
        self.now
    }

    pub(crate) fn open(&self) -> &[Account] {
        &self.open
    }

    pub(crate) fn account(&self, t: u64) -> Option<&Account> {
        self.open.iter().find(|account| account.t == t)
    }

    /// How many timers are live.
    pub(crate) fn live_len(&self) -> usize {
        self.open.iter().map(|account| account.timers().count()).sum()
    }

    pub(crate) fn was_reached(&self, t: u64) -> bool {
        self.newest.is_some_and(|newest| t <= newest)
    }

    /// Enters an input with its whole answer; what it breaks.
    pub(crate) fn enter(
        &mut self,
        config: &Config,
        input: &Input,
        answer: &Answer,
        machine: &Machine,
    ) -> Claims {
        let mut broken = Claims::default();
        self.now = self.now.max(input.at());
        for decision in answer.fired.iter().flat_map(|fired| &fired.decisions) {
            self.decide(decision, &mut broken);
        }
        broken.insert_if(Claim::P11, !self.is_accounted(config, input, &answer.own));
        self.arrive(config, input, &answer.own);
        for decision in &answer.own {
            self.decide(decision, &mut broken);
        }
        self.forget();
        self.balance(config, machine, &mut broken);
        broken
    }

    /// P11: the input has one outcome, of its kind, and the reason for a refusal or drop holds.
    fn is_accounted(&self, config: &Config, input: &Input, own: &[Decision]) -> bool {
        let ends_with_cancels =
            |rest: &[Decision]| rest.iter().all(|d| matches!(d, Decision::Cancel { .. }));
        match (input, own) {
            (Input::Open { .. } | Input::Fail { .. } | Input::Tick { .. }, []) => true,
            (Input::Open { t, deadline, .. }, [Decision::RefuseOpen { t: of, why, .. }]) => {
                t == of && self.open_refusal_holds(config, *t, *deadline, *why)
            }
            (
                Input::Offer { t, p, deadline, backlog, .. },
                [Decision::RefuseOffer { t: of, p: q, why, .. }],
            ) => {
                (t, p) == (of, q)
                    && self.offer_refusal_holds(config, (*t, *p), *deadline, *backlog, *why)
            }
            (Input::Offer { t, p, .. }, [Decision::Request { t: of, p: q, .. }])
            | (Input::Result { t, p, .. }, [Decision::Hold { t: of, p: q, .. }]) => {
                (t, p) == (of, q)
            }
            (
                Input::Result { t, p, .. } | Input::Fail { t, p, .. },
                [Decision::Drop { t: of, p: q, why, .. }],
            ) => (t, p) == (of, q) && self.drop_holds(config, *t, *p, *why),
            (
                Input::Result { t, .. } | Input::Fail { t, .. },
                [Decision::Emit { t: of, .. }, rest @ ..],
            ) => t == of && ends_with_cancels(rest),
            (Input::Fail { t, .. }, [Decision::Miss { t: of, .. }]) => t == of,
            _ => false,
        }
    }

    fn open_refusal_holds(
        &self,
        config: &Config,
        t: u64,
        deadline: Option<u64>,
        why: OpenRefusal,
    ) -> bool {
        match why {
            OpenRefusal::Order => self.was_reached(t),
            OpenRefusal::Full => self.open.len() >= usize::from(config.window),
            OpenRefusal::Deadline => deadline.is_some_and(|deadline| self.is_past(deadline)),
        }
    }

    fn offer_refusal_holds(
        &self,
        config: &Config,
        (t, p): (u64, u64),
        deadline: u64,
        backlog: u64,
        why: OfferRefusal,
    ) -> bool {
        let account = self.account(t);
        match why {
            OfferRefusal::Unknown => config.cloud(p).is_none() || !self.was_reached(t),
            OfferRefusal::Closed => account.is_none(),
            OfferRefusal::Duplicate => account.is_some_and(|account| account.requested.contains(p)),
            OfferRefusal::Outranked => account.is_some_and(|account| account.held.any_above(p)),
            OfferRefusal::Deadline => self.is_past(deadline),
            OfferRefusal::Queue => config.cloud(p).is_some_and(|cloud| backlog > cloud.resume),
        }
    }

    fn drop_holds(&self, config: &Config, t: u64, p: u64, why: DropReason) -> bool {
        let account = self.account(t);
        let is_requested = account.is_some_and(|account| account.requested.contains(p));
        let is_held = account.is_some_and(|account| account.held.contains(p));
        let is_pending = account.is_some_and(|account| account.pending.contains(p));
        match why {
            DropReason::Unknown => (p > 0 && config.cloud(p).is_none()) || !self.was_reached(t),
            DropReason::Superseded => account.is_none(),
            DropReason::Unsolicited => !is_requested,
            DropReason::Duplicate => is_held,
            DropReason::Late => is_requested && !is_held && !is_pending,
        }
    }

    /// Books what came, unless it was refused or dropped.
    fn arrive(&mut self, config: &Config, input: &Input, own: &[Decision]) {
        if matches!(
            own.first(),
            Some(
                Decision::RefuseOpen { .. } | Decision::RefuseOffer { .. } | Decision::Drop { .. }
            )
        ) {
            return;
        }
        let now = self.now;
        match *input {
            // P1: what is opened again is no new timestamp; its second output is one too many.
            Input::Open { t, .. } if self.was_reached(t) => {}
            Input::Open { t, deadline, .. } => {
                self.newest = Some(t);
                let mut account = Account::new(t);
                account.limited = deadline.is_some();
                account.live[0] = deadline.map(|deadline| now.saturating_add(deadline));
                self.open.push(account);
            }
            Input::Offer { t, p, deadline, .. } => {
                if let Some(account) = self.account_mut(t) {
                    account.requested.insert(p);
                    account.pending.insert(p);
                    account.arm(p, now.saturating_add(deadline));
                }
            }
            Input::Result { t, p, .. } => {
                if let Some(account) = self.account_mut(t) {
                    // P2: what its timer or a failure closed is late, too.
                    let is_past = account.due(p).is_some_and(|due| due <= now);
                    if is_past || !account.pending.contains(p) {
                        account.late.insert(p);
                    }
                    account.pending.remove(p);
                    account.held.insert(p);
                    // P8: what being held does to the timer.
                    if p == 0 || config.commit == Commit::Patient {
                        account.disarm(p);
                    }
                }
            }
            Input::Fail { t, p, .. } => {
                if let Some(account) = self.account_mut(t) {
                    account.pending.remove(p);
                    account.disarm(p);
                }
            }
            Input::Tick { .. } => {}
        }
    }

    fn decide(&mut self, decision: &Decision, broken: &mut Claims) {
        match *decision {
            Decision::Timer { t, p, .. } => {
                let now = self.now;
                let due = self.account_mut(t).and_then(|account| {
                    account.pending.remove(p);
                    account.disarm(p)
                });
                broken.insert_if(Claim::P8, due.is_none_or(|due| due > now));
            }
            Decision::Emit { t, p, .. } => match self.retire(t) {
                None => broken.insert(Claim::P1),
                Some(account) => {
                    broken.insert_if(Claim::P2, account.late.contains(p));
                    broken.insert_if(Claim::P3, account.held.greatest() != Some(p));
                }
            },
            Decision::Miss { t, .. } => match self.retire(t) {
                None => broken.insert(Claim::P1),
                Some(account) => broken.insert_if(Claim::P5, account.held.contains(0)),
            },
            Decision::Hold { t, p: 0, .. } => {
                let alone = self.account(t).is_some_and(|account| account.requested == Set::LOCAL);
                broken.insert_if(Claim::P6, alone);
            }
            Decision::Request { t, p, due, .. } => {
                let noted = self.account(t).and_then(|account| account.due(p));
                broken.insert_if(Claim::P8, noted != Some(due));
            }
            Decision::Hold { .. }
            | Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Drop { .. }
            | Decision::Cancel { .. } => {}
        }
    }

    /// Drops the due instants that bind nothing any more.
    fn forget(&mut self) {
        let now = self.now;
        for account in &mut self.open {
            let latest = account.timers().map(|(_, due)| due).max();
            account.stale = account.stale.filter(|due| *due > now && Some(*due) > latest);
        }
    }

    /// What holds between inputs.
    fn balance(&self, config: &Config, machine: &Machine, broken: &mut Claims) {
        let window = usize::from(config.window);
        broken.insert_if(Claim::P9, machine.fusion().len() > window || self.open.len() > window);
        for account in &self.open {
            let best = account.held.greatest();
            let overripe = best.is_some_and(|best| !account.pending.any_above(best));
            broken.insert_if(Claim::P4, overripe);
            let live = account.timers().next().is_some();
            // The latest due instant ever armed is over.
            let over = account.stale.is_none() && !account.timers().any(|(_, due)| due > self.now);
            broken.insert_if(Claim::P5, over && account.held.contains(0));
            broken.insert_if(Claim::P7, !live && (account.limited || !account.pending.contains(0)));
            broken.insert_if(Claim::P7, over && account.limited);
            broken.insert_if(Claim::P8, !self.has_timers_of(account, config, machine));
        }
        let next = self.open.iter().flat_map(Account::timers).map(|(_, due)| due).min();
        broken.insert_if(Claim::P8, machine.next_due() != next);
    }

    /// P8: the machine's timers are those that are owed, and none of them is overdue.
    fn has_timers_of(&self, account: &Account, config: &Config, machine: &Machine) -> bool {
        let mut sources = config.clouds.iter().map(|cloud| cloud.p).chain([0]);
        sources.all(|p| {
            let due = machine.fusion().due(Timestamp::new(account.t), Priority::new(p));
            let owed = account.due(p.into());
            due.map(Instant::as_nanos) == owed && owed.is_none_or(|due| due > self.now)
        })
    }

    /// Whether a deadline given now is over at once.
    fn is_past(&self, deadline: u64) -> bool {
        self.now.saturating_add(deadline) <= self.now
    }

    fn account_mut(&mut self, t: u64) -> Option<&mut Account> {
        self.open.iter_mut().find(|account| account.t == t)
    }

    fn retire(&mut self, t: u64) -> Option<Account> {
        let place = self.open.iter().position(|account| account.t == t)?;
        Some(self.open.remove(place))
    }
}

impl Account {
    fn new(t: u64) -> Self {
        Self {
            t,
            limited: false,
            requested: Set::LOCAL,
            pending: Set::LOCAL,
            held: Set::default(),
            late: Set::default(),
            live: [None; PRIORITIES],
            stale: None,
        }
    }

    /// The due instant of the live timer of `p`.
    pub(crate) fn due(&self, p: u64) -> Option<u64> {
        usize::try_from(p).ok().and_then(|p| *self.live.get(p)?)
    }

    /// The live timers with their due instants.
    pub(crate) fn timers(&self) -> impl Iterator<Item = (u64, u64)> {
        (0..).zip(self.live).filter_map(|(p, due)| Some((p, due?)))
    }

    fn arm(&mut self, p: u64, due: u64) {
        if let Some(live) = usize::try_from(p).ok().and_then(|p| self.live.get_mut(p)) {
            *live = Some(due);
        }
    }

    fn disarm(&mut self, p: u64) -> Option<u64> {
        let due = usize::try_from(p).ok().and_then(|p| self.live.get_mut(p)?.take());
        self.stale = self.stale.max(due);
        due
    }
}

#[cfg(test)]
mod tests;
