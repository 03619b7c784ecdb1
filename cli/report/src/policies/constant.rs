//! The outputs that the machine would have sent if every request had had the same deadline. They
//! are exact, or bounds if calls were ended early.

use std::time::Duration;

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Cloud, Commit, Decision, Header, Input, nanos};

use crate::quantile::{ArrivalTime, Response};
use crate::statistics::ForwardedOutput;

/// The only timestamp of each run.
const T: u64 = 0;

/// Fusion with one deadline for all requests.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ConstantPolicy {
    /// The deadline.
    pub deadline: Duration,
    /// The clouds' priorities, in the order of the sources. All are different.
    pub priorities: Vec<u16>,
}

impl ConstantPolicy {
    /// Returns the machine's own output for a message, or `None` if the message is missed.
    ///
    /// Each source's result arrives as given. An unknown arrival never happens.
    pub(super) fn forwarded(&self, arrivals: &[ArrivalTime]) -> Option<ForwardedOutput> {
        let mut machine = OneMessageMachine::new(self)?;
        machine.input(Input::Open { at: 0, t: T, deadline: None });
        let places = || [0].into_iter().chain(self.priorities.iter().copied().map(u64::from));
        for p in places().skip(1) {
            let deadline = nanos(self.deadline);
            machine.input(Input::Offer { at: 0, t: T, p, deadline, backlog: 0 });
        }
        let mut ends: Vec<(u64, Input)> =
            arrivals.iter().zip(places()).filter_map(|(arrival, p)| end(*arrival, p)).collect();
        ends.sort_by_key(|(at, _)| *at);
        for (at, end) in ends {
            machine.until(at);
            machine.input(end);
        }
        machine.until(u64::MAX);
        let (p, at) = machine.emitted?;
        let source = places().position(|priority| priority == p)?;
        Some(ForwardedOutput { source, response: Duration::from_nanos(at) })
    }
}

impl ConstantPolicy {
    /// Returns the response, and the sources whose results may come before `in_time`, whatever the
    /// unknown arrivals are.
    ///
    /// With one deadline for all requests, the machine forwards the best result that arrives before
    /// the deadline. It does so once all better sources have failed or are due. If there is no such
    /// result, it forwards local's result, whenever that arrives.
    pub(super) fn bounds(
        &self,
        arrivals: &[ArrivalTime],
        in_time: Duration,
    ) -> (Response, Vec<Option<usize>>) {
        let mut by_rank: Vec<usize> = (0..arrivals.len()).collect();
        by_rank.sort_by_key(|source| {
            source.checked_sub(1).map_or(0, |cloud| u64::from(self.priorities[cloud]))
        });
        let mut outcomes = MessageOutcomes { response: None, sources: Vec::new(), in_time };
        // The least and the greatest time until all better sources have ended.
        let (mut least, mut most) = (Duration::ZERO, Duration::ZERO);
        while let Some(source) = by_rank.pop() {
            let (response, ended) = match arrivals[source] {
                ArrivalTime::At(at) if at < self.deadline => {
                    outcomes.add(source, Response::exactly(Some(at)), least, most);
                    return outcomes.all();
                }
                ArrivalTime::After(bound) if bound < self.deadline => {
                    (Some(Response { least: bound, most: self.deadline }), (bound, self.deadline))
                }
                ArrivalTime::Failed(at) if at < self.deadline => (None, (at, at)),
                ArrivalTime::At(_)
                | ArrivalTime::After(_)
                | ArrivalTime::Failed(_)
                | ArrivalTime::Never => (None, (self.deadline, self.deadline)),
            };
            if source == 0 {
                // There is no other result, so the output is local's result or none.
                match arrivals[0] {
                    ArrivalTime::At(_) | ArrivalTime::After(_) => {
                        outcomes.add(0, arrivals[0].into(), least, most);
                    }
                    ArrivalTime::Failed(_) | ArrivalTime::Never => {}
                }
                if !matches!(arrivals[0], ArrivalTime::At(_)) {
                    outcomes.none();
                }
                return outcomes.all();
            }
            if let Some(response) = response {
                outcomes.add(source, response, least, most);
            }
            (least, most) = (least.max(ended.0), most.max(ended.1));
        }
        outcomes.none();
        outcomes.all()
    }
}

/// The possible outcomes of a message.
struct MessageOutcomes {
    response: Option<Response>,
    sources: Vec<Option<usize>>,
    in_time: Duration,
}

impl MessageOutcomes {
    /// Records that the result of `source` may be forwarded once it has come and the better sources
    /// have ended.
    fn add(&mut self, source: usize, response: Response, least: Duration, most: Duration) {
        self.widen(Response { least: response.least.max(least), most: response.most.max(most) });
        if response.least < self.in_time {
            self.sources.push(Some(source));
        }
        if response.most > self.in_time || response.least >= self.in_time {
            self.sources.push(None);
        }
    }

    /// Records that there may be no output.
    fn none(&mut self) {
        self.widen(Response::exactly(None));
        self.sources.push(None);
    }

    fn widen(&mut self, other: Response) {
        let Response { least, most } = self.response.unwrap_or(other);
        self.response =
            Some(Response { least: least.min(other.least), most: most.max(other.most) });
    }

    fn all(self) -> (Response, Vec<Option<usize>>) {
        (self.response.unwrap_or(Response::exactly(None)), self.sources)
    }
}

/// Returns when and how a source ends, if that is known.
fn end(arrival: ArrivalTime, p: u64) -> Option<(u64, Input)> {
    match arrival {
        ArrivalTime::At(at) => Some((nanos(at), Input::Result { at: nanos(at), t: T, p })),
        ArrivalTime::Failed(at) => Some((nanos(at), Input::Fail { at: nanos(at), t: T, p })),
        ArrivalTime::After(_) | ArrivalTime::Never => None,
    }
}

/// The machine with one timestamp.
struct OneMessageMachine {
    arbiter: Arbiter<15, 1>,
    /// The source whose result was forwarded, and when.
    emitted: Option<(u64, u64)>,
}

impl OneMessageMachine {
    fn new(constant: &ConstantPolicy) -> Option<Self> {
        let cloud = |p: &u16| Cloud { p: *p, name: None, limit: 1, resume: 0 };
        let clouds = constant.priorities.iter().map(cloud).collect();
        // All timers fire at one instant, so both rules decide the same.
        let header = Header { operator: None, window: 1, commit: Commit::Eager, clouds };
        Some(Self { arbiter: Arbiter::new(&header).ok()?, emitted: None })
    }

    /// Fires each timer that is due by this instant.
    fn until(&mut self, at: u64) {
        while let Some(due) = self.arbiter.next_due().filter(|due| *due <= at) {
            self.input(Input::Tick { at: due });
        }
    }

    fn input(&mut self, input: Input) {
        let emitted = &mut self.emitted;
        self.arbiter.decide(&input, |decision| {
            if let Decision::Emit { at, p, .. } = decision {
                *emitted = Some((p, at));
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn at(millis: u64) -> ArrivalTime {
        ArrivalTime::At(ms(millis))
    }

    /// Plays one message. The first cloud outranks the second.
    fn forwarded(arrivals: [ArrivalTime; 3]) -> Option<(usize, u128)> {
        let constant = ConstantPolicy { deadline: ms(500), priorities: vec![9, 4] };
        let forwarded = constant.forwarded(&arrivals)?;
        Some((forwarded.source, forwarded.response.as_millis()))
    }

    #[test]
    fn a_message_ends_as_the_machine_ends_it() {
        let (failed, never) = (|millis| ArrivalTime::Failed(ms(millis)), ArrivalTime::Never);
        for (arrivals, expected) in [
            ([at(300), at(150), at(100)], Some((1, 150))),
            // An available result waits for a better one until the due instant, which itself is
            // late.
            ([at(300), at(500), at(100)], Some((2, 500))),
            ([at(300), at(499), at(100)], Some((1, 499))),
            ([at(300), at(600), at(100)], Some((2, 500))),
            ([at(300), never, never], Some((0, 500))),
            ([at(700), never, at(600)], Some((0, 700))),
            // The machine does not wait for a source that failed or got no request.
            ([at(300), failed(40), at(100)], Some((2, 100))),
            ([at(300), failed(0), failed(0)], Some((0, 300))),
            ([at(300), failed(350), failed(320)], Some((0, 350))),
            ([failed(0), never, failed(0)], None),
            ([at(300), ArrivalTime::After(ms(200)), at(100)], Some((2, 500))),
        ] {
            assert_eq!(forwarded(arrivals), expected, "{arrivals:?}");
        }
    }
}
