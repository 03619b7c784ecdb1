//! One message with as many requests as there are clouds, and many results.

use fuseline_traces::Input;

use super::RunWriter;

/// The end of a chain.
#[derive(Clone, Copy)]
enum ChainEnd {
    /// The other requests fail.
    Failures,
    /// The next timer fires, or the last one.
    NextTimer,
    AllTimers,
    /// The chain continues with later steps.
    Open,
}

impl RunWriter<'_> {
    /// Opens a message, offers it to nearly all clouds, and gives results. They come in ascending
    /// priority, so that they are held or rise, or in any order.
    pub(super) fn chain(&mut self) {
        self.make_room();
        let (at, t) = (self.now(), self.next_t);
        let deadline = self.draw.one_in(2).then(|| self.tenths(50, 200));
        self.open(at, t, deadline);
        let mut sources: Vec<u64> = self.header.clouds.iter().map(|cloud| cloud.p.into()).collect();
        self.draw.shuffle(&mut sources);
        if self.draw.one_in(2) {
            let count = self.draw.index(sources.len() + 1).max(1);
            sources.truncate(count);
        }
        // Some requests join while results are held (A29).
        let joins = self.draw.one_in(3).then(|| self.draw.index(sources.len() + 1));
        let mut joining = sources.split_off(sources.len() - joins.unwrap_or(0));
        let shared = self.tenths(20, 90);
        let is_shared = self.draw.one_in(4);
        for p in &sources {
            let deadline = if is_shared { shared } else { self.tenths(20, 90) };
            self.push(Input::Offer { at, t, p: *p, deadline, backlog: 0 });
        }
        let late = self.draw.one_in(4).then(|| sources.pop()).flatten();
        sources.push(0);
        if self.draw.one_in(3) {
            self.draw.shuffle(&mut sources);
        } else {
            sources.sort_unstable();
        }
        let all = sources.len();
        let count = match self.draw.between(0, 2) {
            0 => all,
            1 => all - 1,
            _ => self.draw.index(all + 1),
        };
        let moves = self.draw.one_in(3);
        for p in sources.into_iter().take(count) {
            let at = if moves { self.now().saturating_add(self.tenths(0, 1)) } else { self.now() };
            if self.draw.one_in(2) {
                self.join(t, &mut joining);
            }
            self.push(Input::Result { at, t, p });
            if self.draw.one_in(6) {
                self.poke_at(t, 2);
            }
        }
        while !joining.is_empty() {
            self.join(t, &mut joining);
        }
        if let Some(p) = late {
            self.give(self.now(), t, p);
        }
        self.end_chain(t);
    }

    /// Offers the message to the next cloud that joins later.
    fn join(&mut self, t: u64, joining: &mut Vec<u64>) {
        if let Some(p) = joining.pop() {
            let (at, deadline) = (self.now(), self.tenths(20, 90));
            self.push(Input::Offer { at, t, p, deadline, backlog: 0 });
        }
    }

    fn end_chain(&mut self, t: u64) {
        let end = self.draw.weighed(&[
            (2, ChainEnd::Failures),
            (3, ChainEnd::NextTimer),
            (1, ChainEnd::AllTimers),
            (2, ChainEnd::Open),
        ]);
        let requested = self.context.requested().iter().filter(|(u, _)| *u == t);
        let dues = requested.filter_map(|(t, p)| self.context.due(*t, *p));
        let due = match end {
            ChainEnd::Failures => {
                self.fail_above(t, 0);
                None
            }
            ChainEnd::NextTimer => dues.min(),
            ChainEnd::AllTimers => dues.max(),
            ChainEnd::Open => None,
        };
        if let Some(due) = due {
            let at = self.edge(due);
            self.push(Input::Tick { at });
        }
        if self.draw.one_in(3) {
            self.poke_at(t, 6);
        }
    }

    /// Ends the oldest timestamp if the window is full.
    pub(super) fn make_room(&mut self) {
        if self.context.open().len() < self.context.window() {
            return;
        }
        if let Some(t) = self.context.open().first().copied() {
            self.end(t);
        }
    }
}
