//! Compares the counts of a report with a recount of the same trace that uses plain lists.

use std::collections::BTreeMap;
use std::time::Duration;

use fuseline_report::{ArrivalTime, Quantile, TimestampOutcome, TraceStatistics};
use fuseline_testkit::{Generator, Run};
use fuseline_traces::{Commit, Decision, Event, ExpectedDecisions, Input, Reference};

/// The outcome of a request, in the order of the report's columns.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum RequestFate {
    Forwarded = 1,
    Discarded = 2,
    Late = 3,
    Failed = 4,
    Superseded = 5,
    Open = 6,
}

#[derive(Default)]
struct RecountedMessage {
    opened: u64,
    /// The source whose result was sent last, and when the message ended; none of the first if it
    /// was missed.
    last: Option<(u64, u64)>,
    end: Option<(Option<u64>, u64)>,
    /// By source; local is 0.
    fates: BTreeMap<u64, RequestFate>,
    /// The instants at which failures came that were accepted.
    failed: BTreeMap<u64, u64>,
}

#[derive(Default)]
struct Recount {
    messages: BTreeMap<u64, RecountedMessage>,
    /// The instants at which each source's first result for each timestamp came, whatever became of
    /// it.
    arrived: BTreeMap<(u64, u64), u64>,
    refused_messages: u64,
    refused: BTreeMap<u64, u64>,
    timer_lag: Option<u64>,
}

/// A run's events, and where each was due.
fn events(run: &Run) -> Vec<Event> {
    let (mut reference, mut decisions) = (Reference::new(&run.header), ExpectedDecisions::new());
    let mut events = Vec::new();
    for input in &run.inputs {
        events.push(Event::Input(*input));
        reference.apply(input, &mut decisions);
        events.extend(decisions.drain(..).map(|(decision, _)| Event::Decision(decision)));
    }
    events
}

impl Recount {
    fn of(events: &[Event], commit: Commit) -> Self {
        let (mut count, mut dues) = (Self::default(), BTreeMap::new());
        // The input that decisions are about, and whether one of them dropped it.
        for (index, event) in events.iter().enumerate() {
            let own = events[index + 1..].iter().take_while(|it| matches!(it, Event::Decision(_)));
            match *event {
                Event::Input(Input::Open { at, t, deadline }) => {
                    let is_refused = own
                        .clone()
                        .any(|it| matches!(it, Event::Decision(Decision::RefuseOpen { .. })));
                    if !is_refused {
                        let fates = BTreeMap::from([(0, RequestFate::Open)]);
                        let message = RecountedMessage { opened: at, fates, ..Default::default() };
                        count.messages.insert(t, message);
                        dues.extend(deadline.map(|deadline| ((t, 0), at.saturating_add(deadline))));
                    }
                }
                Event::Input(Input::Result { at, t, p }) => {
                    count.arrived.entry((t, p)).or_insert(at);
                }
                Event::Input(Input::Fail { at, t, p }) => {
                    let is_dropped =
                        own.clone().any(|it| matches!(it, Event::Decision(Decision::Drop { .. })));
                    if !is_dropped {
                        count.ends(t, p, RequestFate::Failed);
                        count.messages.get_mut(&t).unwrap().failed.insert(p, at);
                    }
                }
                Event::Input(Input::Offer { .. } | Input::Tick { .. }) => {}
                Event::Decision(decision) => count.decision(&decision, commit, &mut dues),
            }
        }
        count
    }

    fn decision(
        &mut self,
        decision: &Decision,
        commit: Commit,
        dues: &mut BTreeMap<(u64, u64), u64>,
    ) {
        match *decision {
            Decision::RefuseOpen { .. } => self.refused_messages += 1,
            Decision::RefuseOffer { p, .. } => *self.refused.entry(p).or_default() += 1,
            Decision::Request { t, p, due, .. } => {
                let message = self.messages.get_mut(&t).unwrap();
                message.fates.insert(p, RequestFate::Open);
                dues.insert((t, p), due);
            }
            Decision::Timer { at, t, p } => {
                self.ends(t, p, RequestFate::Late);
                self.timer_lag = self.timer_lag.max(Some(at - dues[&(t, p)]));
            }
            Decision::Cancel { t, p, .. } => self.ends(t, p, RequestFate::Superseded),
            Decision::Hold { t, p, .. } => self.ends(t, p, RequestFate::Discarded),
            Decision::Emit { at, t, p } => {
                self.ends(t, p, RequestFate::Discarded);
                let message = self.messages.get_mut(&t).unwrap();
                message.last = Some((p, at));
                if commit != Commit::Progressive {
                    message.end = Some((Some(p), at));
                }
            }
            // Its last output was the answer.
            Decision::Final { t, p, .. } => {
                let message = self.messages.get_mut(&t).unwrap();
                let (last, at) = message.last.unwrap();
                assert_eq!(last, p);
                message.end = Some((Some(p), at));
            }
            Decision::Miss { at, t } => self.messages.get_mut(&t).unwrap().end = Some((None, at)),
            Decision::Drop { .. } => {}
        }
    }

    /// The request is pending no more; what ended before stays so.
    fn ends(&mut self, t: u64, p: u64, fate: RequestFate) {
        let fates = &mut self.messages.get_mut(&t).unwrap().fates;
        if fates.get(&p) == Some(&RequestFate::Open) {
            fates.insert(p, fate);
        }
    }
}

impl RecountedMessage {
    fn fate(&self, p: u64) -> Option<RequestFate> {
        Some(match (*self.fates.get(&p)?, self.end) {
            (RequestFate::Discarded, Some((by, _))) if by == Some(p) => RequestFate::Forwarded,
            // The fate of a held result is open as long as its message is.
            (RequestFate::Discarded, None) => RequestFate::Open,
            (RequestFate::Open, Some(_)) => RequestFate::Superseded,
            (fate, _) => fate,
        })
    }
}

/// By nearest ranks; none of these is a message that never ends.
fn quantiles(mut times: Vec<Option<u64>>) -> [Option<Quantile>; 3] {
    times.sort_by_key(|time| time.unwrap_or(u64::MAX));
    [50, 90, 99].map(|percent| {
        let rank = (times.len() * percent).div_ceil(100);
        let time = times.get(rank.max(1) - 1)?;
        Some(time.map_or(Quantile::Never, |it| Quantile::Exactly(Duration::from_nanos(it))))
    })
}

/// D11.
#[test]
fn each_count_share_and_quantile_is_that_of_a_recount() {
    for commit in Commit::ALL {
        let generator = Generator { seed: 29, commit: Some(commit), clouds: 5 };
        for number in 0..600 {
            let run = generator.run(number);
            let events = events(&run);
            let clouds: Vec<u16> = run.header.clouds.iter().map(|cloud| cloud.p).collect();
            let mut statistics = TraceStatistics::new(clouds.clone(), commit, false);
            for event in &events {
                statistics.event(event);
            }
            compare(&statistics, &Recount::of(&events, commit), &clouds);
        }
    }
}

fn compare(statistics: &TraceStatistics, count: &Recount, clouds: &[u16]) {
    let totals = statistics.totals();
    let ended = |is: fn(Option<Option<u64>>) -> bool| {
        let ends = count.messages.values().map(|message| message.end.map(|(by, _)| by));
        ends.filter(|end| is(*end)).count() as u64
    };
    let refused = count.refused_messages;
    let missed = ended(|end| end == Some(None));
    let open = ended(|end| end.is_none());
    let forwarded = ended(|end| end.flatten().is_some());
    assert_eq!(
        [totals.messages, totals.forwarded, totals.missed, totals.refused, totals.open],
        [count.messages.len() as u64 + refused, forwarded, missed, refused, open]
    );
    assert_eq!(statistics.timer_lag(), count.timer_lag.map(Duration::from_nanos));
    let times = |p: Option<u64>| {
        let ends = count.messages.values().filter_map(move |message| {
            let (by, at) = message.end?;
            let is_counted = p.is_none() || by == p;
            is_counted.then(|| by.map(|_| at - message.opened))
        });
        ends.collect::<Vec<_>>()
    };
    let never = usize::try_from(refused).unwrap();
    let all = times(None).into_iter().chain(std::iter::repeat_n(None, never)).collect();
    assert_eq!(totals.response, quantiles(all));
    let priorities = [0].into_iter().chain(clouds.iter().map(|p| u64::from(*p)));
    assert_eq!(
        totals.rows.iter().map(|row| row.p).collect::<Vec<_>>(),
        priorities.collect::<Vec<_>>()
    );
    for row in &totals.rows {
        let mut counts = [0; 8];
        for fate in count.messages.values().filter_map(|message| message.fate(row.p)) {
            counts[0] += 1;
            counts[fate as usize] += 1;
        }
        counts[7] = count.refused.get(&row.p).copied().unwrap_or(0);
        assert_eq!((row.counts, row.requests(), row.refused()), (counts, counts[0], counts[7]));
        assert_eq!((row.forwarded(), row.answered()), (counts[1], counts[1] + counts[2]));
        assert_eq!(row.response, quantiles(times(Some(row.p))));
    }
    for (t, message) in &count.messages {
        let outcome = match message.end {
            Some((Some(p), _)) => TimestampOutcome::Forwarded { p },
            Some((None, _)) => TimestampOutcome::Missed,
            None => TimestampOutcome::Open,
        };
        assert_eq!(statistics.outcome(*t), outcome);
        for row in &totals.rows {
            let fate = message.fate(row.p).map(|fate| fate as usize);
            assert_eq!(statistics.request_outcome(*t, row.p), fate);
        }
    }
    records(statistics, count, &totals.rows.iter().map(|row| row.p).collect::<Vec<_>>());
}

/// Compares the records of messages that ended.
fn records(statistics: &TraceStatistics, count: &Recount, priorities: &[u64]) {
    let since = |message: &RecountedMessage, at: u64| {
        Duration::from_nanos(at.saturating_sub(message.opened))
    };
    let at_once = ArrivalTime::Failed(Duration::ZERO);
    // A timestamp that was never opened looks as if it had failed at once.
    let ended = count.messages.iter().filter(|(t, message)| {
        let has_failed_at_once = message.failed.get(&0).is_some_and(|at| *at <= message.opened)
            && !count.arrived.contains_key(&(**t, 0));
        message.end.is_some_and(|(by, _)| by.is_some() || !has_failed_at_once)
    });
    let records = statistics.messages(|_, _, _| None);
    let mut records =
        records.iter().filter(|it| it.forwarded.is_some() || it.arrivals[0] != at_once);
    for (t, message) in ended {
        let (record, (by, at)) = (records.next().unwrap(), message.end.unwrap());
        let forwarded = record.forwarded.map(|it| (priorities[it.source], it.response));
        assert_eq!(forwarded, by.map(|p| (p, since(message, at))));
        for (arrival, p) in record.arrivals.iter().zip(priorities) {
            let is_requested = message.fates.contains_key(p);
            match (count.arrived.get(&(*t, *p)), message.failed.get(p)) {
                _ if !is_requested => assert_eq!(*arrival, at_once),
                (Some(at), _) => assert_eq!(*arrival, ArrivalTime::At(since(message, *at))),
                (None, Some(at)) => assert_eq!(*arrival, ArrivalTime::Failed(since(message, *at))),
                (None, None) => assert!(matches!(arrival, ArrivalTime::After(_))),
            }
        }
    }
    assert_eq!(records.next(), None);
}
