//! The report: the results of a run, for the tables and for `--json`.
//!
//! [`Reading`] takes the results from the trace. [`RunMetadata`] has the facts that are not in the
//! trace.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::Duration;

use fuseline_report::policies::{BoundedFigure, ComparedPolicy, ConstantPolicy, PolicyScore};
use fuseline_report::{
    ArrivalTime, COLUMNS, MessageRecord, Quantile, RequestRow, Totals, TraceStatistics,
};
use fuseline_tokio::{SourceTally, grpc};
use fuseline_traces::{Doubt, DoubtKind, Event, Events, Judge, Verdict};
use serde::Serialize;

use crate::duration::ms;
use crate::fault::Fault;
use crate::percentile::as_object;
use crate::run::metadata::RunMetadata;
use crate::run::plan::{CloudPlan, CloudServer, DeadlinePolicy, RunPlan};
use crate::run::queue::Queues;
use crate::run::sent::SentBytes;
use crate::run::served::Served;
use crate::table::share;

/// The result of a run.
#[derive(Debug, Serialize)]
pub(crate) struct RunReport {
    /// The number of messages that came: forwarded, missed, refused or open.
    pub(crate) messages: u64,
    /// `true` if the run was ended early.
    pub(crate) interrupted: bool,
    /// The number of frames per second.
    pub(crate) rate: f64,
    /// The longest deadline.
    pub(crate) deadline_ms: u64,
    /// The policy that chooses each message's deadline.
    pub(crate) policy: &'static str,
    /// The price of a millisecond of waiting, in points of AP; `None` if it has none.
    pub(crate) price_per_ms: Option<f64>,
    pub(crate) commit: &'static str,
    pub(crate) window: u16,
    /// The number of calls at once to one cloud.
    pub(crate) calls: usize,
    pub(crate) seed: u64,
    /// Local first, then the clouds.
    pub(crate) sources: Vec<SourceReport>,
    /// The number of messages without any result.
    pub(crate) missed: u64,
    /// The number of messages that were refused because the window was full.
    pub(crate) refused: u64,
    /// The number of messages that were open when the run ended.
    pub(crate) open: u64,
    #[serde(skip)]
    pub(crate) totals: Totals,
    /// The longest delay of a timer after its due instant, or `None` if no timer fired.
    pub(crate) timer_lag_ms: Option<f64>,
    /// The number of messages that some cloud would not have answered by the longest deadline.
    pub(crate) outage_messages: BoundedFigure<u64>,
    /// The number of messages over which the policies are compared, which are all that ended.
    #[serde(skip)]
    pub(crate) compared: u64,
    /// The policies, with fusion first.
    pub(crate) policies: Vec<PolicyReport>,
    pub(crate) trace: Verdict,
    /// The page of the run, if one is made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) page: Option<String>,
}

/// The results of one source in a run.
#[derive(Debug, Serialize)]
pub(crate) struct SourceReport {
    pub(crate) name: String,
    pub(crate) priority: u16,
    pub(crate) model: Option<String>,
    /// The reason why its server did not say what it serves. Then the model is the one that the
    /// user named.
    pub(crate) unsaid: Option<String>,
    /// `true` if its runtime and its network are emulated.
    pub(crate) emulated: bool,
    /// The drive that its network is taken from.
    pub(crate) drive: Option<String>,
    /// The number of messages that were answered with its result.
    pub(crate) forwarded: u64,
    /// `forwarded` as a share of all messages.
    pub(crate) share: f64,
    /// The outcomes of its offers, by name.
    pub(crate) requests: BTreeMap<&'static str, u64>,
    /// The reasons why it failed, each with its count.
    pub(crate) failures: BTreeMap<String, u64>,
    /// A remedy for the failures.
    #[serde(skip)]
    pub(crate) hint: Option<&'static str>,
    /// The bytes of its requests that were written.
    pub(crate) sent_bytes: u64,
}

/// One policy over the run's messages.
#[derive(Debug, Serialize)]
pub(crate) struct PolicyReport {
    pub(crate) policy: String,
    /// `None` if the accuracy of a model is unknown.
    pub(crate) mean_ap: Option<BoundedFigure<f64>>,
    pub(crate) in_time: BoundedFigure<u64>,
    /// The quantiles p50, p90 and p99, which are `null` without messages.
    #[serde(serialize_with = "as_object")]
    pub(crate) response_ms: [Option<Quantile>; 3],
    /// The median response time in outages, or `null` if there were none.
    pub(crate) outage_response_ms: Option<Quantile>,
    pub(crate) sent_bytes: u64,
    /// `true` if it may have sent more, because calls that it would have made were never begun or
    /// ended before their answer.
    pub(crate) sent_is_at_least: bool,
}

/// The facts in the trace, and its verdict.
pub(crate) struct Reading {
    pub(crate) statistics: TraceStatistics,
    pub(crate) queues: Queues,
    pub(crate) verdict: Verdict,
    /// The instant of its last line.
    pub(crate) ended_at: u64,
}

impl RunReport {
    /// Counts the line that has the run's notes.
    pub(crate) const fn count_noted_line(&mut self) {
        self.trace.lines += 1;
    }

    /// Returns the doubt about clouds that answered no request in time, although some requests
    /// failed or ran to their deadlines.
    pub(crate) fn silent_clouds(&self) -> Option<Doubt> {
        let clouds = self.totals.rows.iter().zip(&self.sources).skip(1);
        let is_silent = |row: &RequestRow| row.answered() == 0 && row.lost() > 0;
        let silent = clouds.filter(|(row, _)| is_silent(row));
        let found: Vec<String> = silent
            .clone()
            .map(|(row, source)| {
                let requests = row.requests();
                format!("{} answered none of its {requests} requests in time", source.name)
            })
            .collect();
        let count = silent.map(|(row, _)| row.requests()).sum();
        (count > 0).then(|| Doubt::new(DoubtKind::Silent, count, found.join("; ")))
    }
}

impl Reading {
    /// Reads a trace of this plan. The verdict calls it `name`.
    ///
    /// # Errors
    /// Returns an error if the trace cannot be read to its end.
    pub(crate) fn new(trace: &Path, name: &str, plan: &RunPlan) -> Result<Self, Fault> {
        let file =
            File::open(trace).map_err(|source| Fault::Open { name: name.to_owned(), source })?;
        let mut reader = Events::new(name, BufReader::new(file))?;
        let mut judge =
            Judge::new(name, reader.header()).with_header_annotations(reader.header_annotations());
        let priorities: Vec<u16> = plan.clouds.iter().map(|cloud| cloud.priority).collect();
        let mut queues = Queues::new(priorities.iter().copied(), plan.calls);
        let mut statistics = TraceStatistics::new(priorities, plan.commit, false);
        let mut ended_at = 0;
        while let Some(event) = reader.next_event()? {
            ended_at = match &event {
                Event::Input(input) => input.at(),
                Event::Decision(decision) => decision.at(),
            };
            judge.annotated_line(reader.line(), &event, reader.annotations());
            statistics.event(&event);
            queues.event(&event);
        }
        Ok(Self { statistics, queues, verdict: judge.finish(), ended_at })
    }

    /// Returns the report of the run.
    pub(crate) fn report(self, plan: &RunPlan, driven: &RunMetadata) -> RunReport {
        let totals = self.statistics.totals();
        let messages = self.messages(plan);
        let source = |row: &RequestRow, i: usize| {
            let cloud = i.checked_sub(1).and_then(|i| plan.clouds.get(i));
            let served = cloud.map_or_else(|| Served::local(&plan.local), |it| it.served.clone());
            let tally = driven.tally.sources.get(i);
            let failures = tally.map(failures).unwrap_or_default();
            SourceReport {
                name: cloud.map_or_else(|| "local".to_owned(), |cloud| cloud.name.clone()),
                priority: cloud.map_or(0, |cloud| cloud.priority),
                model: served.model,
                unsaid: served.describe_error,
                emulated: served.emulated,
                drive: served.drive,
                forwarded: row.forwarded(),
                share: share(row.forwarded(), totals.messages),
                requests: COLUMNS.iter().map(|(word, _)| *word).zip(row.counts).skip(1).collect(),
                hint: cloud.and_then(|cloud| hint(cloud, &failures)),
                failures,
                sent_bytes: tally.map_or(0, |tally| tally.sent_bytes),
            }
        };
        let sources = totals.rows.iter().enumerate().map(|(i, row)| source(row, i)).collect();
        RunReport {
            messages: totals.messages,
            interrupted: driven.interrupted,
            rate: plan.rate,
            deadline_ms: plan.deadline_ms,
            policy: plan.policy.as_str(),
            price_per_ms: (plan.policy == DeadlinePolicy::Expected).then_some(plan.price_per_ms),
            commit: plan.commit.as_str(),
            window: plan.window,
            calls: plan.calls,
            seed: plan.seed,
            sources,
            missed: totals.missed,
            refused: totals.refused,
            open: totals.open,
            timer_lag_ms: self.statistics.timer_lag().map(ms),
            outage_messages: outages(&messages, plan.deadline()),
            compared: messages.len() as u64,
            policies: policies(&messages, plan, &totals, driven),
            totals,
            trace: self.verdict,
            page: (driven.recording_error.is_none())
                .then(|| plan.page.as_ref().map(|it| it.name().to_owned()))
                .flatten(),
        }
    }

    /// Returns the messages with everything that is known about their results.
    fn messages(&self, plan: &RunPlan) -> Vec<MessageRecord> {
        // Local's result either came or is unknown. A cloud's call may have been ended, and then
        // its emulation knows how long it would have taken, but not how long it would have waited
        // for a link.
        let planned = |source: usize, opened: u64, t: u64| {
            let index = source.checked_sub(1).filter(|_| !plan.is_linked())?;
            let emulation = plan.clouds.get(index)?.emulation()?;
            let sent = self.queues.sent(index, t)?;
            let waited = Duration::from_nanos(sent.saturating_sub(opened));
            let reply = emulation.reply_after(Duration::from_nanos(sent), t);
            Some(reply.map_or(ArrivalTime::Never, |reply| ArrivalTime::At(waited + reply)))
        };
        self.statistics.messages(planned)
    }
}

/// Returns each policy's score over the same messages and requests.
fn policies(
    messages: &[MessageRecord],
    plan: &RunPlan,
    totals: &Totals,
    driven: &RunMetadata,
) -> Vec<PolicyReport> {
    let aps: Vec<Option<f64>> =
        [plan.local.ap].into_iter().chain(plan.clouds.iter().map(|it| it.served.ap)).collect();
    let deadline = plan.deadline();
    let sent: Vec<u64> = driven.tally.sources.iter().map(|tally| tally.sent_bytes).collect();
    let sent = SentBytes::new(&totals.rows, sent, &driven.begun);
    let report = |(policy, name): (ComparedPolicy, String)| {
        let (sent_bytes, sent_is_at_least) = sent.of(&policy);
        let PolicyScore { ap, in_time, quantiles, outage } = policy.score(messages, &aps, deadline);
        PolicyReport {
            policy: name,
            mean_ap: ap,
            in_time,
            response_ms: quantiles,
            outage_response_ms: outage,
            sent_bytes,
            sent_is_at_least,
        }
    };
    compared(plan).into_iter().map(report).collect()
}

/// Counts the messages that are in outages.
fn outages(messages: &[MessageRecord], deadline: Duration) -> BoundedFigure<u64> {
    messages.iter().fold(BoundedFigure::exactly(0), |sum, message| {
        let is_lost = message.is_in_outage(deadline);
        sum.add(match is_lost {
            Some(is_lost) => BoundedFigure::exactly(u64::from(is_lost)),
            None => BoundedFigure { at_least: 0, at_most: 1 },
        })
    })
}

/// The name of the row for the progressive commit rule.
pub(crate) const PROGRESSIVE: &str = "progressive";

/// Returns the policies to compare, with their names.
fn compared(plan: &RunPlan) -> Vec<(ComparedPolicy, String)> {
    let mut policies = vec![(ComparedPolicy::Fusion, "fusion".to_owned())];
    let priorities: Vec<u16> = plan.clouds.iter().map(|cloud| cloud.priority).collect();
    if plan.policy != DeadlinePolicy::Constant {
        let priorities = priorities.clone();
        let constant = ConstantPolicy { deadline: plan.deadline(), priorities };
        let name = format!("constant {} ms", plan.deadline_ms);
        policies.push((ComparedPolicy::Constant(constant), name));
    }
    policies.push((ComparedPolicy::LocalOnly, "local only".to_owned()));
    let clouds = plan.clouds.iter().enumerate();
    policies.extend(clouds.map(|(i, cloud)| {
        (ComparedPolicy::CloudOnly(i + 1), format!("cloud only: {}", cloud.name))
    }));
    policies.push((ComparedPolicy::FirstWins, "first response wins".to_owned()));
    policies.push((ComparedPolicy::Progressive(priorities), PROGRESSIVE.to_owned()));
    policies
}

/// Returns the reasons why a source failed, each with its count.
fn failures(tally: &SourceTally) -> BTreeMap<String, u64> {
    let reasons = &tally.reasons;
    let others = Some(("other reasons", reasons.others())).filter(|(_, count)| *count > 0);
    reasons.iter().chain(others).map(|(why, count)| (why.to_owned(), count)).collect()
}

/// Returns the remedy if each call broke a connection without TLS.
fn hint(cloud: &CloudPlan, failures: &BTreeMap<String, u64>) -> Option<&'static str> {
    let CloudServer::Remote(remote) = &cloud.server else { return None };
    let has_broken = cloud.served.describe_error.as_deref() == Some(grpc::CallError::BROKE);
    (has_broken && failures.contains_key(grpc::CallError::BROKE) && remote.url.starts_with("http:"))
        .then_some("if it speaks TLS, give an https URL and a ca")
}
