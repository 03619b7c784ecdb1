//! A naive engine with plain lists, written from the engine's documentation. The reference machine
//! decides.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fuseline_engine::{Commit, DropReason, Ending, Item, Local, Overflow, Trigger};
use fuseline_traces::{Decision, ExpectedDecisions, Header, Input, Reference};

/// A value that states its message and its source.
pub(crate) type MarkedValue = (u64, u16);

/// The settings of an engine.
#[derive(Clone, Debug)]
pub(crate) struct EngineSettings {
    pub(crate) header: Header,
    pub(crate) local: Local,
    /// For each cloud of the header: calls at once, how long they linger, and whether a policy
    /// chooses.
    pub(crate) clouds: Vec<(usize, u64, bool)>,
    pub(crate) reserve: u64,
}

/// The calls or computations of one source, as they wait or run.
#[derive(Default)]
struct NaiveSource {
    p: u16,
    name: String,
    at_once: usize,
    linger: u64,
    has_policy: bool,
    waiting: Vec<NaiveRequest>,
    running: Vec<NaiveRequest>,
    lingering: Vec<NaiveRequest>,
    replaced: Vec<NaiveRequest>,
}

#[derive(Clone, Copy)]
struct NaiveRequest {
    t: u64,
    requested_at: u64,
    due: Option<u64>,
    /// Before the start, how long it may run. Afterwards, the instant when it counts as lost.
    lost: Option<u64>,
    spent: u64,
}

struct NaiveMessage {
    opened: u64,
    /// The instant when its end-to-end deadline ends.
    within: Option<u64>,
    arrived: BTreeMap<u64, u64>,
    failures: Vec<(u16, String)>,
    items: u32,
}

pub(crate) struct NaiveEngine {
    settings: EngineSettings,
    reference: Reference,
    sources: Vec<NaiveSource>,
    messages: BTreeMap<u64, NaiveMessage>,
    /// The opening instants of the last 1024 messages.
    opened: BTreeMap<u64, u64>,
    /// The effects since they were last taken.
    pub(crate) effects: Vec<String>,
    /// The reports to policies.
    pub(crate) reports: Vec<String>,
    /// The counts by metric and labels.
    pub(crate) counts: BTreeMap<String, u64>,
}

/// Returns the deadline that the policy chooses, which depends on the number of unanswered calls.
pub(crate) fn choice(ages: &[Duration], cap: Duration) -> Duration {
    cap / (1 + u32::try_from(ages.len() % 3).unwrap())
}

/// Describes an item, except for the fields that are the same in all of this test's items.
pub(crate) fn shown(item: &Item<MarkedValue>) -> String {
    let ending = match &item.ending {
        Ending::Preliminary(it) | Ending::Forwarded(it) => {
            let word = if item.is_last() { "forwarded" } else { "preliminary" };
            assert_eq!(it.source.priority, it.value.1);
            format!("{word} {:?} arrived {} by {}", it.value, it.arrived.as_nanos(), it.trigger)
        }
        Ending::Final(source) => format!("final {}", source.priority),
        Ending::Missed => "missed".into(),
        Ending::Refused(why) => format!("refused {}", why.as_str()),
    };
    let failures = item.failures.iter().map(|it| (it.source.priority, it.why.to_string()));
    let (opened, decided) = (item.opened.as_nanos(), item.decided.as_nanos());
    let failures: Vec<_> = failures.collect();
    output(item.timestamp, [opened, decided], item.revision, &ending, &failures)
}

fn output(
    t: u64,
    [opened, decided]: [u128; 2],
    revision: u32,
    ending: &str,
    failures: &[(u16, String)],
) -> String {
    format!("output {t} from {opened} at {decided} revision {revision}: {ending} {failures:?}")
}

impl NaiveEngine {
    pub(crate) fn new(settings: &EngineSettings) -> Self {
        let at_once = settings.local.at_once;
        let local = NaiveSource { name: "local".into(), at_once, ..NaiveSource::default() };
        let clouds = settings.header.clouds.iter().zip(&settings.clouds).map(|(cloud, set)| {
            let (at_once, linger, has_policy) = *set;
            let (p, name) = (cloud.p, cloud.name.clone().unwrap());
            NaiveSource { p, name, at_once, linger, has_policy, ..NaiveSource::default() }
        });
        Self {
            reference: Reference::new(&settings.header),
            sources: [local].into_iter().chain(clouds).collect(),
            settings: settings.clone(),
            messages: BTreeMap::new(),
            opened: BTreeMap::new(),
            effects: Vec::new(),
            reports: Vec::new(),
            counts: BTreeMap::new(),
        }
    }

    /// Opens a message and makes its offers (F1).
    pub(crate) fn open(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<u64>,
        within: Option<u64>,
        offers: &[(u16, u64)],
    ) {
        self.begin(at);
        let end = within.map(|within| at.saturating_add(within));
        let deadline = deadline.into_iter().chain(end.map(|end| (end - at).max(1))).min();
        let decided = self.decide(at, &Input::Open { at, t, deadline });
        let now = self.reference.now();
        if let Some(decision) = decided.into_iter().next() {
            let Decision::RefuseOpen { why, .. } = decision else { panic!("{decision:?}") };
            self.count(&format!("refused_messages {}", why.as_str()));
            let (times, ending) = ([now.into(); 2], format!("refused {}", why.as_str()));
            self.effects.push(output(t, times, 0, &ending, &[]));
            return self.start(now);
        }
        self.count("messages");
        self.count("requests local admitted");
        let (arrived, failures) = (BTreeMap::new(), Vec::new());
        let message = NaiveMessage { opened: now, within: end, arrived, failures, items: 0 };
        self.messages.insert(t, message);
        self.opened.insert(t, now);
        if self.opened.len() > 1024 {
            self.opened.pop_first();
        }
        let (due, spent) = (None, 0);
        let job = NaiveRequest { t, requested_at: now, due, lost: deadline, spent };
        self.sources[0].waiting.push(job);
        self.start(now);
        for (p, deadline) in offers {
            self.offer(at, t, *p, *deadline);
        }
        if self.sources[0].waiting.len() > self.settings.local.waiting.unwrap_or(usize::MAX) {
            let thrown_out = match self.settings.local.overflow {
                Overflow::DropOldest => self.sources[0].waiting[0].t,
                Overflow::DropNewest => t,
            };
            self.fail(at, thrown_out, 0, "too many computations wait");
        }
    }

    /// Offers a request (F2).
    pub(crate) fn offer(&mut self, at: u64, t: u64, p: u16, deadline: u64) {
        if self.reference.next_due().is_some_and(|due| due <= at) {
            self.tick(at);
        }
        self.begin(at);
        let index = self.index(p);
        let backlog = index.map_or(0, |index| self.sources[index].waiting.len() as u64);
        let within = self.messages.get(&t).and_then(|message| message.within);
        let (reserve, mut spent) = (self.settings.reserve, 0);
        let mut deadline = deadline;
        if let Some(within) = within {
            deadline = deadline.min(within.saturating_sub(reserve).saturating_sub(at));
            spent = reserve;
        }
        let input = |deadline| Input::Offer { at, t, p: p.into(), deadline, backlog };
        let mut tried = ExpectedDecisions::new();
        self.reference.clone().apply(&input(deadline), &mut tried);
        let is_refused = matches!(tried[..], [(Decision::RefuseOffer { .. }, _)]);
        if let Some(index) = index.filter(|index| *index > 0 && deadline > 0)
            && (!self.sources[index].has_policy || !is_refused)
        {
            let mut why = "offered";
            if self.sources[index].has_policy {
                let ages = self.ages(index, at);
                let cap = Duration::from_nanos(deadline + spent);
                self.reports.push(format!("{p} decide {ages:?} {cap:?}"));
                let chosen = choice(&ages, cap).as_nanos();
                deadline = deadline.min(u64::try_from(chosen).unwrap().saturating_sub(spent));
                why = "constant";
            }
            let name = self.sources[index].name.clone();
            self.count(&format!("deadlines {name} {why}"));
        }
        for decision in self.decide(at, &input(deadline)) {
            let Some(index) = index else { continue };
            let name = self.sources[index].name.clone();
            match decision {
                Decision::RefuseOffer { why, .. } => {
                    self.count(&format!("requests {name} {}", why.as_str()));
                }
                Decision::Request { at, due, .. } => {
                    self.count(&format!("requests {name} admitted"));
                    let (due, lost, requested_at) = (Some(due), None, at);
                    let request = NaiveRequest { t, requested_at, due, lost, spent };
                    self.sources[index].waiting.push(request);
                }
                other => panic!("{other:?}"),
            }
        }
        self.start(self.reference.now());
    }

    /// Applies a result (F3).
    pub(crate) fn result(&mut self, at: u64, t: u64, p: u16) {
        self.begin(at);
        self.ended(at, t, p, "Answered");
        let decided = self.decide(at, &Input::Result { at, t, p: p.into() });
        let now = self.reference.now();
        if let Some(index) = self.index(p) {
            let name = self.sources[index].name.clone();
            let is_dropped = matches!(decided[0], Decision::Drop { .. });
            if let Some(message) = self.messages.get_mut(&t).filter(|_| !is_dropped) {
                message.arrived.insert(p.into(), now);
            }
            match (decided[0], decided.last()) {
                (Decision::Drop { why, .. }, _) => {
                    self.count(&format!("results {name} {}", why.as_str()));
                    let opened = self.opened.get(&t).copied();
                    if let (DropReason::Late | DropReason::Superseded, Some(opened)) = (why, opened)
                    {
                        let age = now - opened;
                        self.effects.push(format!("hint {t} {p} {age} {}", why.as_str()));
                    }
                }
                (Decision::Hold { .. }, _) => self.count(&format!("results {name} held")),
                (Decision::Emit { .. }, last)
                    if self.settings.header.commit == Commit::Progressive
                        && !matches!(last, Some(Decision::Final { .. })) =>
                {
                    self.count(&format!("results {name} preliminary"));
                }
                _ => self.count(&format!("results {name} forwarded")),
            }
            self.settle(&decided, Trigger::Arrival);
        }
        self.start(now);
    }

    /// Applies a failure (F4).
    pub(crate) fn fail(&mut self, at: u64, t: u64, p: u16, why: &str) {
        self.begin(at);
        self.ended(at, t, p, "Failed");
        let decided = self.decide(at, &Input::Fail { at, t, p: p.into() });
        if let Some(index) = self.index(p) {
            let name = self.sources[index].name.clone();
            if let Some(Decision::Drop { why, .. }) = decided.first() {
                self.count(&format!("failures {name} {}", why.as_str()));
            } else {
                self.count(&format!("failures {name} accepted"));
                let message = self.messages.get_mut(&t).expect("it is open");
                message.failures.push((p, why.to_owned()));
                self.settle(&decided, Trigger::Failure);
            }
        }
        self.start(self.reference.now());
    }

    /// Lets time pass (F5).
    pub(crate) fn tick(&mut self, at: u64) {
        self.begin(at);
        assert_eq!(self.decide(at, &Input::Tick { at }), []);
        self.start(self.reference.now());
    }

    /// Returns the next instant when something happens by itself.
    pub(crate) fn next_due(&self) -> Option<u64> {
        let lingering = self.sources.iter().flat_map(|source| {
            source.lingering.iter().map(|call| call.due.unwrap().saturating_add(source.linger))
        });
        let local = &self.sources[0];
        let is_noticed = !self.settings.local.may_lose_results || !local.waiting.is_empty();
        let lost = local.running.iter().filter_map(|job| job.lost).filter(|_| is_noticed);
        self.reference.next_due().into_iter().chain(lingering).chain(lost).min()
    }

    /// Returns the values of the gauges.
    pub(crate) fn gauges(&self) -> BTreeMap<String, usize> {
        let of_source = self.sources.iter().flat_map(|source| {
            let name = &source.name;
            [
                (format!("backlog {name}"), source.waiting.len()),
                (format!("calls {name}"), source.running.len()),
            ]
        });
        of_source.chain([("open_messages".to_owned(), self.messages.len())]).collect()
    }

    /// Returns the sources and messages whose completions may come.
    pub(crate) fn running(&self) -> BTreeSet<(u16, u64)> {
        let of = |source: &NaiveSource| {
            let all = [&source.running, &source.lingering, &source.replaced];
            let p = source.p;
            all.into_iter().flatten().map(move |it| (p, it.t)).collect::<Vec<_>>()
        };
        self.sources.iter().flat_map(of).collect()
    }

    /// Fires timers, and ends the calls that have lingered long enough (F0).
    fn begin(&mut self, at: u64) {
        for index in 0..self.sources.len() {
            let linger = self.sources[index].linger;
            let is_over = |call: &NaiveRequest| call.due.unwrap().saturating_add(linger) <= at;
            while let Some(which) = self.sources[index].lingering.iter().position(is_over) {
                let call = self.sources[index].lingering.remove(which);
                self.abandon(at, index, call, true);
            }
        }
    }

    /// Fires due timers first, and returns the decisions about the input itself.
    fn decide(&mut self, at: u64, input: &Input) -> Vec<Decision> {
        let mut fired = ExpectedDecisions::new();
        self.reference.apply(&Input::Tick { at }, &mut fired);
        let fired: Vec<Decision> = fired.into_iter().map(|(decision, _)| decision).collect();
        self.settle(&fired, Trigger::Timer);
        let mut own = ExpectedDecisions::new();
        self.reference.apply(input, &mut own);
        own.into_iter().map(|(decision, _)| decision).collect()
    }

    /// Carries out decisions that close requests or end messages.
    fn settle(&mut self, decided: &[Decision], trigger: Trigger) {
        let is_progressive = self.settings.header.commit == Commit::Progressive;
        for (place, decision) in decided.iter().enumerate() {
            match *decision {
                Decision::Timer { at, t, p } => {
                    self.count_of(p, "timers");
                    self.close(at, t, p);
                }
                Decision::Cancel { at, t, p } => {
                    self.count_of(p, "cancelled");
                    self.close(at, t, p);
                }
                Decision::Emit { at, t, p } => {
                    let rest = &decided[place + 1..];
                    let is_last = !is_progressive
                        || rest
                            .iter()
                            .any(|it| matches!(it, Decision::Final { t: of, .. } if *of == t));
                    let arrived = self.messages[&t].arrived[&p];
                    let word = if is_last { "forwarded" } else { "preliminary" };
                    let value = (t, u16::try_from(p).unwrap());
                    let ending = format!("{word} {value:?} arrived {arrived} by {trigger}");
                    if is_last {
                        self.count_of(p, &format!("outputs {{}} {trigger}"));
                    }
                    self.output(at, t, &ending, is_last);
                }
                Decision::Final { at, t, p } => {
                    if self.messages.contains_key(&t) {
                        self.count_of(p, "outputs {} final");
                        self.output(at, t, &format!("final {p}"), true);
                    }
                }
                Decision::Miss { at, t } => {
                    self.count("missed_messages");
                    self.output(at, t, "missed", true);
                }
                Decision::Hold { .. } | Decision::Drop { .. } => {}
                other => panic!("{other:?}"),
            }
        }
    }

    fn output(&mut self, at: u64, t: u64, ending: &str, is_last: bool) {
        if self.settings.local.skip_answered {
            self.sources[0].waiting.retain(|job| job.t != t);
        }
        let message = self.messages.get_mut(&t).unwrap();
        let times = [message.opened, at].map(u128::from);
        self.effects.push(output(t, times, message.items, ending, &message.failures));
        message.items += 1;
        if is_last {
            self.messages.remove(&t);
        }
    }

    /// Closes a request whose result is no longer wanted. Local continues.
    fn close(&mut self, at: u64, t: u64, p: u64) {
        let index = self.index(u16::try_from(p).unwrap()).unwrap();
        if index == 0 {
            return;
        }
        let source = &mut self.sources[index];
        if let Some(call) = take(&mut source.running, t) {
            if source.linger == 0 {
                return self.abandon(at, index, call, true);
            }
            source.lingering.push(call);
            if source.lingering.len() > source.at_once {
                let oldest = source.lingering.remove(0);
                self.abandon(at, index, oldest, true);
            }
        } else if let Some(request) = take(&mut source.waiting, t) {
            self.abandon(at, index, request, false);
        }
    }

    fn abandon(&mut self, at: u64, index: usize, request: NaiveRequest, was_sent: bool) {
        if was_sent {
            self.effects.push(format!("abort {} {}", self.sources[index].p, request.t));
        }
        self.report(at, index, request, "Censored");
    }

    /// Notes a request that ended by itself.
    fn ended(&mut self, at: u64, t: u64, p: u16, how: &str) {
        let Some(index) = self.index(p) else { return };
        let source = &mut self.sources[index];
        let lists =
            [&mut source.running, &mut source.lingering, &mut source.replaced, &mut source.waiting];
        let request = lists.into_iter().find_map(|list| take(list, t));
        if let Some(request) = request {
            self.report(at, index, request, how);
        }
    }

    fn report(&mut self, at: u64, index: usize, request: NaiveRequest, how: &str) {
        let source = &self.sources[index];
        if source.has_policy {
            let age = at.saturating_sub(request.requested_at) + request.spent;
            self.reports.push(format!("{} {how}({:?})", source.p, Duration::from_nanos(age)));
        }
    }

    /// Returns the ages of all unanswered requests, the oldest first (T5).
    fn ages(&self, index: usize, at: u64) -> Vec<Duration> {
        let source = &self.sources[index];
        let all = [&source.running, &source.lingering, &source.waiting];
        let ages = all.into_iter().flatten();
        let mut ages: Vec<_> = ages
            .map(|it| Duration::from_nanos(at.saturating_sub(it.requested_at) + it.spent))
            .collect();
        ages.sort_unstable();
        ages.reverse();
        ages
    }

    /// Removes lost computations, and starts what waits (D13).
    fn start(&mut self, now: u64) {
        let is_lost = |job: &NaiveRequest| job.lost.is_some_and(|lost| lost <= now);
        while let Some(which) = self.sources[0].running.iter().position(is_lost) {
            self.count("lost local");
            let local = &mut self.sources[0];
            if self.settings.local.may_lose_results {
                local.running.remove(which);
            } else if local.replaced.len() < self.settings.local.replaceable {
                let job = local.running.remove(which);
                self.effects.push(format!("replace {}", job.t));
                local.replaced.push(NaiveRequest { lost: None, ..job });
            } else {
                local.running[which].lost = None;
            }
        }
        for source in &mut self.sources {
            while source.running.len() < source.at_once && !source.waiting.is_empty() {
                let request = source.waiting.remove(0);
                let until = request.due.map(|due| due.saturating_add(source.linger));
                self.effects.push(format!("start {} {} until {until:?}", source.p, request.t));
                let lost = request.lost.map(|after| now.saturating_add(after));
                source.running.push(NaiveRequest { lost, ..request });
            }
        }
    }

    fn index(&self, p: u16) -> Option<usize> {
        self.sources.iter().position(|source| source.p == p)
    }

    fn count_of(&mut self, p: u64, metric: &str) {
        let index = self.index(u16::try_from(p).unwrap()).unwrap();
        let name = self.sources[index].name.clone();
        match metric.split_once(" {}") {
            Some((metric, rest)) => self.count(&format!("{metric} {name}{rest}")),
            None => self.count(&format!("{metric} {name}")),
        }
    }

    fn count(&mut self, metric: &str) {
        *self.counts.entry(metric.to_owned()).or_default() += 1;
    }
}

fn take(requests: &mut Vec<NaiveRequest>, t: u64) -> Option<NaiveRequest> {
    let which = requests.iter().position(|request| request.t == t)?;
    Some(requests.remove(which))
}
