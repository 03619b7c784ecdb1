//! A part of a trace: some of its messages.

use std::collections::HashMap;

use fuseline_traces::{Decision, Event, Input, observed};

/// Selects messages of a trace. The default selects all of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TraceRange {
    /// Messages that begin this long after the trace's first instant, in nanoseconds, or later.
    pub from: u64,
    /// Messages that begin before this time.
    pub to: u64,
    /// Timestamps from this one on.
    pub first: u64,
    /// Timestamps up to this one.
    pub last: u64,
}

/// Decides for each event whether it belongs to the part. It remembers each message.
#[derive(Clone, Debug)]
pub struct PartFilter {
    part: TraceRange,
    /// The first instant.
    origin: Option<u64>,
    /// The greatest instant.
    greatest: u64,
    messages: HashMap<u64, PartMessage>,
    /// `true` if the last event was in the part.
    is_inside: bool,
}

/// The facts about a message.
#[derive(Clone, Copy, Debug)]
struct PartMessage {
    is_wanted: bool,
    is_open: bool,
    /// `true` if it has a result, a failure, an emit or a miss.
    is_touched: bool,
}

impl Default for TraceRange {
    fn default() -> Self {
        Self { from: 0, to: u64::MAX, first: 0, last: u64::MAX }
    }
}

impl PartFilter {
    /// Returns a filter for a trace from its first event on.
    #[must_use]
    pub fn new(part: TraceRange) -> Self {
        Self { part, origin: None, greatest: 0, messages: HashMap::new(), is_inside: false }
    }

    /// Returns `true` if the next event belongs to the part. A tick belongs by its instant, and any
    /// other event by its message.
    pub fn takes(&mut self, event: &Event) -> bool {
        let TraceRange { from, to, first, last } = self.part;
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.greatest = self.greatest.max(at);
        let since = at.saturating_sub(*self.origin.get_or_insert(at));
        let is_during = (from..to).contains(&since);
        self.is_inside = is_during;
        let Some(t) = event.t() else { return is_during };
        let message = self.messages.entry(t).or_insert(PartMessage {
            is_wanted: is_during && (first..=last).contains(&t),
            is_open: false,
            is_touched: false,
        });
        match event {
            Event::Input(Input::Open { .. }) => message.is_open = true,
            Event::Decision(Decision::RefuseOpen { .. }) => message.is_open = false,
            Event::Input(Input::Result { .. } | Input::Fail { .. })
            | Event::Decision(Decision::Emit { .. } | Decision::Miss { .. }) => {
                message.is_touched = true;
            }
            Event::Input(Input::Offer { .. } | Input::Tick { .. })
            | Event::Decision(
                Decision::Timer { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Request { .. }
                | Decision::Hold { .. }
                | Decision::Drop { .. }
                | Decision::Final { .. }
                | Decision::Cancel { .. },
            ) => {}
        }
        self.is_inside = message.is_wanted;
        message.is_wanted
    }

    /// Returns `true` if a violation belongs to the part. If it is about no message, it belongs
    /// with the last event.
    pub(crate) fn has(&self, t: Option<u64>) -> bool {
        let message = t.and_then(|t| self.messages.get(&t));
        message.map_or(self.is_inside, |message| message.is_wanted)
    }

    /// Ends the judge of the part alone at the instant at which the whole trace ends.
    pub(crate) fn ends(&self, mut alone: observed::Judge) -> Option<observed::Judge> {
        let (line, at) = (alone.so_far().lines, self.greatest);
        alone.line(line, &Event::Input(Input::Tick { at })).ok()?;
        Some(alone)
    }

    /// Returns the number of judged messages of the part.
    pub(crate) fn judged(&self) -> u64 {
        let judged =
            |message: &&PartMessage| message.is_wanted && message.is_open && message.is_touched;
        self.messages.values().filter(judged).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(at: u64, t: u64) -> Event {
        Event::Input(Input::Open { at, t, deadline: None })
    }

    #[test]
    fn a_message_is_of_the_part_in_which_it_begins() {
        let mut filter = PartFilter::new(TraceRange { from: 10, to: 20, ..TraceRange::default() });
        let takes = [(100, 1), (109, 2), (110, 3), (119, 4), (120, 5)]
            .map(|(at, t)| filter.takes(&open(at, t)));
        assert_eq!(takes, [false, false, true, true, false]);
        // Later events of a message belong where the message does.
        assert!(filter.takes(&Event::Input(Input::Result { at: 500, t: 3, p: 0 })));
        assert!(!filter.takes(&Event::Input(Input::Result { at: 115, t: 2, p: 0 })));
        assert!(!filter.takes(&Event::Input(Input::Tick { at: 500 })));
        assert!(filter.takes(&Event::Input(Input::Tick { at: 115 })));
        assert_eq!(filter.judged(), 1);
        assert!(filter.has(Some(4)) && !filter.has(Some(5)));
    }

    #[test]
    fn timestamps_are_taken_from_the_first_to_the_last() {
        let mut filter = PartFilter::new(TraceRange { first: 2, last: 3, ..TraceRange::default() });
        let takes = [1, 2, 3, 4].map(|t| filter.takes(&open(t, t)));
        assert_eq!(takes, [false, true, true, false]);
    }
}
