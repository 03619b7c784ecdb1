//! The report for people, 80 to 100 columns wide, and the text before a run. The figures come from
//! `report`.

use std::fmt::{self, Write};
use std::time::Duration;

use crate::duration::{secs, tenths, whole};
use crate::emulation::Outage;
use crate::percentile::shown;
use crate::run::plan::{CloudPlan, CloudServer, DeadlinePolicy, RunPlan};
use crate::run::report::{PolicyReport, RunReport, SourceReport};
use crate::table::{counted, percent, share, table};
use fuseline_evaluation::link::LinkWidth;
use fuseline_evaluation::models::Model;
use fuseline_evaluation::models::{REPLY_BYTES, REQUEST_BYTES};
use fuseline_report::policies::BoundedFigure;
use fuseline_report::{COLUMNS, PolicyScores, Quantile, RequestRow, RunNotes, Totals};

/// The headings of the table of policies.
const POLICY_COLUMNS: [&str; 8] =
    ["policy", "mean AP", "in time", "p50", "p90", "p99", "in outages", "sent"];
/// The length from which an outage is mentioned.
const OUTAGE: Duration = Duration::from_secs(1);
/// The index of the column of requests that are open when the run ends.
const OPEN: usize = 6;
/// The greatest number of outages of one cloud that are shown.
const OUTAGES: usize = 4;

/// The plan of a run, in words.
pub(crate) struct PlanSummary<'a>(pub(crate) &'a RunPlan);

impl fmt::Display for PlanSummary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plan = self.0;
        let at_most = match plan.policy {
            DeadlinePolicy::Expected => "at most ",
            DeadlinePolicy::Constant => "",
        };
        writeln!(
            f,
            "A camera takes {} frames a second for {}; each cloud gets every frame and has \
             {at_most}{} ms.",
            plan.rate,
            secs(plan.span),
            plan.deadline_ms
        )?;
        let (alone, workers) = (plan.local.runtime.as_secs_f64().recip(), plan.workers);
        let pipeline = match workers {
            1 => format!("one worker, {alone:.1} a second"),
            workers => {
                format!("pipelined over {workers} workers, one does {alone:.1} a second")
            }
        };
        let model = plan.local.to_string();
        writeln!(f, "  0 local  {model:<26} {:>8}   {pipeline}", tenths(plan.local.runtime))?;
        for cloud in &plan.clouds {
            writeln!(f, "  {cloud}")?;
        }
        writeln!(
            f,
            "Local and clouds with a drive are emulated: {} runtimes ±5 % (seed {}), recorded \
             networks.\nRequests of {:.1} KB and replies of {:.1} KB are real gRPC.",
            whose_runtimes(plan),
            plan.seed,
            kilobytes(REQUEST_BYTES),
            kilobytes(REPLY_BYTES),
        )?;
        f.write_str(&link(plan))?;
        f.write_str(&undescribed(plan))?;
        f.write_str(&outages(plan))
    }
}

/// Returns a line about the link that all clouds share, or an empty text if it has no limit.
fn link(plan: &RunPlan) -> String {
    let LinkWidth { uplink, downlink, queue_bytes } = plan.link;
    let recorded = plan.link_drive().map(|cloud| cloud.drive.name());
    let ways = [("uplink", uplink), ("downlink", downlink)].into_iter().enumerate();
    let ways: Vec<String> = ways
        .filter_map(|(way, (name, fixed))| {
            let is_recorded =
                plan.link_drive().is_some_and(|cloud| cloud.drive.rate(way, cloud.start).is_some());
            match (recorded.filter(|_| is_recorded), fixed) {
                (Some(drive), _) => Some(format!("{name} as in {drive}")),
                (None, Some(rate)) => Some(format!("{name} {} Mbit/s", megabits(rate))),
                (None, None) => None,
            }
        })
        .collect();
    if ways.is_empty() {
        return String::new();
    }
    let queue = queue_bytes / 1000;
    format!("All clouds share a link: {}, queues of {queue} KB.\n", ways.join(", "))
}

#[expect(clippy::cast_precision_loss, reason = "at most 10^12")]
fn megabits(bits: u64) -> f64 {
    bits as f64 / 1e6
}

/// Returns the source of the emulated runtimes.
fn whose_runtimes(plan: &RunPlan) -> &'static str {
    let clouds = plan.clouds.iter().filter_map(|cloud| Some(&cloud.emulation()?.model));
    let is_own = |model: &Model| !model.has_papers_runtime();
    let models = [&plan.local].into_iter().chain(clouds);
    if models.clone().all(is_own) {
        "the given"
    } else if models.clone().any(is_own) {
        "the paper's and the given"
    } else {
        "the paper's"
    }
}

impl fmt::Display for CloudPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, priority, served, server } = self;
        let text = served.model.as_deref().unwrap_or_default();
        let runtime = served.runtime.map(tenths).unwrap_or_default();
        write!(f, "{priority} {name:<6} {text:<26} {runtime:>8}   ")?;
        match (server, &served.drive) {
            (CloudServer::Emulated(emulation), _) => {
                write!(f, "{} from {}", emulation.drive.name(), secs(emulation.start))
            }
            (CloudServer::Remote(remote), Some(drive)) => write!(f, "{}, {drive}", remote.url),
            (CloudServer::Remote(remote), None) => f.write_str(&remote.url),
        }
    }
}

/// Returns a line for each cloud whose model only the user named.
fn undescribed(plan: &RunPlan) -> String {
    let mut lines = String::new();
    for CloudPlan { name, served, .. } in &plan.clouds {
        let Some(why) = &served.describe_error else { continue };
        let known = match served.model {
            Some(_) => "its model is the one that --cloud names",
            None => "its model is unknown",
        };
        // Writing to a string does not fail.
        let _ = writeln!(lines, "{name}: its server did not say what it serves ({why}); {known}.");
    }
    lines
}

impl fmt::Display for RunReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.interrupted {
            writeln!(f, "Interrupted; this is the run so far.\n")?;
        }
        let name = |row: &RequestRow| {
            let source = self.sources.iter().find(|source| u64::from(source.priority) == row.p);
            format!("{} {}", row.p, source.map_or("", |source| source.name.as_str()))
        };
        writeln!(f, "{}\n", sources_table(&self.totals, name))?;
        f.write_str(&self.failures())?;
        writeln!(f, "{}\n", MessagesSentence(&self.totals))?;
        // This table shows the gain and the cost of fusion.
        let policies = self.policies.iter().map(|policy| policy.row(self.compared));
        writeln!(f, "{}\n", table(POLICY_COLUMNS, policies, 1..POLICY_COLUMNS.len()))?;
        for caveat in self.caveats() {
            writeln!(f, "{caveat}")?;
        }
        Ok(())
    }
}

/// Describes the outcomes of the messages in a sentence.
struct MessagesSentence<'a>(&'a Totals);

impl fmt::Display for MessagesSentence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Totals { messages, forwarded, missed, refused, open, .. } = *self.0;
        let messages = counted(messages, "message");
        write!(f, "{messages}: {forwarded} forwarded, {missed} missed")?;
        write!(f, ", {refused} refused")?;
        if open > 0 { write!(f, ", {open} open") } else { Ok(()) }
    }
}

impl RunReport {
    /// Returns the caveats of the table of policies, wrapped for a terminal.
    fn caveats(&self) -> Vec<String> {
        let mut caveats = vec![
            format!(
                "AP is COCO's box AP; a message counts 0 if it has no output, or if its result \
                 took {} ms or more.",
                self.deadline_ms
            ),
            "Progressive sends its first output at once and better ones until then: its times are \
             for the\nfirst output, and its AP is for the last."
                .to_owned(),
        ];
        let BoundedFigure { at_least, at_most } = self.outage_messages;
        if at_most > 0 {
            let outages = counted(at_most, "message");
            let outages = match at_least {
                _ if at_least == at_most => format!("the {outages}"),
                0 => format!("at most {outages}"),
                _ => format!("{at_least} to {outages}"),
            };
            caveats.push(format!(
                "Outages are {outages} that at least one cloud would not have answered by then."
            ));
        }
        let refused: u64 = self.totals.rows.iter().map(RequestRow::refused).sum();
        if self.refused + refused > 0 {
            caveats.push(format!(
                "All policies have the same limits: a window of {}, gates, and {} to a cloud at \
                 once.\n\
                 They refused {} and {}, so no policy has results for these.",
                self.window,
                counted(self.calls as u64, "call"),
                counted(self.refused, "message"),
                counted(refused, "request"),
            ));
        }
        if self.policies.iter().any(|policy| policy.mean_ap.is_none()) {
            caveats.push(
                "A ? under mean AP means that the AP of a model is unknown; give it with ap=AP."
                    .to_owned(),
            );
        }
        if self.policies.iter().any(PolicyReport::has_bounds) {
            caveats.push(
                "≥, ≤, – and a ? under in time mark bounds: some calls were ended before their results \
                 came,\nor were never made, so their results are unknown."
                    .to_owned(),
            );
        }
        if let Some(lag) = self.timer_lag_ms {
            caveats.push(format!(
                "At the deadline, timers forward the best result so far; they fired up to {lag:.1} \
                 ms late."
            ));
        }
        caveats
    }

    /// Returns the facts for the page that the trace does not have.
    pub(crate) fn notes(&self, plan: &RunPlan) -> RunNotes {
        let columns = POLICY_COLUMNS.map(ToOwned::to_owned).to_vec();
        let rows = self.policies.iter().map(|policy| policy.row(self.compared)).collect();
        let mut caveats: Vec<String> =
            self.caveats().iter().map(|caveat| caveat.replace('\n', " ")).collect();
        caveats.extend(outages(plan).lines().map(ToOwned::to_owned));
        if self.interrupted {
            caveats.push("The run was interrupted.".to_owned());
        }
        let policies = PolicyScores { columns, rows };
        RunNotes { configuration: configuration(plan), policies, caveats }
    }

    /// Returns a line for each source that failed, with the reasons.
    fn failures(&self) -> String {
        let mut lines = String::new();
        for SourceReport { name, failures, hint, .. } in &self.sources {
            let all: Vec<String> =
                failures.iter().map(|(why, count)| format!("{count} × {why}")).collect();
            if !all.is_empty() {
                let hint = hint.map(|hint| format!("; {hint}")).unwrap_or_default();
                // Writing to a string does not fail.
                let _ = writeln!(lines, "{name}: {}{hint}", all.join(", "));
            }
        }
        if lines.is_empty() { lines } else { lines + "\n" }
    }
}

impl PolicyReport {
    /// Returns its row in the table. It is compared over this many messages.
    fn row(&self, compared: u64) -> Vec<String> {
        let mut row = vec![
            self.policy.clone(),
            self.mean_ap.map_or_else(|| "?".to_owned(), mean_ap),
            in_time(self.in_time, compared),
        ];
        let responses = self.response_ms.iter().chain([&self.outage_response_ms]);
        row.extend(responses.map(|quantile| shown(*quantile, whole)));
        let bound = if self.sent_is_at_least { "≥ " } else { "" };
        row.push(format!("{bound}{}", megabytes(self.sent_bytes)));
        row
    }

    /// Returns `true` if some figure is a bound.
    fn has_bounds(&self) -> bool {
        let mut responses = self.response_ms.iter().chain([&self.outage_response_ms]);
        self.mean_ap.is_some_and(|ap| ap.exact().is_none())
            || self.in_time.exact().is_none()
            || self.sent_is_at_least
            || responses.any(|quantile| matches!(quantile, Some(Quantile::AtLeast(_))))
    }
}

/// Formats a mean AP. Bounds are rounded outwards.
fn mean_ap(ap: BoundedFigure<f64>) -> String {
    match ap.exact() {
        Some(ap) => format!("{ap:.1}"),
        None => range(ap.at_least, ap.at_most, ""),
    }
}

/// Returns a count as a share of all messages, or `?` if it may be any number.
fn in_time(count: BoundedFigure<u64>, messages: u64) -> String {
    if let Some(exact) = count.exact() {
        return percent(exact, messages);
    }
    if count.at_least == 0 && count.at_most == messages {
        return "?".to_owned();
    }
    let BoundedFigure { at_least, at_most } = count.map(|count| 100.0 * share(count, messages));
    if count.at_most == messages {
        return format!("≥ {:.1} %", outwards(at_least, f64::floor));
    }
    range(at_least, at_most, " %")
}

/// Returns the range between two bounds.
fn range(at_least: f64, at_most: f64, unit: &str) -> String {
    let (least, most) = (outwards(at_least, f64::floor), outwards(at_most, f64::ceil));
    if at_least > 0.0 {
        format!("{least:.1}–{most:.1}{unit}")
    } else {
        format!("≤ {most:.1}{unit}")
    }
}

/// Rounds a bound to a tenth so that it still holds.
fn outwards(bound: f64, round: fn(f64) -> f64) -> f64 {
    round(bound * 10.0) / 10.0
}

/// Tabulates who answered and what became of the requests, in the terms of the statistics. `name`
/// returns a source's name.
pub(crate) fn sources_table(totals: &Totals, name: impl Fn(&RequestRow) -> String) -> String {
    // The column is left out if no request is open, as at the end of most traces.
    let is_open = totals.rows.iter().any(|row| row.counts[OPEN] > 0);
    let reported: Vec<usize> = (0..COLUMNS.len()).filter(|i| *i != OPEN || is_open).collect();
    let words = reported.iter().map(|i| COLUMNS[*i].0);
    let rows = totals.rows.iter().map(|row| {
        let counts = reported.iter().map(move |i| row.counts[*i].to_string());
        let share = percent(row.forwarded(), totals.messages);
        [name(row), share].into_iter().chain(counts)
    });
    let header = ["source", "share"].into_iter().chain(words);
    table(header, rows, 1..reported.len() + 2)
}

/// Returns the options in force.
fn configuration(plan: &RunPlan) -> Vec<(String, String)> {
    let policy = match plan.policy {
        DeadlinePolicy::Expected => format!("expected, {} AP a millisecond", plan.price_per_ms),
        DeadlinePolicy::Constant => "constant".to_owned(),
    };
    let of = |name: &str, value: String| (name.to_owned(), value);
    let mut rows = vec![
        of("Camera", format!("{} Hz for {}", plan.rate, secs(plan.span))),
        of("Longest deadline", format!("{} ms", plan.deadline_ms)),
        of("Deadline policy", policy),
        of("Commit rule", plan.commit.as_str().to_owned()),
        of("Window", plan.window.to_string()),
        of("Calls to a cloud at once", plan.calls.to_string()),
        of("Seed", plan.seed.to_string()),
        of(
            "local",
            format!("{}, {}, {} at once", plan.local, tenths(plan.local.runtime), plan.workers),
        ),
    ];
    rows.extend(
        link(plan).split_once(": ").map(|(_, link)| of("Link", link.trim_end().to_owned())),
    );
    rows.extend(plan.clouds.iter().map(|cloud| {
        let text = cloud.to_string();
        let words: Vec<&str> = text.split_whitespace().skip(2).collect();
        (cloud.name.clone(), format!("priority {}, {}", cloud.priority, words.join(" ")))
    }));
    rows
}

/// Returns a line that says when clouds are out of reach, or an empty text if none is known to be.
fn outages(plan: &RunPlan) -> String {
    let of = |cloud: &CloudPlan| {
        let emulation = cloud.emulation()?;
        let all = emulation.outages(plan.period, plan.span, plan.deadline());
        let long = all.into_iter().filter(|outage| outage.length() >= OUTAGE);
        Some((cloud.name.clone(), long.collect::<Vec<_>>()))
    };
    let known: Vec<(String, Vec<Outage>)> = plan.clouds.iter().filter_map(of).collect();
    let mut reported: Vec<String> = known
        .iter()
        .filter(|(_, outages)| !outages.is_empty())
        .map(|(name, outages)| format!("{name} {}", spans(outages)))
        .collect();
    if reported.is_empty() {
        return String::new();
    }
    if known.len() == plan.clouds.len() && known.len() > 1 {
        let all = known.iter().map(|(_, outages)| outages.clone());
        let all = all.reduce(|one, other| Outage::common(&one, &other)).unwrap_or_default();
        if !all.is_empty() {
            let all_of_them = if known.len() == 2 { "both" } else { "all" };
            reported.push(format!("{all_of_them} {}", spans(&all)));
        }
    }
    format!("These drives leave no reply in time: {}.\n", reported.join(", "))
}

fn spans(outages: &[Outage]) -> String {
    let mut text = String::new();
    for (i, outage) in outages.iter().take(OUTAGES).enumerate() {
        let comma = if i == 0 { "" } else { ", " };
        let (from, to) = (outage.from.as_secs_f64(), outage.to.as_secs_f64());
        // Writing to a string does not fail.
        let _ = write!(text, "{comma}{from:.1}–{to:.1} s");
    }
    if outages.len() > OUTAGES {
        text.push_str(" and later");
    }
    text
}

#[expect(clippy::cast_precision_loss, reason = "a few hundred")]
fn kilobytes(bytes: usize) -> f64 {
    bytes as f64 / 1000.0
}

#[expect(clippy::cast_precision_loss, reason = "given to a tenth of a megabyte")]
fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

#[cfg(test)]
pub(crate) mod tests;
