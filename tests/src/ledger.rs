//! The promises, read off inputs and decisions alone.

use std::collections::{BTreeMap, BTreeSet};

use fuseline_traces::{Commit, Decision, Header, Input};

/// Checks P1–P9 and P11 after each input, from what a machine said it did.
///
/// It knows no rule of decision: it keeps accounts of what was asked, what came, and what went.
pub struct Ledger {
    window: usize,
    commit: Commit,
    now: u64,
    open: BTreeMap<u64, Account>,
    /// The timestamps that were forwarded or missed.
    retired: BTreeSet<u64>,
}

/// One open timestamp.
#[derive(Default)]
struct Account {
    /// Every request's due instant, and the deadline's at 0.
    dues: BTreeMap<u64, u64>,
    /// What was asked of whom, and nothing came yet; local always is asked.
    pending: BTreeSet<u64>,
    /// The live timers (P8).
    timers: BTreeSet<u64>,
    /// The results in hand with the instants of their arrival.
    held: BTreeMap<u64, u64>,
    limited: bool,
}

type Check = Result<(), String>;

impl Ledger {
    /// An empty ledger for an operator so configured.
    #[must_use]
    pub const fn new(header: &Header) -> Self {
        Self {
            window: header.window as usize,
            commit: header.commit,
            now: 0,
            open: BTreeMap::new(),
            retired: BTreeSet::new(),
        }
    }

    /// Enters an input with the decisions about it and the next due instant after it.
    ///
    /// # Errors
    /// The promise that is broken, and how.
    pub fn enter(&mut self, input: &Input, decisions: &[Decision], next_due: Option<u64>) -> Check {
        self.now = self.now.max(input.at());
        let (firings, own) = decisions.split_at(own_begin(input, decisions));
        for decision in firings {
            self.decide(decision, None)?;
        }
        accounted(input, own)?;
        self.arrive(input, own);
        for decision in own {
            self.decide(decision, Some(input))?;
        }
        self.balance(next_due)
    }

    /// Books what came, unless it was refused or dropped.
    fn arrive(&mut self, input: &Input, own: &[Decision]) {
        let is_refused = |d: &Decision| {
            use Decision::{Drop, RefuseOffer, RefuseOpen};
            matches!(d, RefuseOpen { .. } | RefuseOffer { .. } | Drop { .. })
        };
        if own.iter().any(is_refused) {
            return;
        }
        let now = self.now;
        match *input {
            Input::Open { t, deadline, .. } => {
                let mut account = Account { limited: deadline.is_some(), ..Account::default() };
                account.pending.insert(0);
                if let Some(deadline) = deadline {
                    account.dues.insert(0, now.saturating_add(deadline));
                    account.timers.insert(0);
                }
                self.open.insert(t, account);
            }
            Input::Offer { t, p, deadline, .. } => {
                if let Some(account) = self.open.get_mut(&t) {
                    account.dues.insert(p, now.saturating_add(deadline));
                    account.pending.insert(p);
                    account.timers.insert(p);
                }
            }
            Input::Result { t, p, .. } => {
                if let Some(account) = self.open.get_mut(&t) {
                    account.pending.remove(&p);
                    account.held.insert(p, now);
                    // P8: what holding does to the timer.
                    if p == 0 || self.commit == Commit::Patient {
                        account.timers.remove(&p);
                    }
                }
            }
            Input::Fail { t, p, .. } => {
                if let Some(account) = self.open.get_mut(&t) {
                    account.pending.remove(&p);
                    account.timers.remove(&p);
                }
            }
            Input::Tick { .. } => {}
        }
    }

    fn decide(&mut self, decision: &Decision, input: Option<&Input>) -> Check {
        match *decision {
            Decision::Timer { t, p, .. } => self.fire(t, p),
            Decision::Emit { t, p, .. } => self.emit(t, p),
            Decision::Miss { t, .. } => {
                let account = self.retire(t)?;
                hold(account.held.is_empty() && account.pending.is_empty(), || {
                    format!("P5, P7: {t} was missed with something in hand or to come")
                })
            }
            Decision::Hold { t, p, .. } => {
                let outranked = self.account(t)?.pending.iter().any(|q| *q > p);
                hold(outranked, || format!("P4, P6: ({t}, {p}) was held for nothing"))
            }
            Decision::Cancel { p, .. } => hold(p > 0, || "local was cancelled".into()),
            Decision::Request { t, p, due, .. } => {
                let noted = self.account(t)?.dues.get(&p).copied();
                hold(noted == Some(due), || {
                    format!("P8: ({t}, {p}) is due at {due} after {input:?}")
                })
            }
            Decision::RefuseOpen { .. } | Decision::RefuseOffer { .. } | Decision::Drop { .. } => {
                Ok(())
            }
        }
    }

    fn fire(&mut self, t: u64, p: u64) -> Check {
        let now = self.now;
        let Some(account) = self.open.get_mut(&t) else {
            return Err(format!("P8: ({t}, {p}) fired though {t} is not open"));
        };
        let live = account.timers.remove(&p);
        account.pending.remove(&p);
        let due = account.dues.get(&p).copied();
        hold(live && due.is_some_and(|due| due <= now), || {
            format!("P8: ({t}, {p}), due at {due:?}, fired at {now}; live: {live}")
        })
    }

    fn emit(&mut self, t: u64, p: u64) -> Check {
        let account = self.retire(t)?;
        let best = account.held.last_key_value().map(|(best, _)| *best);
        hold(best == Some(p), || format!("P3: {p} went for {t}, in hand was {best:?}"))?;
        let (due, arrived) = (account.dues.get(&p), account.held.get(&p));
        hold(due.is_none_or(|due| arrived.is_some_and(|arrived| arrived < due)), || {
            format!("P2: ({t}, {p}) due at {due:?} arrived at {arrived:?}")
        })
    }

    /// P1: takes `t` out of the open ones, once.
    fn retire(&mut self, t: u64) -> Result<Account, String> {
        let account = self.open.remove(&t);
        let first = self.retired.insert(t);
        account.filter(|_| first).ok_or_else(|| format!("P1: {t} was not open, or retired before"))
    }

    /// What holds between inputs.
    fn balance(&self, next_due: Option<u64>) -> Check {
        let now = self.now;
        hold(self.open.len() <= self.window, || "P9: more open than the window allows".into())?;
        for (t, account) in &self.open {
            if let Some((best, _)) = account.held.last_key_value() {
                let outranked = account.pending.iter().any(|q| q > best);
                hold(outranked, || format!("P4: {t} holds {best}, nothing outranks it"))?;
            }
            let live = !account.timers.is_empty();
            hold(live || (account.pending.contains(&0) && !account.limited), || {
                format!("P7: {t} waits for nothing")
            })?;
            let latest = account.dues.values().max().copied();
            let promised = account.limited || account.held.contains_key(&0);
            hold(!promised || latest.is_some_and(|latest| latest > now), || {
                format!("P5, P7: {t} is open at {now}, the latest due instant was {latest:?}")
            })?;
        }
        let least = self.open.values().flat_map(Account::due).min();
        hold(least == next_due, || {
            format!("P8: next due is {least:?}, the machine says {next_due:?}")
        })?;
        hold(least.is_none_or(|due| due > now), || format!("F5: {least:?} was not served by {now}"))
    }

    fn account(&self, t: u64) -> Result<&Account, String> {
        self.open.get(&t).ok_or_else(|| format!("P11: {t} is not open"))
    }
}

impl Account {
    /// The due instants of the live timers.
    fn due(&self) -> impl Iterator<Item = u64> {
        self.timers.iter().filter_map(|p| self.dues.get(p).copied())
    }
}

/// Where the input's own decision begins, after what F5 does.
fn own_begin(input: &Input, decisions: &[Decision]) -> usize {
    let is_main = |decision: &Decision| !matches!(decision, Decision::Cancel { .. });
    let Some(last) = decisions.iter().rposition(is_main) else { return decisions.len() };
    let own = match input {
        Input::Offer { .. } | Input::Result { .. } => true,
        Input::Open { .. } => matches!(decisions[last], Decision::RefuseOpen { .. }),
        // Had a firing retired the timestamp, the failure would have been dropped after it.
        Input::Fail { t, .. } => match decisions[last] {
            Decision::Drop { .. } => true,
            Decision::Emit { t: of, .. } | Decision::Miss { t: of, .. } => of == *t,
            _ => false,
        },
        Input::Tick { .. } => false,
    };
    if own { last } else { decisions.len() }
}

/// P11: each input has its outcome, and one only.
fn accounted(input: &Input, own: &[Decision]) -> Check {
    let outputs = own.iter().filter(|d| !matches!(d, Decision::Cancel { .. })).count();
    let all = own.iter().all(|decision| match input {
        Input::Open { .. } => matches!(decision, Decision::RefuseOpen { .. }),
        Input::Offer { .. } => {
            matches!(decision, Decision::Request { .. } | Decision::RefuseOffer { .. })
        }
        Input::Result { .. } => !matches!(
            decision,
            Decision::RefuseOpen { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Request { .. }
                | Decision::Miss { .. }
                | Decision::Timer { .. }
        ),
        Input::Fail { .. } => matches!(
            decision,
            Decision::Drop { .. }
                | Decision::Emit { .. }
                | Decision::Miss { .. }
                | Decision::Cancel { .. }
        ),
        Input::Tick { .. } => false,
    });
    let some = outputs == 1 || !matches!(input, Input::Offer { .. } | Input::Result { .. });
    hold(all && some && outputs <= 1, || format!("P11: {input:?} has {own:?}"))
}

fn hold(holds: bool, otherwise: impl FnOnce() -> String) -> Check {
    if holds { Ok(()) } else { Err(otherwise()) }
}
