//! `fuseline scenario link`: what a link of finite width does to requests, and what helps.

mod plots;
mod run;
mod text;

use std::fmt;

use rayon::prelude::*;
use serde::{Serialize, Serializer};

use crate::fault::Fault;
use crate::plot::{PageContent, show};
use crate::scenario::link::run::{LinkRun, RequestStream};
use crate::scenario::options::{OutputOptions, above_0, not_below_0};

/// What the page says first.
const WORDS: &str = "Requests wait in one queue for the vehicle's uplink, replies in one for its downlink. Each takes its \
    bytes over the rate. A request that finds no room fails at once, a reply is lost. What the queue has taken is sent, also \
    when its call was given up.";
/// What is modelled.
const MODEL: &str = "Rates and the round trip are constant here. Local is DETR-ResNet-50, the cloud DINO-SWIN-Tiny, unless \
    the options say otherwise; their AP is COCO's. That a better answer is worth its AP is a choice of ours.";
/// What the operators that share a link send, in bytes.
const SHARED: [u64; 3] = [33_300, 300_000, 1_000_000];
/// Local's AP, and that of each of the three operators' clouds: DINO-SWIN-Tiny, DETR-ResNet-101-DC, DETR-ResNet-101.
const APS: [[f64; 2]; 3] = [[42.0, 51.3], [42.0, 44.9], [42.0, 43.5]];
/// How often they send, in Hz.
const SHARED_RATE: f64 = 10.0;

#[derive(clap::Args)]
#[command(after_help = "\
Requests wait in one queue for the uplink, replies in one for the downlink, each
for its bytes over the rate. The round trip and the cloud's runtime come between.
A request that finds no room in the queue fails at once; a reply that finds none
is lost. What a queue has taken is sent, also when its call was given up.

The remedies: none, where every message is sent; a gate that shuts when so many
requests are neither answered nor given up, with rate times deadline, which is
the default of adapters, and with 1; every n-th message, with the least n for
which the uplink carries what is sent; a send budget of the uplink's rate, which
spends bytes where the policy expects most gain from them.

The second table has three operators on one uplink, at 10 Hz with 33.3 KB, 300
KB and 1 MB a message. Their clouds gain 9.3, 2.9 and 1.5 points of AP over local.

Exit code 0 when done, 2 if an option or a folder is of no use.

Examples:
  fuseline scenario link
  fuseline scenario link --request-kb 120 --rate 15 --uplink 8,12 --deadline 0.3
  fuseline scenario link --json")]
pub(crate) struct Args {
    /// Sizes of a request, in KB.
    #[arg(long, value_name = "KB,…", value_delimiter = ',', default_value = "33.3,300,1000", value_parser = kilobytes)]
    request_kb: Vec<f64>,
    /// Messages in a second, in Hz.
    #[arg(long, value_name = "HZ,…", value_delimiter = ',', default_value = "10,30", value_parser = rate)]
    rate: Vec<f64>,
    /// Rates of the uplink, in Mbit/s.
    #[arg(long, value_name = "MBIT/S,…", value_delimiter = ',', default_value = "1,2,5,10,20,50,100", value_parser = mbits)]
    uplink: Vec<f64>,
    /// The rate of the downlink, in Mbit/s.
    #[arg(long, value_name = "MBIT/S", default_value = "100", value_parser = mbits)]
    downlink: f64,
    /// How much may wait in each queue, in KB.
    #[arg(long, value_name = "KB", default_value = "4000", value_parser = kilobytes)]
    queue_kb: f64,
    /// The round trip of an empty message, in s.
    #[arg(long, value_name = "S", default_value = "0.068", value_parser = not_below_0)]
    round_trip: f64,
    /// How long the cloud computes, in s.
    #[arg(long, value_name = "S", default_value = "0.0901", value_parser = not_below_0)]
    cloud_runtime: f64,
    /// How long local computes, in s.
    #[arg(long, value_name = "S", default_value = "0.3017", value_parser = response)]
    local_response: f64,
    /// How long a cloud may take, in s.
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = above_0)]
    deadline: f64,
    /// How long each run lasts, in s.
    #[arg(long, value_name = "S", default_value = "30", value_parser = span)]
    seconds: f64,
    #[command(flatten)]
    leave: OutputOptions,
}

/// What keeps the queue short.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Remedy {
    None,
    /// A gate of this limit.
    Gate(u64),
    EveryNth,
    Budget,
}

/// How deadlines are chosen.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DeadlineRule {
    Constant,
    Expected,
}

/// One operator on an uplink of its own.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct LinkRow {
    request_kb: f64,
    rate: f64,
    uplink_mbps: f64,
    remedy: Remedy,
    policy: DeadlineRule,
    /// All messages' bits in a second over the uplink's.
    load: f64,
    messages: u32,
    requests: u32,
    /// Requests for which the queue had no room.
    dropped: u32,
    /// The share of messages whose output is the cloud's.
    by_cloud: f64,
    /// The mean time from a message to its output, in s.
    mean_response: f64,
}

/// Operators that share an uplink.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct SharedRow {
    uplink_mbps: f64,
    remedy: Remedy,
    load: f64,
    /// The mean of the outputs' AP less local's, over all operators.
    gain: f64,
    /// By operator: the share of messages whose output is the cloud's.
    by_cloud: Vec<f64>,
}

/// The parameters in force; seconds.
#[derive(Clone, Copy, Serialize)]
struct LinkParameters {
    downlink_mbps: f64,
    queue_kb: f64,
    round_trip: f64,
    cloud_runtime: f64,
    local_response: f64,
    deadline: f64,
    seconds: f64,
}

/// All that is shown.
#[derive(Clone, Serialize)]
pub(crate) struct LinkResult {
    scenario: &'static str,
    parameters: LinkParameters,
    rows: Vec<LinkRow>,
    shared: Vec<SharedRow>,
}

pub(crate) fn play(args: &Args) -> Result<(), Fault> {
    let result = LinkResult {
        scenario: "link",
        parameters: args.parameters(),
        rows: args.rows(),
        shared: args.shared(),
    };
    let text = text::text(&result);
    // No trace is kept: a run has hundreds of operators.
    let [_, plots] = args.leave.folders()?;
    if let Some(folder) = plots {
        let (words, plots) = ([WORDS, MODEL], plots::plots(&result));
        show(
            &folder,
            &PageContent {
                title: "A link with a width",
                words: &words,
                animations: Vec::new(),
                plots,
                reported: &text,
            },
        )?;
    }
    args.leave.print_report(&result, &text)
}

impl Args {
    const fn parameters(&self) -> LinkParameters {
        LinkParameters {
            downlink_mbps: self.downlink,
            queue_kb: self.queue_kb,
            round_trip: self.round_trip,
            cloud_runtime: self.cloud_runtime,
            local_response: self.local_response,
            deadline: self.deadline,
            seconds: self.seconds,
        }
    }

    fn run<'a>(&self, streams: &'a [RequestStream], uplink: f64, remedy: Remedy) -> LinkRun<'a> {
        LinkRun {
            streams,
            uplink: whole(uplink * 1e6),
            downlink: whole(self.downlink * 1e6),
            queue_bytes: whole(self.queue_kb * 1e3),
            local_response: self.local_response,
            cloud_runtime: self.cloud_runtime,
            round_trip: self.round_trip,
            deadline: self.deadline,
            span: self.seconds,
            remedy,
            rule: DeadlineRule::Constant,
        }
    }

    fn rows(&self) -> Vec<LinkRow> {
        let mut wanted = Vec::new();
        for rate in &self.rate {
            let default = whole((rate * self.deadline).floor()).max(1);
            for kb in &self.request_kb {
                for uplink in &self.uplink {
                    let gates = [Remedy::Gate(default), Remedy::Gate(1)];
                    let remedies =
                        [Remedy::None, gates[0], gates[1], Remedy::EveryNth, Remedy::Budget];
                    for rule in [DeadlineRule::Constant, DeadlineRule::Expected] {
                        wanted.extend(remedies.map(|remedy| (*kb, *rate, *uplink, remedy, rule)));
                    }
                }
            }
        }
        wanted.dedup();
        wanted.into_par_iter().map(|row| self.row(row)).collect()
    }

    fn row(
        &self,
        (request_kb, rate, uplink_mbps, remedy, policy): (f64, f64, f64, Remedy, DeadlineRule),
    ) -> LinkRow {
        let streams = [RequestStream { bytes: whole(request_kb * 1e3), rate, ap: APS[0] }];
        let run = LinkRun { rule: policy, ..self.run(&streams, uplink_mbps, remedy) };
        let totals = run.totals()[0];
        let messages = f64::from(totals.messages);
        LinkRow {
            request_kb,
            rate,
            uplink_mbps,
            remedy,
            policy,
            load: run.load(),
            messages: totals.messages,
            requests: totals.requests,
            dropped: totals.dropped,
            by_cloud: f64::from(totals.by_cloud) / messages,
            mean_response: totals.waited / messages,
        }
    }

    fn shared(&self) -> Vec<SharedRow> {
        let stream = |(bytes, ap)| RequestStream { bytes, rate: SHARED_RATE, ap };
        let streams: Vec<_> = SHARED.into_iter().zip(APS).map(stream).collect();
        let default = whole((SHARED_RATE * self.deadline).floor()).max(1);
        let remedies = [
            Remedy::None,
            Remedy::Gate(default),
            Remedy::Gate(1),
            Remedy::EveryNth,
            Remedy::Budget,
        ];
        let wanted = self.uplink.iter().flat_map(|uplink| remedies.map(|it| (*uplink, it)));
        let row = |(uplink, remedy)| {
            let run = self.run(&streams, uplink, remedy);
            let totals = run.totals();
            let messages: f64 = totals.iter().map(|it| f64::from(it.messages)).sum();
            let ap: f64 = totals.iter().map(|it| it.ap).sum();
            let share = |it: &run::StreamTotals| f64::from(it.by_cloud) / f64::from(it.messages);
            SharedRow {
                uplink_mbps: uplink,
                remedy,
                load: run.load(),
                gain: ap / messages - APS[0][0],
                by_cloud: totals.iter().map(share).collect(),
            }
        };
        let mut wanted: Vec<_> = wanted.collect();
        wanted.dedup();
        wanted.into_par_iter().map(row).collect()
    }
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.pad("none"),
            Self::Gate(limit) => f.pad(&format!("gate {limit}")),
            Self::EveryNth => f.pad("every n-th"),
            Self::Budget => f.pad("budget"),
        }
    }
}

/// A text in every case: a gate has its limit.
impl Serialize for Remedy {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// To the nearest.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "options are bounded")]
fn whole(figure: f64) -> u64 {
    figure.round() as u64
}

fn bounded(text: &str, from: f64, to: f64) -> Result<f64, String> {
    let figure: Option<f64> = text.trim().parse().ok();
    let figure = figure.filter(|figure| (from..=to).contains(figure));
    figure.ok_or_else(|| format!("write a number from {from} to {to}"))
}

fn kilobytes(text: &str) -> Result<f64, String> {
    bounded(text, 0.001, 1e6)
}

fn mbits(text: &str) -> Result<f64, String> {
    bounded(text, 0.001, 1e6)
}

fn rate(text: &str) -> Result<f64, String> {
    bounded(text, 0.1, 240.0)
}

fn response(text: &str) -> Result<f64, String> {
    bounded(text, 1e-6, 10.0)
}

fn span(text: &str) -> Result<f64, String> {
    bounded(text, 1.0, 600.0)
}
