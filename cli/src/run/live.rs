//! The live view: a line per source on a terminal, else a plain line now and then.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::path::Path;
use std::time::Duration;

use fuseline_tokio::{Item, SourceTally, Tally};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use tokio::time::Instant;

use crate::diagnostics::print_line;
use crate::emulation::Emulation;
use crate::run::plan::RunPlan;
use crate::run::table::{counted, millis, secs};

/// What standard error shows while the camera runs.
pub(crate) struct RunProgress<'a> {
    plan: &'a RunPlan,
    began: Instant,
    view: View,
    /// By source: how long its latest output took.
    latest: Vec<Option<Duration>>,
    /// Whether the trace's end was reported.
    is_warned: bool,
}

enum View {
    /// The time, then local and the clouds.
    Terminal {
        all: MultiProgress,
        time: ProgressBar,
        sources: Vec<ProgressBar>,
    },
    Plain,
}

impl<'a> RunProgress<'a> {
    pub(crate) fn new(plan: &'a RunPlan) -> Self {
        let view = if io::stderr().is_terminal() { terminal(plan) } else { View::Plain };
        let latest = vec![None; plan.clouds.len() + 1];
        Self { plan, began: Instant::now(), view, latest, is_warned: false }
    }

    pub(crate) const fn period(&self) -> Duration {
        match self.view {
            View::Terminal { .. } => Duration::from_millis(200),
            View::Plain => Duration::from_secs(5),
        }
    }

    /// Looks at an output.
    pub(crate) fn item<V>(&mut self, item: &Item<V>) {
        let Some(forwarded) = item.forwarded() else { return };
        let priority = forwarded.source.priority;
        let cloud = self.plan.clouds.iter().position(|cloud| cloud.priority == priority);
        if let Some(latest) = self.latest.get_mut(cloud.map_or(0, |i| i + 1)) {
            *latest = Some(item.latency());
        }
    }

    /// Shows how things are.
    pub(crate) fn show(&mut self, tally: &Tally) {
        self.warn(tally);
        let elapsed = self.began.elapsed();
        match &self.view {
            View::Terminal { time, sources, .. } => {
                time.set_position(u64::try_from(elapsed.as_millis()).unwrap_or(u64::MAX));
                time.set_message(self.time(elapsed, tally));
                for (i, (line, source)) in sources.iter().zip(&tally.sources).enumerate() {
                    line.set_message(self.source(i, elapsed, source));
                }
            }
            View::Plain => {
                if let Some(line) = self.plain(elapsed, tally) {
                    print_line(line);
                }
            }
        }
    }

    pub(crate) fn end(&self) {
        if let View::Terminal { time, sources, .. } = &self.view {
            for line in sources.iter().chain([time]) {
                line.finish_and_clear();
            }
        }
    }

    /// Reports once that the trace has ended before its run.
    fn warn(&mut self, tally: &Tally) {
        let Some(why) = tally.recording_error.as_deref().filter(|_| !self.is_warned) else {
            return;
        };
        self.is_warned = true;
        let trace = &self.plan.trace;
        let warning = format!("warning: {}: {}", trace.display(), recording_error(trace, why));
        match &self.view {
            View::Terminal { all, .. } => all.suspend(|| print_line(warning)),
            View::Plain => print_line(warning),
        }
    }

    fn time(&self, elapsed: Duration, tally: &Tally) -> String {
        let refused: u64 = tally.refused.values().sum();
        let (span, missed) = (self.plan.span, tally.missed);
        let elapsed = elapsed.min(span).as_secs();
        // All that came, as in the tables.
        let messages = counted(tally.messages + refused, "message");
        let reported = format!("{messages}, {missed} missed, {refused} refused");
        format!("{elapsed} s of {}: {reported}", secs(span))
    }

    fn source(&self, i: usize, elapsed: Duration, tally: &SourceTally) -> String {
        let took = self.latest.get(i).copied().flatten();
        let latest = took.map_or_else(String::new, |took| format!("latest {}", millis(took)));
        let mut line = format!("forwarded {:>4}   {latest:<15}", tally.forwarded());
        let cloud = i.checked_sub(1).and_then(|i| self.plan.clouds.get(i));
        if let Some(emulation) = cloud.and_then(|cloud| cloud.emulation()) {
            let network = network(emulation, elapsed, self.plan.deadline());
            // Writing to a string does not fail.
            let _ = write!(line, "   {network}");
        }
        line
    }

    /// Nothing as it begins.
    fn plain(&self, elapsed: Duration, tally: &Tally) -> Option<String> {
        if elapsed.is_zero() || tally.messages == 0 {
            return None;
        }
        let forwarded = tally
            .sources
            .iter()
            .map(|source| format!("{} {}", source.source, source.forwarded()))
            .collect::<Vec<_>>()
            .join(", ");
        Some(format!("{}; forwarded {forwarded}", self.time(elapsed, tally)))
    }
}

/// Why the trace ends before its run: without its name and the system's number.
pub(crate) fn recording_error(trace: &Path, why: &str) -> String {
    let name = trace.display().to_string();
    let why = why.strip_prefix(&name).and_then(|why| why.strip_prefix(": ")).unwrap_or(why);
    why.split(" (os error").next().unwrap_or_default().to_owned()
}

/// The network at this moment.
fn network(emulation: &Emulation, elapsed: Duration, deadline: Duration) -> String {
    match emulation.drive.round_trip(emulation.start + elapsed) {
        Some(round_trip) if round_trip < deadline => format!("network {}", millis(round_trip)),
        Some(round_trip) => format!("network lost for {}", secs(round_trip)),
        None => "no network".to_owned(),
    }
}

fn terminal(plan: &RunPlan) -> View {
    let view = MultiProgress::new();
    let style = |template: &str| {
        ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
    };
    let span = u64::try_from(plan.span.as_millis()).unwrap_or(u64::MAX);
    let time = view.add(ProgressBar::new(span).with_style(style("{bar:24.cyan/dim} {msg}")));
    let names = ["local"].into_iter().chain(plan.clouds.iter().map(|cloud| cloud.name.as_str()));
    let sources = names.map(|name| {
        let line = ProgressBar::no_length().with_style(style("  {prefix:.bold} {msg}"));
        view.add(line.with_prefix(format!("{name:<8}")))
    });
    let sources = sources.collect();
    View::Terminal { all: view, time, sources }
}

#[cfg(test)]
mod tests {
    use fuseline_traces::OpenRefusal;

    use super::*;
    use crate::run::table::tests::plan;

    #[test]
    fn a_line_has_the_time_and_all_that_came() {
        let plan = plan(&["--for", "30s"]);
        let (view, latest) = (View::Plain, vec![None; 3]);
        let progress =
            RunProgress { plan: &plan, began: Instant::now(), view, latest, is_warned: false };
        let refused = [(OpenRefusal::Full, 2), (OpenRefusal::Order, 1)].into();
        let tally = Tally { messages: 5, missed: 4, refused, ..Tally::default() };
        let time = |ms| progress.time(Duration::from_millis(ms), &tally);
        assert_eq!(time(2900), "2 s of 30 s: 8 messages, 4 missed, 3 refused");
        assert!(time(31_000).starts_with("30 s of 30 s: "));
        let line_at = |ms, tally: &Tally| progress.plain(Duration::from_millis(ms), tally);
        let line = line_at(2900, &tally).unwrap();
        assert_eq!(line, "2 s of 30 s: 8 messages, 4 missed, 3 refused; forwarded ");
        assert_eq!((line_at(0, &tally), line_at(2900, &Tally::default())), (None, None));
    }

    #[test]
    fn the_network_is_that_of_the_drive_at_this_moment() {
        let plan = plan(&["--start", "west=0s"]);
        let at = |cloud: usize, ms| {
            let emulation = plan.clouds[cloud].emulation().unwrap();
            network(emulation, Duration::from_millis(ms), Duration::from_millis(500))
        };
        assert_eq!(at(0, 0), "network 48 ms");
        assert_eq!(at(0, 55), "network 25 ms");
        assert!(at(1, 15_000).starts_with("network lost for "), "{}", at(1, 15_000));
        let emulation = plan.clouds[0].emulation().unwrap();
        let exactly = network(emulation, Duration::ZERO, Duration::from_millis(48));
        assert!(exactly.starts_with("network lost for "), "{exactly}");
    }

    #[test]
    fn a_trace_that_ended_is_reported_without_its_name_and_the_systems_number() {
        let why = |why| recording_error(Path::new("t.jsonl"), why);
        assert_eq!(why("t.jsonl: no space left (os error 28)"), "no space left");
        assert_eq!(why("t.jsonlx: no space left"), "t.jsonlx: no space left");
        assert_eq!(why("it is full"), "it is full");
    }
}
