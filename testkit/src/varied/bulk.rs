//! Many timestamps at once: windows that are filled, emptied and filled again, and counts beyond 16
//! bits.

use fuseline_traces::Input;

use super::RunWriter;

/// The open timestamps that leave a full window.
#[derive(Clone, Copy)]
enum LeavingOrder {
    Newest,
    Oldest,
    /// Every second one.
    Alternate,
    Any,
}

impl RunWriter<'_> {
    /// Opens timestamps at one instant, some with an offer, so that many are due together.
    pub(super) fn flood(&mut self, count: u64) {
        let spans = [0; 4].map(|_| self.tenths(20, 90).max(1));
        // Each timestamp has many timers, or few.
        let is_dense = self.draw.one_in(3);
        for _ in 0..count {
            let (at, t) = (self.now(), self.next_t);
            let has_deadline = is_dense || self.draw.one_in(3);
            let deadline = has_deadline.then(|| spans[self.draw.index(4)]);
            self.open(at, t, deadline);
            let offers = if is_dense { 3 } else { u64::from(self.draw.one_in(3)) };
            for _ in 0..offers {
                let (p, deadline) = (self.cloud(), spans[self.draw.index(4)]);
                self.push(Input::Offer { at, t, p, deadline, backlog: 0 });
            }
            if offers == 1 && self.draw.one_in(2) {
                self.push(Input::Result { at, t, p: 0 });
            }
            if self.draw.one_in(24) {
                self.next_t = self.next_t.saturating_add(self.draw.between(1, 900));
            }
        }
    }

    /// Fills the window and tries two more.
    fn fill(&mut self) {
        let room = self.context.window().saturating_sub(self.context.open().len());
        self.flood(room as u64);
        // A flood ends some timestamps at once.
        while self.context.open().len() < self.context.window() && self.next_t < u64::MAX {
            let (at, t) = (self.now(), self.next_t);
            self.open(at, t, None);
        }
        for _ in 0..2 {
            let (at, t, deadline) = (self.now(), self.fresh(), self.deadline_of_local());
            self.open(at, t, deadline);
        }
    }

    /// Fills the window, lets some timestamps leave it, and fills it again, so that their places
    /// are reused. Then lets many timers fire at once.
    pub(super) fn fill_and_refill(&mut self) {
        self.fill();
        let window = self.context.window();
        let leaving =
            if self.draw.one_in(3) { 1 } else { self.draw.between(1, 1 + window as u64 / 2) };
        self.leave(usize::try_from(leaving).unwrap_or(1));
        self.look_back();
        self.steps(6);
        self.fill();
        self.steps(6);
        if let Some(due) = self.context.next_due() {
            let at = self.edge(due);
            self.push(Input::Tick { at });
        }
        self.steps(4);
        let at =
            self.now().saturating_add(self.time.scale.saturating_mul(self.draw.between(5, 12)));
        self.push(Input::Tick { at });
        self.is_long = false;
        self.steps(12);
    }

    fn leave(&mut self, count: usize) {
        let order = self.draw.weighed(&[
            (1, LeavingOrder::Newest),
            (1, LeavingOrder::Oldest),
            (1, LeavingOrder::Alternate),
            (1, LeavingOrder::Any),
        ]);
        let mut open: Vec<u64> = self.context.open().iter().copied().collect();
        match order {
            LeavingOrder::Newest => open.reverse(),
            LeavingOrder::Oldest => {}
            LeavingOrder::Alternate => open = open.into_iter().step_by(2).collect(),
            LeavingOrder::Any => self.draw.shuffle(&mut open),
        }
        open.truncate(count);
        for t in open {
            self.end(t);
        }
    }

    /// Gives messages with results until there are this many inputs, and then all kinds of steps.
    pub(super) fn pass_many(&mut self, inputs: usize) {
        while self.inputs.len() < inputs {
            self.make_room();
            let (at, t) = (self.now(), self.next_t);
            let deadline = self.draw.one_in(8).then(|| self.tenths(20, 60).max(1));
            self.open(at, t, deadline);
            if !self.draw.one_in(16) {
                self.push(Input::Result { at, t, p: 0 });
            }
            if self.draw.one_in(16) {
                let at = at.saturating_add(self.tenths(1, 30));
                self.push(Input::Tick { at });
            }
        }
        self.look_back();
        self.steps(60);
    }
}
