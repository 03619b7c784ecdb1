//! The checks of a soak, which look at the operators only from outside.

use std::collections::BTreeMap;
use std::fmt;

use comfy_table::{CellAlignment, LineStyle, Table, TableStyle};
use fuseline_tokio::Tally;

use crate::disruption::Disruption;
use crate::fleet::{LateItem, OperatorOutcome, outputs};
use crate::gauges::{Lateness, ResourceUsage};
use crate::span::TimeSpan;

/// Draws a line below the header and no other line.
const STYLE: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// The number of findings that are shown for each check.
const SHOWN: usize = 3;

/// A run, as it was seen from outside the operators.
#[derive(Default)]
pub(crate) struct ObservedRun {
    pub(crate) disruptions: BTreeMap<&'static str, TimeSpan>,
    /// All calm periods together.
    pub(crate) calm: TimeSpan,
    /// Clouds from which an operator had no output during a calm period.
    pub(crate) unanswered: Vec<String>,
    /// The resources that the process used in each calm period.
    pub(crate) usage: Vec<ResourceUsage>,
    /// The resources that the process used before the operators began and after they ended.
    pub(crate) before_and_after: (ResourceUsage, ResourceUsage),
}

/// A check and its findings.
pub(crate) struct ChaosCheck {
    name: &'static str,
    problems: Vec<String>,
}

pub(crate) fn checks(
    messages: u64,
    observed: &ObservedRun,
    fates: &[Result<OperatorOutcome, String>],
    late: &LateItem,
    lateness: &Lateness,
) -> Vec<ChaosCheck> {
    let ended: Vec<&OperatorOutcome> = fates.iter().flatten().collect();
    let each = |problems: &dyn Fn(&OperatorOutcome) -> Vec<String>| {
        ended.iter().flat_map(|f| problems(f)).collect()
    };
    let answered: u64 =
        ended.iter().flat_map(|operator_outcome| operator_outcome.log.answers.values()).sum();
    let mut once: Vec<String> = each(&|operator_outcome| operator_outcome.log.wrong.1.clone());
    once.extend((answered != messages).then(|| format!("{answered} of {messages} are answered")));
    let checks = [
        (
            "everything ends",
            fates
                .iter()
                .filter_map(|operator_outcome| operator_outcome.as_ref().err().cloned())
                .collect(),
        ),
        ("answered once", once),
        ("none late", late.outputs.beyond(lateness)),
        ("aborted", late.calls.beyond(lateness)),
        ("the rules decide", each(&|operator_outcome| by_the_rules(operator_outcome))),
        ("one account", each(&|operator_outcome| one_account(operator_outcome))),
        ("each with its reason", each(&|operator_outcome| reasons(&operator_outcome.tally))),
        ("found again", observed.unanswered.clone()),
        ("disruptions take effect", observed.ineffective_disruptions()),
        ("no leaks", observed.leaks()),
        ("nothing is left", observed.leftovers()),
    ];
    checks.into_iter().map(|(name, problems)| ChaosCheck { name, problems }).collect()
}

/// Returns the judge's findings in the trace, and messages that are missing from it.
fn by_the_rules(operator_outcome: &OperatorOutcome) -> Vec<String> {
    let (number, judged, messages) =
        (operator_outcome.number, operator_outcome.judged, operator_outcome.tally.messages);
    let mut problems: Vec<String> = operator_outcome
        .finding
        .iter()
        .map(|finding| format!("operator {number}: {finding}"))
        .collect();
    if judged != messages {
        problems.push(format!("operator {number}: the trace has {judged} messages of {messages}"));
    }
    problems.extend(
        operator_outcome
            .tally
            .recording_error
            .iter()
            .map(|why| format!("operator {number}: {why}")),
    );
    problems
}

/// Returns the differences between the tally and the items.
fn one_account(operator_outcome: &OperatorOutcome) -> Vec<String> {
    let OperatorOutcome { number, log, tally, .. } = operator_outcome;
    let mut problems = Vec::new();
    for source in &tally.sources {
        let name = &*source.source.name;
        let (reported, read) = (outputs(tally, name), log.answers.get(name).copied().unwrap_or(0));
        if reported != read {
            problems.push(format!(
                "operator {number}: {reported} outputs of {name} are reported, {read} read"
            ));
        }
    }
    problems
}

/// Returns failures that the tally has no room to name.
fn reasons(tally: &Tally) -> Vec<String> {
    let unnamed = tally.sources.iter().filter(|source| source.reasons.others() > 0);
    unnamed.map(|source| format!("{}: {}", source.source.name, source.reasons)).collect()
}

impl ObservedRun {
    /// Returns the disruptions that had no effect, because then the run shows nothing.
    fn ineffective_disruptions(&self) -> Vec<String> {
        let mut problems = Vec::new();
        for harm in Disruption::ALL {
            let name = harm.as_str();
            let Some(span) = self.disruptions.get(name) else {
                problems.push(format!("{name}: there was none"));
                continue;
            };
            // Without a disruption, a third of the outputs come from a cloud.
            if harm.silences() && span.of_disrupted > span.outputs / 20 {
                problems.push(format!("{name}: the cloud answers, {span:?}"));
            }
            if harm.breaks_calls() && span.failed + span.timed_out == 0 {
                problems.push(format!("{name}: no call fails, {span:?}"));
            }
            if harm.is_reported() && span.failed == 0 {
                problems.push(format!("{name}: calls wait, {span:?}"));
            }
        }
        problems
    }

    /// Returns the resources that grew from the first calm period to the last.
    fn leaks(&self) -> Vec<String> {
        let (Some(first), Some(last)) = (self.usage.first(), self.usage.last()) else {
            return vec!["nothing was measured".to_owned()];
        };
        let mut problems = Vec::new();
        let mut grew = |name: &str, first: u64, last: u64, by: u64| {
            problems.extend((last > first + by).then(|| format!("{name}: {first}, then {last}")));
        };
        grew("KiB", first.resident_kib, last.resident_kib, first.resident_kib / 4 + 8192);
        // A record about a tenth of a second takes 100 bytes.
        grew("KiB allocated", first.live_kib, last.live_kib, 2048);
        grew("open files", first.files, last.files, 10);
        grew("tasks", first.tasks, last.tasks, 100);
        problems
    }

    /// Returns what is still in use after the operators have ended.
    fn leftovers(&self) -> Vec<String> {
        let (before, after) = self.before_and_after;
        let more = after.files > before.files || after.tasks > before.tasks;
        more.then(|| format!("{before:?} before, {after:?} after")).into_iter().collect()
    }

    /// Returns the table of disruptions and their effects.
    pub(crate) fn table(&self) -> String {
        let mut table = Table::new();
        table.load_style(STYLE).set_header([
            "what broke",
            "times",
            "seconds",
            "outputs",
            "of its cloud",
            "of local",
            "calls failed",
            "timed out",
        ]);
        let harms = Disruption::ALL.map(Disruption::as_str).into_iter();
        let spans = harms.filter_map(|name| Some((name, self.disruptions.get(name)?)));
        for (name, span) in spans.chain([("calm", &self.calm)]) {
            let share = |of: u64| format!("{} %", of * 100 / span.outputs.max(1));
            table.add_row([
                name.to_owned(),
                span.times.to_string(),
                format!("{}.{}", span.ms / 1000, span.ms % 1000 / 100),
                span.outputs.to_string(),
                share(span.of_disrupted),
                share(span.of_local),
                span.failed.to_string(),
                span.timed_out.to_string(),
            ]);
        }
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        format!("{table}\n")
    }
}

impl ChaosCheck {
    pub(crate) fn holds(&self) -> bool {
        self.problems.is_empty()
    }
}

impl fmt::Display for ChaosCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, problems } = self;
        if problems.is_empty() {
            return write!(f, "holds   {name}");
        }
        write!(
            f,
            "BROKEN  {name}, {} found: {}",
            problems.len(),
            problems[..problems.len().min(SHOWN)].join("; ")
        )
    }
}
