//! `--explain`: one screen of what was understood of a log, and the commands that convert and judge
//! it.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::io::{self, Write as _};

use crate::convert::Args;
use crate::convert::entry::{Entry, Sources};
use crate::convert::log::{OrderOptions, Run};
use crate::convert::reading::Understood;
use crate::convert::time::Id;
use crate::duration::in_words;
use crate::exit::Exit;
use crate::fault::Fault;

/// At most this many of the unused names are shown.
const SHOWN: usize = 12;
const MS: i128 = 1_000_000;

/// Prints what was understood.
pub(super) fn explain(
    args: &Args,
    file: &str,
    understood: Understood,
    has_header: bool,
) -> Result<Exit, Fault> {
    let Understood { log, mut notes, sources, unused, described, left_out } = understood;
    let order = OrderOptions { is_split: true, ..OrderOptions::of(args) };
    let mut screen = Screen(String::new());
    log.files.iter().for_each(|file| screen.line("read", file));
    let (runs, restarts) = log.runs(order, &mut notes)?;
    let entries: Vec<&Entry> = runs.iter().flat_map(|run| &run.entries).collect();
    let left_out = match left_out {
        0 => String::new(),
        count => format!("; {count} skipped because of --event"),
    };
    screen.line("events", &(counts(&entries, &sources) + &left_out));
    if entries.is_empty() {
        // The names in the log show which options to give.
        described.iter().take(4 * SHOWN).for_each(|name| screen.line("name", name));
    }
    for (number, run) in (1..).zip(&runs) {
        let name = if runs.len() == 1 { "time".to_owned() } else { format!("run {number}") };
        screen.line(&name, &times(run));
        run.doubt(&mut notes);
    }
    for restart in &restarts {
        screen.line("restart", &format!("{}: {}", restart.place.within(), restart.message));
    }
    if !unused.is_empty() && !entries.is_empty() {
        let more = unused.len().saturating_sub(SHOWN);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let names = unused[..unused.len().min(SHOWN)].join(", ");
        screen.line("not used", &(names + &more));
    }
    let facts = Facts::of(&runs);
    for (p, source) in &facts.sources {
        screen.line(&sources.name(*p), &source.describe(*p));
    }
    if facts.step > 1 {
        screen.line("clock", &format!("all stamps are multiples of {}", in_words(facts.step)));
    }
    notes.lines().iter().for_each(|note| screen.line("note", note));
    if !entries.is_empty() {
        facts.commands(has_header, !restarts.is_empty(), file, &mut screen);
    }
    let text = screen.0.replace(|c: char| c.is_control() && c != '\n', "\u{fffd}");
    io::stdout().lock().write_all(text.as_bytes()).map_err(Fault::Output)?;
    Ok(Exit::Conforms)
}

/// The printed lines.
struct Screen(String);

impl Screen {
    fn line(&mut self, name: &str, value: &str) {
        // To a string: it cannot fail.
        let _ = writeln!(self.0, "{name:<9} {value}");
    }
}

/// Counts the events of each kind and source.
fn counts(entries: &[&Entry], sources: &Sources) -> String {
    let mut counts: BTreeMap<(&str, Option<u64>), u64> = BTreeMap::new();
    for entry in entries {
        *counts.entry((entry.ev, entry.p)).or_default() += 1;
    }
    let one = |((ev, p), count): (&(&str, Option<u64>), &u64)| match p {
        Some(p) => format!("{count} {ev} of {}", sources.name(*p)),
        None => format!("{count} {ev}"),
    };
    let all: Vec<String> = counts.iter().map(one).collect();
    if all.is_empty() { "none".to_owned() } else { all.join(", ") }
}

/// Says when a run was, and how far apart its messages are.
fn times(run: &Run) -> String {
    let (Some(first), Some(last)) = (run.entries.first(), run.entries.last()) else {
        return "no event was found; give the names in the log with --column, --event, --frame, \
                --span or --topic"
            .to_owned();
    };
    let (from, to) = (first.place.within(), last.place.within());
    let text = format!("{} from {from} to {to}", in_words(last.at - first.at));
    let next = run.of("open").skip(1);
    let gaps = run.of("open").zip(next).map(|(open, next)| (next.at - open.at, next));
    let Some((longest, next)) = gaps.max_by_key(|(gap, _)| *gap) else { return text };
    let (count, period) = (run.of("open").count(), in_words(median(&run.periods()).unwrap_or(0)));
    let (longest, place) = (in_words(longest), next.place.within());
    format!(
        "{text}; {count} messages, one every {period}, the longest gap {longest} before {place}"
    )
}

/// The facts about a log's sources and clocks.
#[derive(Default)]
struct Facts {
    sources: BTreeMap<u64, SourceFacts>,
    /// The times after the deadline at which outputs came that waited for it.
    waits: Vec<i128>,
    /// The step of the clock, and the period of messages.
    step: i128,
    period: Option<i128>,
    /// The longest time from a run's last message to its end.
    end: i128,
}

/// The facts about one source of a log.
#[derive(Default)]
struct SourceFacts {
    requests: usize,
    /// The times from request to result.
    responses: Vec<i128>,
    deadlines: Vec<i128>,
    late: u64,
    failures: u64,
    /// The times from a result to its output.
    offsets: Vec<i128>,
}

impl Facts {
    fn of(runs: &[Run]) -> Self {
        let mut facts = Self::default();
        for run in runs {
            facts.add(run);
        }
        facts
    }

    fn add(&mut self, run: &Run) {
        let mut begins: HashMap<(&Id, u64), (i128, Option<i128>)> = HashMap::new();
        let mut results: HashMap<(&Id, u64), i128> = HashMap::new();
        let mut dues: HashMap<&Id, i128> = HashMap::new();
        for entry in &run.entries {
            self.step = common(self.step, entry.at);
            let Some(t) = &entry.t else { continue };
            let (at, p) = (entry.at, entry.p.unwrap_or_default());
            match entry.ev {
                "open" => {
                    begins.insert((t, 0), (at, None));
                }
                "request" => {
                    begins.entry((t, p)).or_insert((at, entry.due));
                    let source = self.sources.entry(p).or_default();
                    source.requests += 1;
                    if let Some(due) = entry.due {
                        source.deadlines.push(due - at);
                        let first = dues.entry(t).or_insert(due);
                        *first = due.min(*first);
                    }
                }
                "result" => {
                    results.entry((t, p)).or_insert(at);
                    if let Some((begin, due)) = begins.get(&(t, p)) {
                        let source = self.sources.entry(p).or_default();
                        source.responses.push(at - begin);
                        source.late += u64::from(due.is_some_and(|due| due <= at));
                    }
                }
                "fail" => self.sources.entry(p).or_default().failures += 1,
                _ => {}
            }
        }
        for entry in run.of("emit") {
            let (Some(t), Some(p)) = (&entry.t, entry.p) else { continue };
            let Some(result) = results.get(&(t, p)) else { continue };
            self.sources.entry(p).or_default().offsets.push(entry.at - result);
            // An output of an earlier result that comes soon after a deadline waited for it.
            let wait = dues.get(t).map(|due| entry.at - due);
            self.waits.extend(
                wait.filter(|wait| (0..=200 * MS).contains(wait) && *result + *wait < entry.at),
            );
        }
        self.period = self.period.or(median(&run.periods()));
        let last = run.of("open").last().zip(run.entries.last());
        self.end = self.end.max(last.map_or(0, |(open, end)| end.at - open.at));
    }

    fn shortest_deadline(&self) -> Option<i128> {
        self.sources.values().flat_map(|source| &source.deadlines).min().copied()
    }

    /// Returns the tolerance that the log suggests, and why.
    fn tolerance(&self) -> (i128, String) {
        let offsets = self.sources.values().flat_map(|source| &source.offsets);
        let early = offsets.min().copied().unwrap_or(0);
        // Both stamps may be off.
        let needed = if early < 0 { (1 - early) / 2 } else { 0 };
        let step = self.step.min(100 * MS);
        if needed > step.max(MS) {
            let by = in_words(-early);
            let why = format!("an output is stamped up to {by} before its result");
            return (up_to(needed, 10), why);
        }
        if step > MS {
            return (step, format!("all stamps are multiples of {}", in_words(step)));
        }
        let shortest = self.shortest_deadline().unwrap_or(i128::MAX);
        let least = MS.min((shortest / 20).max(1_000)).max(step);
        (
            up_to(least, 10),
            "all stamps seem to come from one host; nothing in the log needs more".to_owned(),
        )
    }

    /// Returns the lateness that the log suggests, and why.
    fn lateness(&self) -> (i128, String) {
        let mut waits = self.waits.clone();
        waits.sort_unstable();
        let Some(median) = median(&waits) else {
            let why = "no output waited for a deadline, so this is what timers usually need";
            return (5 * MS, why.to_owned());
        };
        let (count, range) = (waits.len(), range(&waits).unwrap_or_default());
        let why = format!(
            "outputs that waited for a deadline ({count}) came {range} after it; this is twice the median"
        );
        (up_to((2 * median).max(MS), 10), why)
    }

    /// Prints the commands that follow.
    fn commands(&self, has_header: bool, is_split: bool, file: &str, screen: &mut Screen) {
        let given = std::env::args().skip(1).filter(|it| it != "--explain");
        let quoted = given.map(|it| shlex::try_quote(&it).map_or(it.clone(), Into::into));
        let given = quoted.collect::<Vec<String>>().join(" ");
        if !has_header {
            screen.line("header", &format!("fuseline {given} --write-header -o header.jsonl"));
        }
        let header = if has_header { "" } else { " --header header.jsonl" };
        let (split, traces) =
            if is_split { (" --split", "trace-*.jsonl") } else { ("", "trace.jsonl") };
        screen.line("convert", &format!("fuseline {given}{header}{split} -o trace.jsonl"));
        let ((tolerance, why), (lateness, because)) = (self.tolerance(), self.lateness());
        let option = |nanos: i128| in_words(nanos).replace(' ', "");
        let options = format!("--tolerance {} --lateness {}", option(tolerance), option(lateness));
        screen.line("judge", &format!("fuseline check --observed {options} {traces}"));
        screen.line("", &format!("tolerance {}: {why}", in_words(tolerance)));
        screen.line("", &format!("lateness {}: {because}", in_words(lateness)));
        let unnoticed = lateness + 2 * tolerance;
        if let Some(shortest) = self.shortest_deadline().filter(|it| *it <= unnoticed) {
            let (shortest, unnoticed) = (in_words(shortest), in_words(unnoticed));
            let warning = format!(
                "warning: {file}: the shortest deadline is {shortest}, and a result that is late \
                 by up to {unnoticed} passes unnoticed"
            );
            screen.line("", &warning);
        }
        if let Some(period) = self.period.map(|period| up_to(period, 100)) {
            let adds =
                format!("--period {} also checks that messages come in time", option(period));
            let end = Some(in_words(self.end)).filter(|_| self.end > period + unnoticed);
            let but =
                end.map(|end| format!(", but counts the {end} after the last message as a gap"));
            screen.line("", &(adds + but.as_deref().unwrap_or_default()));
        }
    }
}

impl SourceFacts {
    fn describe(&self, p: u64) -> String {
        let mut facts = Vec::new();
        if let Some(range) = range(&self.responses) {
            let from = if p == 0 { "the open" } else { "the request" };
            facts.push(format!("results {range} after {from}"));
        }
        if let Some(range) = range(&self.deadlines) {
            let (answered, asked) = (self.responses.len(), self.requests);
            facts.push(format!("deadlines {range}, {answered} of {asked} answered"));
        }
        for (count, what) in [(self.late, "late"), (self.failures, "failed")] {
            facts.extend((count > 0).then(|| format!("{count} {what}")));
        }
        facts.extend(range(&self.offsets).map(|range| format!("outputs {range} after its result")));
        facts.join("; ")
    }
}

/// Returns the middle one of sorted times.
fn median(times: &[i128]) -> Option<i128> {
    times.get(times.len() / 2).copied()
}

/// Returns the shortest and the longest.
fn range(times: &[i128]) -> Option<String> {
    let (least, most) = (in_words(*times.iter().min()?), in_words(*times.iter().max()?));
    Some(if least == most { least } else { format!("{least} to {most}") })
}

/// Returns the greatest power of ten that divides both; 0 is divided by all.
fn common(step: i128, at: i128) -> i128 {
    let mut common = if step == 0 { 1_000_000_000 } else { step };
    while at % common != 0 {
        common /= 10;
    }
    common
}

/// Returns the least number that is no less, and in some unit of ten below `most`.
fn up_to(nanos: i128, most: i128) -> i128 {
    let mut unit = 1;
    while nanos / unit >= most {
        unit *= 10;
    }
    (nanos + unit - 1) / unit * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suggested_times_have_one_digit() {
        for (nanos, up) in [(1, 1), (9, 9), (10, 10), (11, 20), (95, 100), (1_000_001, 2_000_000)] {
            assert_eq!(up_to(nanos, 10), up, "{nanos}");
        }
    }

    #[test]
    fn step_divides_all_instants() {
        let step = [100, 250, 1_000].into_iter().fold(0, common);
        assert_eq!(step, 10);
        assert_eq!(common(0, 0), 1_000_000_000);
    }
}
