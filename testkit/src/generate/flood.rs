//! Many timestamps at once: the window is filled, emptied and filled again.

use fuseline_traces::{Header, Input};

use super::InputGenerator;

/// The number of timestamps that leave a full window before it is filled again.
const LEAVING: usize = 200;

/// The open timestamps that leave a full window.
#[derive(Clone, Copy)]
pub(super) enum DepartureOrder {
    Newest,
    Oldest,
    /// Every second one.
    Alternate,
    Any,
}

impl DepartureOrder {
    pub(super) const ALL: [Self; 4] = [Self::Newest, Self::Oldest, Self::Alternate, Self::Any];
}

impl InputGenerator {
    /// Opens many timestamps at one instant, with an offer each, so that many are due together.
    pub(super) fn flood(&mut self, count: u64, header: &Header) {
        for i in 0..count {
            let (at, t) = (self.context.now(), self.next_t);
            let deadline = i.is_multiple_of(3).then_some(20 + i % 7);
            self.open(at, t, deadline);
            let p = self.cloud(header);
            self.push(Input::Offer { at, t, p, deadline: 20 + i % 5, backlog: 0 });
            if i.is_multiple_of(2) {
                self.push(Input::Result { at, t, p: 0 });
            }
        }
    }

    /// Fills the window, lets many timestamps leave it, and fills it again, so that their places
    /// are reused.
    pub(super) fn refill(&mut self, leaving: DepartureOrder, header: &Header) {
        let room = self.context.window().saturating_sub(self.context.open().len());
        self.flood(room as u64, header);
        let mut open: Vec<u64> = self.context.open().iter().copied().collect();
        match leaving {
            DepartureOrder::Newest => open.reverse(),
            DepartureOrder::Oldest => {}
            DepartureOrder::Alternate => open = open.into_iter().step_by(2).collect(),
            DepartureOrder::Any => self.draw.shuffle(&mut open),
        }
        open.truncate(LEAVING);
        for t in &open {
            let at = self.context.now();
            self.fail_above(*t, 0);
            self.push(Input::Result { at, t: *t, p: 0 });
        }
        self.flood(open.len() as u64 + 1, header);
        if self.draw.one_in(2) {
            // Some of those that wait are retired by their timers.
            let at = self.context.next_due().unwrap_or(self.context.now());
            self.push(Input::Tick { at });
        }
    }
}
