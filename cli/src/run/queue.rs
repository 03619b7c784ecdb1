//! Finds the instant when each request was sent, since a request waits until a call to its cloud
//! may begin.

use std::collections::{HashMap, HashSet, VecDeque};

use fuseline_traces::{Decision, Event, Input};

/// The clouds' calls under way and the requests that wait, as read from a trace.
pub(crate) struct Queues {
    at_once: usize,
    clouds: Vec<(u64, OutgoingQueue)>,
}

#[derive(Default)]
struct OutgoingQueue {
    waiting: VecDeque<u64>,
    under_way: HashSet<u64>,
    sent: HashMap<u64, u64>,
}

impl Queues {
    /// Creates empty queues for clouds of these priorities, each with at most `at_once` calls at a
    /// time.
    pub(crate) fn new(clouds: impl IntoIterator<Item = u16>, at_once: usize) -> Self {
        let clouds = clouds.into_iter().map(|p| (u64::from(p), OutgoingQueue::default())).collect();
        Self { at_once, clouds }
    }

    pub(crate) fn event(&mut self, event: &Event) {
        let (at, t, p, is_request) = match *event {
            Event::Decision(Decision::Request { at, t, p, .. }) => (at, t, p, true),
            Event::Input(Input::Result { at, t, p } | Input::Fail { at, t, p })
            | Event::Decision(Decision::Timer { at, t, p } | Decision::Cancel { at, t, p }) => {
                (at, t, p, false)
            }
            Event::Input(Input::Open { .. } | Input::Offer { .. } | Input::Tick { .. })
            | Event::Decision(
                Decision::RefuseOpen { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Hold { .. }
                | Decision::Drop { .. }
                | Decision::Emit { .. }
                | Decision::Final { .. }
                | Decision::Miss { .. },
            ) => return,
        };
        let Some((_, queue)) = self.clouds.iter_mut().find(|(cloud, _)| *cloud == p) else {
            return;
        };
        if is_request {
            queue.waiting.push_back(t);
        } else {
            queue.end(at, t);
        }
        queue.send(at, self.at_once);
    }

    /// Returns the instant when the request for a timestamp was sent. A request that ended while it
    /// waited counts as sent at its end, because its turn would not have come earlier.
    pub(crate) fn sent(&self, cloud: usize, t: u64) -> Option<u64> {
        self.clouds.get(cloud)?.1.sent.get(&t).copied()
    }
}

impl OutgoingQueue {
    fn end(&mut self, at: u64, t: u64) {
        if !self.under_way.remove(&t)
            && let Some(index) = self.waiting.iter().position(|waiting| *waiting == t)
        {
            self.waiting.remove(index);
            self.sent.insert(t, at);
        }
    }

    fn send(&mut self, at: u64, at_once: usize) {
        while self.under_way.len() < at_once
            && let Some(t) = self.waiting.pop_front()
        {
            self.under_way.insert(t);
            self.sent.insert(t, at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_sent_when_its_turn_comes_or_counts_as_sent_when_it_is_ended() {
        let mut queues = Queues::new([7], 1);
        let request = |at, t| Event::Decision(Decision::Request { at, t, p: 7, due: 99 });
        for event in [
            request(0, 0),
            request(1, 1),
            request(2, 2),
            request(3, 3),
            // Local's results change nothing, and neither do requests that have already ended.
            Event::Input(Input::Result { at: 4, t: 0, p: 0 }),
            Event::Decision(Decision::Cancel { at: 5, t: 2, p: 7 }),
            Event::Input(Input::Fail { at: 6, t: 2, p: 7 }),
            Event::Input(Input::Result { at: 8, t: 0, p: 7 }),
            Event::Decision(Decision::Timer { at: 9, t: 1, p: 7 }),
        ] {
            queues.event(&event);
        }
        let sent = [0, 1, 2, 3, 4].map(|t| queues.sent(0, t));
        assert_eq!(sent, [Some(0), Some(8), Some(5), Some(9), None]);
    }
}
