//! The doubts that an observed trace leaves (SPEC.md, *Doubts*).

use super::open::{ObservedOutput, OpenMessageHistory, WholeMessageHistory};
use super::slack::SourceSlack;
use crate::annotations::Annotations;
use crate::doubt::{Doubt, DoubtKind, DoubtfulMessages};
use crate::event::{Commit, Decision, Event, Header, Input};

/// Collects the doubts: the facts that the judge cannot see.
#[derive(Clone, Debug)]
pub(super) struct DoubtTracker {
    is_progressive: bool,
    /// Local, then the clouds of the header.
    sources: Vec<SourceAccount>,
    /// The number of sources that were not heard of yet.
    unheard: usize,
    /// The number of deadlines that are no longer than the delay that passes as in time.
    coarse: u64,
    /// The number of all deadlines.
    deadlines: u64,
    unopened: DoubtfulMessages,
    /// The messages without an output whose deadlines are over, with the instants of their opens.
    waiting: Vec<(u64, u64)>,
    unfinished: DoubtfulMessages,
    /// The latest open of a message with an output.
    answered: Option<u64>,
    /// The number of messages that have requests.
    requested: u64,
    /// `true` if the stamps of one message tell some order.
    is_ordered: bool,
}

/// The facts about one source.
#[derive(Clone, Debug)]
struct SourceAccount {
    p: u64,
    name: String,
    /// The number of deadlines that it was given.
    deadlines: u64,
    /// The earliest due instant of these deadlines.
    least_due: Option<u64>,
    /// `true` if it returned or failed once. This does not matter for local.
    is_heard: bool,
    /// The number of its requests that ran to their deadlines.
    ran_out: u64,
}

impl DoubtTracker {
    pub(super) fn new(header: &Header) -> Self {
        let clouds = header.clouds.iter().map(|cloud| {
            let p = u64::from(cloud.p);
            let name = cloud.name.clone().unwrap_or_else(|| format!("p {p}"));
            SourceAccount::new(p, name)
        });
        Self {
            is_progressive: header.commit == Commit::Progressive,
            sources: std::iter::once(SourceAccount::new(0, "local".to_owned()))
                .chain(clouds)
                .collect(),
            unheard: header.clouds.len(),
            coarse: 0,
            deadlines: 0,
            unopened: DoubtfulMessages::default(),
            waiting: Vec::new(),
            unfinished: DoubtfulMessages::default(),
            answered: None,
            requested: 0,
            is_ordered: false,
        }
    }

    /// Notes a line of the trace.
    pub(super) fn sees(
        &mut self,
        at: u64,
        event: &Event,
        annotations: &Annotations,
        slack: &SourceSlack,
    ) {
        match *event {
            Event::Input(Input::Open { deadline, .. }) => {
                if let Some(deadline) = deadline {
                    self.takes_deadline(0, at, at.saturating_add(deadline), slack);
                }
                if let Some(due) = annotations.due(at) {
                    self.takes_deadline(0, at, due, slack);
                }
            }
            Event::Decision(Decision::Request { p, due, .. }) => {
                self.takes_deadline(p, at, due, slack);
            }
            Event::Input(Input::Result { p, .. } | Input::Fail { p, .. }) if self.unheard > 0 => {
                let mut silent = self.sources.iter_mut().filter(|source| !source.is_heard);
                if let Some(source) = silent.find(|source| source.p == p) {
                    source.is_heard = true;
                    self.unheard -= 1;
                }
            }
            Event::Input(_) | Event::Decision(_) => {}
        }
    }

    fn takes_deadline(&mut self, p: u64, at: u64, due: u64, slack: &SourceSlack) {
        let Some(source) = self.sources.iter_mut().find(|source| source.p == p) else { return };
        source.deadlines += 1;
        source.least_due = Some(source.least_due.map_or(due, |least| least.min(due)));
        self.deadlines += 1;
        self.coarse += u64::from(due.saturating_sub(at) <= slack.unnoticed(p));
    }

    /// Notes a message that was judged, with `true` if it breaks a rule, and the instant by which
    /// its output was due.
    pub(super) fn closes(
        &mut self,
        t: u64,
        open: &OpenMessageHistory,
        whole: &WholeMessageHistory,
        slack: &SourceSlack,
        (is_broken, end): (bool, u64),
    ) {
        if !whole.is_opened() {
            self.unopened.push(t);
        }
        let story = &whole.story;
        let out = whole.outputs.iter().chain(whole.finals).map(|output| output.at).min();
        if !story.requests.is_empty() {
            self.requested += 1;
            // One such message is enough.
            self.is_ordered |= open.span() > slack.greatest().saturating_mul(2);
            if self.unheard > 0 {
                self.runs_out(whole, slack, end);
            }
        }
        let Some((at, deadline)) = story.open else { return };
        if out.is_some() {
            self.answered = self.answered.max(Some(at));
            return;
        }
        // While a deadline runs, the message waits for it (P7).
        let local = deadline.map(|deadline| at.saturating_add(deadline));
        let dues = story.requests.iter().map(|(_, _, due)| *due).chain(local);
        let is_over = |due: u64| due.saturating_add(slack.reach()) <= end;
        if !is_broken && dues.into_iter().all(is_over) {
            self.waiting.push((at, t));
        }
    }

    /// Returns `true` if the stamps of some message show an order, so that the other messages'
    /// stamps do not matter.
    pub(super) const fn is_ordered(&self) -> bool {
        self.is_ordered
    }

    /// Counts the requests of unheard clouds that were still awaited at their due instants. Under
    /// progressive a message continues to wait for sources that outrank its output.
    fn runs_out(&mut self, whole: &WholeMessageHistory, slack: &SourceSlack, end: u64) {
        let &WholeMessageHistory { ref story, outputs, finals, .. } = whole;
        for source in self.sources.iter_mut().filter(|source| !source.is_heard) {
            let due = story.requests.iter().find(|(p, ..)| *p == source.p).map(|(.., due)| *due);
            let is_last = |output: &&ObservedOutput| {
                !self.is_progressive || output.p.is_none_or(|p| p > source.p)
            };
            let retired = outputs.iter().filter(is_last).chain(finals).map(|output| output.at);
            let tolerance = slack.tolerance_of(source.p).saturating_add(slack.tolerance());
            let by = retired.min().unwrap_or(end).saturating_add(tolerance);
            source.ran_out += u64::from(due.is_some_and(|due| due <= by));
        }
    }

    /// Notes that a message that was taken for one without an open is opened after all.
    pub(super) fn opens_late(&mut self, t: u64) {
        self.unopened.remove(t);
    }

    /// Notes a message of an ended run that waits for local.
    pub(super) fn leaves_unfinished(&mut self, t: u64) {
        self.unfinished.push(t);
    }

    /// Returns the doubts that are left after the whole trace was read.
    pub(super) fn doubts(
        self,
        judged: u64,
        is_ended: bool,
        slack: &SourceSlack,
        span: Option<(u64, u64)>,
    ) -> Vec<Doubt> {
        let blurred = span.and_then(|span| self.blurred(judged, slack, span));
        let endless = span.and_then(|(_, end)| self.endless(end));
        let whole = [self.silent(), self.coarse(slack), blurred, endless];
        let mut unanswered = DoubtfulMessages::default();
        let answered = self.answered.filter(|_| !is_ended);
        for (at, t) in self.waiting {
            if answered.is_some_and(|answered| at < answered) {
                unanswered.push(t);
            }
        }
        let of_messages = [
            Doubt::unjudged(judged),
            unanswered.doubt(DoubtKind::Unanswered),
            self.unfinished.doubt(DoubtKind::Unfinished),
            self.unopened.doubt(DoubtKind::Unopened),
        ];
        of_messages.into_iter().chain(whole).flatten().collect()
    }

    fn silent(&self) -> Option<Doubt> {
        let silent = self.sources.iter().filter(|source| !source.is_heard && source.ran_out > 0);
        let told: Vec<_> = silent
            .clone()
            .map(|source| match source.deadlines {
                1 => format!("{} did not answer its one request", source.name),
                all => format!("{} answered none of its {all} requests", source.name),
            })
            .collect();
        let count = silent.map(|source| source.deadlines).sum();
        (!told.is_empty()).then(|| Doubt::new(DoubtKind::Silent, count, told.join("; ")))
    }

    fn coarse(&self, slack: &SourceSlack) -> Option<Doubt> {
        let late = nanos(slack.unnoticed(0));
        let found = format!(
            "{} of {} deadlines are no longer than {late} (the lateness plus twice the tolerance), \
             so late results may pass; give both as small as the clocks allow",
            self.coarse, self.deadlines
        );
        (self.coarse > 0).then(|| Doubt::new(DoubtKind::Coarse, self.coarse, found))
    }

    fn blurred(&self, judged: u64, slack: &SourceSlack, (from, to): (u64, u64)) -> Option<Doubt> {
        let (span, reach) = (to - from, slack.unnoticed(0));
        let is_all = span <= reach && reach > 0;
        let twice = slack.greatest().saturating_mul(2);
        let is_each = self.requested > 0 && !self.is_ordered && twice > 0;
        if judged == 0 || !(is_all || is_each) {
            return None;
        }
        let found = if is_all {
            format!(
                "the whole trace lies within {}, but the lateness plus twice the tolerance is {}",
                nanos(span),
                nanos(reach)
            )
        } else {
            format!(
                "all lines of each message with a request lie within {}, twice the tolerance",
                nanos(twice)
            )
        };
        let count = if is_all { judged } else { self.requested };
        Some(Doubt::new(DoubtKind::Blurred, count, found))
    }

    fn endless(&self, end: u64) -> Option<Doubt> {
        let is_endless = |source: &&SourceAccount| source.least_due.is_some_and(|due| due > end);
        let endless = self.sources.iter().filter(is_endless);
        let told: Vec<_> = endless
            .clone()
            .map(|source| match source.deadlines {
                1 => format!("the one deadline of {}", source.name),
                all => format!("all {all} deadlines of {}", source.name),
            })
            .collect();
        let count = endless.map(|source| source.deadlines).sum();
        let found = || format!("{} end after the trace; is their unit right?", told.join(" and "));
        (count > 0).then(|| Doubt::new(DoubtKind::Endless, count, found()))
    }
}

impl SourceAccount {
    const fn new(p: u64, name: String) -> Self {
        Self { p, name, deadlines: 0, least_due: None, is_heard: p == 0, ran_out: 0 }
    }
}

/// Writes a time in the greatest unit that leaves at most three decimals.
pub(super) fn nanos(span: u64) -> String {
    let units = [
        (31_557_600_000_000_000, "years"),
        (86_400_000_000_000, "days"),
        (3_600_000_000_000, "h"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
        (1_000, "µs"),
    ];
    let Some((unit, name)) = units.into_iter().find(|(unit, _)| span >= *unit) else {
        return format!("{span} ns");
    };
    let thousandths = u128::from(span) * 1000 / u128::from(unit);
    let (whole, part) = (thousandths / 1000, thousandths % 1000);
    let part = format!("{part:03}");
    let part = part.trim_end_matches('0');
    if part.is_empty() { format!("{whole} {name}") } else { format!("{whole}.{part} {name}") }
}
