//! `--explain`: one screen of what was understood of a log, and the commands that convert and judge it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Write as _};

use crate::convert::Args;
use crate::convert::entry::{Entry, Sources};
use crate::convert::files::LogFile;
use crate::convert::log::{OrderOptions, Run};
use crate::convert::reading::Understood;
use crate::convert::restart::Restart;
use crate::convert::value::{Id, shown};
use crate::exit::Exit;
use crate::fault::Fault;

/// How many names are shown of those that nothing uses.
const SHOWN: usize = 12;
const MS: i128 = 1_000_000;

/// Prints what was understood.
pub(super) fn explain(
    args: &Args,
    files: &[LogFile],
    understood: Understood,
    has_header: bool,
) -> Result<Exit, Fault> {
    let Understood { log, mut notes, sources, unused, described, left_out } = understood;
    let order = OrderOptions { is_sorted: args.sort, is_split: true, is_unique: args.unique };
    let mut text = String::new();
    for file in &log.files {
        line(&mut text, "read", file);
    }
    let (runs, restarts) = log.runs(order, &mut notes)?;
    let entries: Vec<&Entry> = runs.iter().flat_map(|run| &run.entries).collect();
    let left_out = match left_out {
        0 => String::new(),
        count => format!("; {count} left out as --event says"),
    };
    line(&mut text, "events", &(counts(&entries, &sources) + &left_out));
    if entries.is_empty() {
        // What is there says which options to give.
        for name in described.iter().take(4 * SHOWN) {
            line(&mut text, "name", name);
        }
    }
    for (number, run) in (1..).zip(&runs) {
        let name = if runs.len() == 1 { "time".to_owned() } else { format!("run {number}") };
        line(&mut text, &name, &times(run));
        run.doubt(&mut notes);
    }
    for Restart { place, message, .. } in &restarts {
        line(&mut text, "restart", &format!("{}: {message}", place.within()));
    }
    if !unused.is_empty() && !entries.is_empty() {
        let more = unused.len().saturating_sub(SHOWN);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let names: Vec<&str> = unused.iter().take(SHOWN).map(String::as_str).collect();
        line(&mut text, "not used", &format!("{}{more}", names.join(", ")));
    }
    let facts = Facts::of(&runs);
    facts.describe(&sources, &mut text);
    if facts.step > 1 {
        line(&mut text, "clock", &format!("all stamps are multiples of {}", shown(facts.step)));
    }
    for note in notes.lines() {
        line(&mut text, "note", &note);
    }
    let is_split = !restarts.is_empty();
    if !entries.is_empty() {
        facts.commands(has_header, is_split, &files[0].name, &mut text);
    }
    let text = text.replace(|c: char| c.is_control() && c != '\n', "\u{fffd}");
    io::stdout().lock().write_all(text.as_bytes()).map_err(Fault::Output)?;
    Ok(Exit::Conforms)
}

fn line(text: &mut String, name: &str, value: &str) {
    // To a string: it cannot fail.
    let _ = writeln!(text, "{name:<9} {value}");
}

/// How many there are of each event and source.
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

/// When a run was, and how its messages follow each other.
fn times(run: &Run) -> String {
    let (Some(first), Some(last)) = (run.entries.first(), run.entries.last()) else {
        return "no event; name what the log has with --column, --event, --frame, --span or --topic".to_owned();
    };
    let opens: Vec<&Entry> = run.entries.iter().filter(|entry| entry.ev == "open").collect();
    let span = shown(last.at - first.at);
    let mut text = format!("{span} from {} to {}", first.place.within(), last.place.within());
    let gaps = opens.windows(2).map(|pair| (pair[1].at - pair[0].at, &pair[1].place));
    let mut periods: Vec<i128> = gaps.clone().map(|(gap, _)| gap).collect();
    periods.sort_unstable();
    if let (Some(median), Some((longest, place))) =
        (periods.get(periods.len() / 2), gaps.max_by_key(|(gap, _)| *gap))
    {
        let _ = write!(
            text,
            "; {} messages, one every {}, the longest gap {} before {}",
            opens.len(),
            shown(*median),
            shown(longest),
            place.within()
        );
    }
    text
}

/// What a log says of its sources and clocks.
#[derive(Default)]
struct Facts {
    /// By source: how long after their begin results came, and how long they had.
    responses: BTreeMap<u64, Vec<i128>>,
    deadlines: BTreeMap<u64, Vec<i128>>,
    late: BTreeMap<u64, u64>,
    failures: BTreeMap<u64, u64>,
    /// By source: how long after its result an output was sent.
    offsets: BTreeMap<u64, Vec<i128>>,
    /// How long after the deadline outputs came that waited for it.
    waits: Vec<i128>,
    /// The step of the clock, and the period of messages.
    step: i128,
    period: Option<i128>,
}

impl Facts {
    fn of(runs: &[Run]) -> Self {
        let mut facts = Self { step: 0, ..Self::default() };
        for run in runs {
            facts.add(run);
        }
        facts
    }

    fn add(&mut self, run: &Run) {
        let mut begins: BTreeMap<(&Id, u64), (i128, Option<i128>)> = BTreeMap::new();
        let mut results: BTreeMap<(&Id, u64), i128> = BTreeMap::new();
        let (mut opens, mut dues) = (Vec::new(), BTreeMap::<&Id, i128>::new());
        for entry in &run.entries {
            self.step = common(self.step, entry.at);
            let Some(t) = &entry.t else { continue };
            let p = entry.p.unwrap_or_default();
            match entry.ev {
                "open" => {
                    opens.push(entry.at);
                    begins.insert((t, 0), (entry.at, None));
                }
                "request" => {
                    begins.entry((t, p)).or_insert((entry.at, entry.due));
                    if let Some(due) = entry.due {
                        self.deadlines.entry(p).or_default().push(due - entry.at);
                        let latest = dues.entry(t).or_insert(due);
                        *latest = due.min(*latest);
                    }
                }
                "result" => {
                    results.entry((t, p)).or_insert(entry.at);
                    if let Some((begin, due)) = begins.get(&(t, p)) {
                        self.responses.entry(p).or_default().push(entry.at - begin);
                        let is_late = due.is_some_and(|due| due <= entry.at);
                        *self.late.entry(p).or_default() += u64::from(is_late);
                    }
                }
                "fail" => *self.failures.entry(p).or_default() += 1,
                _ => {}
            }
        }
        for entry in run.entries.iter().filter(|entry| entry.ev == "emit") {
            let (Some(t), Some(p)) = (&entry.t, entry.p) else { continue };
            let Some(result) = results.get(&(t, p)) else { continue };
            self.offsets.entry(p).or_default().push(entry.at - result);
            // An output of an earlier result that comes soon after a deadline waited for it.
            let wait = dues.get(t).map(|due| entry.at - due);
            self.waits.extend(
                wait.filter(|wait| (0..=200 * MS).contains(wait) && *result + *wait < entry.at),
            );
        }
        opens.sort_unstable();
        let mut periods: Vec<i128> = opens.windows(2).map(|pair| pair[1] - pair[0]).collect();
        periods.sort_unstable();
        self.period = self.period.or_else(|| periods.get(periods.len() / 2).copied());
    }

    fn describe(&self, sources: &Sources, text: &mut String) {
        let mut all: Vec<u64> =
            self.responses.keys().chain(self.deadlines.keys()).copied().collect();
        all.sort_unstable();
        all.dedup();
        for p in all {
            let mut facts = Vec::new();
            if let Some(range) = range(self.responses.get(&p)) {
                let from = if p == 0 { "the open" } else { "the request" };
                facts.push(format!("results {range} after {from}"));
            }
            if let Some(range) = range(self.deadlines.get(&p)) {
                let asked = self.deadlines.get(&p).map_or(0, Vec::len);
                let answered = self.responses.get(&p).map_or(0, Vec::len);
                facts.push(format!("deadlines {range}, {answered} of {asked} answered"));
            }
            if let Some(late) = self.late.get(&p).filter(|late| **late > 0) {
                facts.push(format!("{late} late"));
            }
            if let Some(failures) = self.failures.get(&p) {
                facts.push(format!("{failures} failed"));
            }
            if let Some(range) = range(self.offsets.get(&p)) {
                facts.push(format!("outputs {range} after its result"));
            }
            line(text, &sources.name(p), &facts.join("; "));
        }
    }

    /// The tolerance that the log suggests, and why.
    fn tolerance(&self) -> (i128, String) {
        let early = self.offsets.values().flatten().min().copied().unwrap_or(0);
        // Both stamps may be off.
        let needed = if early < 0 { (1 - early) / 2 } else { 0 };
        let step = self.step.min(100 * MS);
        if needed > step.max(MS) {
            let by = shown(-early);
            let why = format!("an output is stamped up to {by} before the result that it has");
            return (up_to_digit(needed), why);
        }
        if step > MS {
            return (step, format!("all stamps are multiples of {}", shown(step)));
        }
        let shortest = self.deadlines.values().flatten().min().copied().unwrap_or(i128::MAX);
        let least = MS.min((shortest / 20).max(1_000));
        (
            up_to_digit(least.max(step)),
            "stamps of one host; nothing in the log asks for more".to_owned(),
        )
    }

    /// The lateness that the log suggests, and why.
    fn lateness(&self) -> (i128, String) {
        let mut waits = self.waits.clone();
        waits.sort_unstable();
        if let Some(median) = waits.get(waits.len() / 2) {
            let range = range(Some(&waits)).unwrap_or_default();
            let why = format!(
                "outputs that waited for a deadline ({}) came {range} after it; this is twice the median",
                waits.len()
            );
            return (up_to_digit((2 * median).max(MS)), why);
        }
        (5 * MS, "no output waited for a deadline; this is what timers usually need".to_owned())
    }

    /// The commands that follow.
    fn commands(&self, has_header: bool, is_split: bool, file: &str, text: &mut String) {
        let given: Vec<String> = std::env::args().skip(1).filter(|it| it != "--explain").collect();
        let quoted = |words: &[String]| {
            let quote = |word: &String| {
                shlex::try_quote(word).map_or_else(|_| word.clone(), std::borrow::Cow::into_owned)
            };
            words.iter().map(quote).collect::<Vec<_>>().join(" ")
        };
        let given = quoted(&given);
        if !has_header {
            line(text, "header", &format!("fuseline {given} --write-header -o header.jsonl"));
        }
        let header = if has_header { "" } else { " --header header.jsonl" };
        let split = if is_split { " --split" } else { "" };
        line(text, "convert", &format!("fuseline {given}{header}{split} -o trace.jsonl"));
        let ((tolerance, why), (lateness, because)) = (self.tolerance(), self.lateness());
        let option = |nanos: i128| shown(nanos).replace(' ', "");
        let traces = if is_split { "trace-*.jsonl" } else { "trace.jsonl" };
        line(
            text,
            "judge",
            &format!(
                "fuseline check --observed --tolerance {} --lateness {} {traces}",
                option(tolerance),
                option(lateness)
            ),
        );
        line(text, "", &format!("tolerance {}: {why}", shown(tolerance)));
        line(text, "", &format!("lateness {}: {because}", shown(lateness)));
        let shortest = self.deadlines.values().flatten().min().copied();
        let unnoticed = lateness + 2 * tolerance;
        if let Some(shortest) = shortest.filter(|shortest| *shortest <= unnoticed) {
            let warning = format!(
                "warning: {file}: a deadline of {} is not longer than what may pass unnoticed, {}",
                shown(shortest),
                shown(unnoticed)
            );
            line(text, "", &warning);
        }
        if let Some(period) = self.period {
            let period = option(up_to(period, 100));
            line(text, "", &format!("--period {period} adds that messages come in time"));
        }
    }
}

/// The shortest and the longest.
fn range(times: Option<&Vec<i128>>) -> Option<String> {
    let times = times?;
    let (least, most) = (times.iter().min()?, times.iter().max()?);
    Some(if least == most {
        shown(*least)
    } else {
        format!("{} to {}", shown(*least), shown(*most))
    })
}

/// The greatest power of ten that divides both; 0 is divided by all.
fn common(step: i128, at: i128) -> i128 {
    let mut common = if step == 0 { 1_000_000_000 } else { step };
    while at % common != 0 {
        common /= 10;
    }
    common
}

/// The least number of one digit that is no less.
fn up_to_digit(nanos: i128) -> i128 {
    up_to(nanos, 10)
}

/// The least number that is no less, and in some unit of ten below `most`.
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
            assert_eq!(up_to_digit(nanos), up, "{nanos}");
        }
    }

    #[test]
    fn step_divides_all_instants() {
        let step = [100, 250, 1_000].into_iter().fold(0, common);
        assert_eq!(step, 10);
        assert_eq!(common(0, 0), 1_000_000_000);
    }
}
