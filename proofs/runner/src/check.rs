//! Checks one harness with CBMC and reads the answer.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::error::Error;
use crate::source::Harness;
use crate::tools::{Limits, ToolOutput, Tools};
use crate::translate::{Copy, Generated};

/// Loops over memory run as often as there are bytes to move. All other loops run as often as the
/// harness states.
const MEMORY_LOOPS: [(&str, u32); 2] = [("memory_copy", 6), ("memory_fill", 2)];

/// Asks only for the values that refute an assertion of the harness.
const ASSERTION: [&str; 3] = ["--property", "w2c_kani_check.assertion.1", "--trace"];

/// The verdict about a harness.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Verdict {
    /// Every assertion holds, nothing panics, and every cover and the end are reached.
    Proved,
    /// An assertion of the harness fails.
    Refuted(Counterexample),
    /// Something other than an assertion fails: a panic, a trap, or a loop beyond its bound.
    Broken(String),
    /// A cover or the end of the harness is not reached, so it proves less than it says.
    Unreached(String),
    /// There is no verdict within the limits.
    TimedOut,
    /// The checker or its solver failed.
    Unknown(String),
}

/// The values for which an assertion fails.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Counterexample {
    /// The assertion's message.
    pub(crate) message: String,
    /// Its file and line.
    pub(crate) location: String,
    /// The values in the order in which the harness draws them.
    pub(crate) values: Vec<u64>,
}

/// A verdict and its cost.
#[derive(Clone, Debug)]
pub(crate) struct CheckResult {
    pub(crate) verdict: Verdict,
    pub(crate) seconds: f64,
    pub(crate) peak_mib: u64,
}

impl CheckResult {
    /// Counts the cost of a run.
    fn add(&mut self, output: ToolOutput) -> ToolOutput {
        self.seconds += output.seconds;
        self.peak_mib = self.peak_mib.max(output.peak_mib);
        output
    }

    /// Returns the result for a harness that cannot be given to the checker.
    fn broken(why: String) -> Self {
        Self { verdict: Verdict::Broken(why), seconds: 0.0, peak_mib: 0 }
    }
}

impl Verdict {
    pub(crate) fn word(&self) -> String {
        match self {
            Self::Proved => "proved".to_owned(),
            Self::Refuted(found) => format!("REFUTED: {} ({})", found.message, found.location),
            Self::Broken(what) => format!("BROKEN: {what}"),
            Self::Unreached(what) => format!("UNREACHED: {what}"),
            Self::TimedOut => "TIMED OUT".to_owned(),
            Self::Unknown(why) => format!("NO VERDICT: {why}"),
        }
    }
}

/// Checks that the harness holds and reaches everything that it must.
///
/// # Errors
/// Returns an error if it does not build, or on Ctrl-C.
pub(crate) fn prove(
    tools: &Tools,
    copy: &Copy,
    harness: &Harness,
    limits: Limits,
) -> Result<CheckResult, Error> {
    let mut checked = CheckResult { verdict: Verdict::Proved, seconds: 0.0, peak_mib: 0 };
    let mut unreached: BTreeSet<u32> = harness.covers.iter().copied().collect();
    for case in cases(harness) {
        let generated = match copy.generate(harness, case)? {
            Ok(generated) => generated,
            Err(why) => return Ok(CheckResult::broken(why)),
        };
        let output = checked.add(run_checker(
            tools,
            &generated,
            harness,
            limits,
            &["--unwinding-assertions"],
        )?);
        let is_after_last = case.is_some() && case == harness.cases;
        checked.verdict = match verdict_of(&output, &generated) {
            Verdict::Proved if is_after_last => left_out(&output),
            Verdict::Proved => reached(&output, &mut unreached),
            // Traces of all properties would be long, so the checker is asked only for the trace of
            // the failing property.
            verdict @ (Verdict::Refuted(_) | Verdict::Broken(_)) => {
                let property = failing(&output).unwrap_or_default();
                let only = ["--unwinding-assertions", "--trace", "--property", &property];
                let output = checked.add(run_checker(tools, &generated, harness, limits, &only)?);
                match verdict_of(&output, &generated) {
                    traced @ (Verdict::Refuted(_) | Verdict::Broken(_)) => traced,
                    _ => verdict,
                }
            }
            verdict => verdict,
        };
        if checked.verdict != Verdict::Proved {
            return Ok(checked);
        }
    }
    if let Some(line) = unreached.first() {
        checked.verdict = Verdict::Unreached(format!("the cover at line {line}"));
    }
    Ok(checked)
}

/// Asks only for a counterexample to an assertion of the harness.
///
/// # Errors
/// Returns an error if it does not build, or on Ctrl-C.
pub(crate) fn refute(
    tools: &Tools,
    copy: &Copy,
    harness: &Harness,
    limits: Limits,
) -> Result<CheckResult, Error> {
    let mut checked = CheckResult { verdict: Verdict::Proved, seconds: 0.0, peak_mib: 0 };
    for case in cases(harness).into_iter().filter(|case| case.is_none() || *case != harness.cases) {
        let generated = match copy.generate(harness, case)? {
            Ok(generated) => generated,
            Err(why) => return Ok(CheckResult::broken(why)),
        };
        let output = checked.add(run_checker(tools, &generated, harness, limits, &ASSERTION)?);
        checked.verdict = verdict_of(&output, &generated);
        if checked.verdict != Verdict::Proved {
            break;
        }
    }
    Ok(checked)
}

/// Returns the questions to the checker: one for each case and one for the case beyond the last, or
/// a single question for the whole harness.
fn cases(harness: &Harness) -> Vec<Option<u32>> {
    match harness.cases {
        Some(cases) => (0..=cases).map(Some).collect(),
        None => vec![None],
    }
}

fn run_checker(
    tools: &Tools,
    generated: &Generated,
    harness: &Harness,
    limits: Limits,
    more: &[&str],
) -> Result<ToolOutput, Error> {
    let mut arguments: Vec<String> = [
        "main.gb",
        "--json-ui",
        "--no-standard-checks",
        "--no-malloc-may-fail",
        "--max-field-sensitivity-array-size",
        "8192",
        "--slice-formula",
        "--unwind",
    ]
    .map(str::to_owned)
    .to_vec();
    arguments.push(harness.unwind.to_string());
    let loops = MEMORY_LOOPS
        .iter()
        .flat_map(|(function, loops)| (0..*loops).map(move |nth| format!("{function}.{nth}:4096")));
    arguments.extend(["--unwindset".to_owned(), loops.collect::<Vec<_>>().join(",")]);
    match harness.solver.as_str() {
        "minisat" => {}
        "z3" => arguments.push("--z3".to_owned()),
        // Otherwise the checker would use its own solver without notice.
        external => arguments.extend(["--external-sat-solver".to_owned(), external.to_owned()]),
    }
    arguments.extend(more.iter().map(|word| (*word).to_owned()));
    tools.run(generated.folder(), limits, "cbmc", &arguments)
}

/// Returns the properties with their results, or the reason why there are none.
fn results(output: &ToolOutput) -> Result<Vec<Value>, Verdict> {
    if output.timed_out {
        return Err(Verdict::TimedOut);
    }
    let lines = || output.stderr.lines().chain(output.stdout.lines().rev());
    let why = |code: Option<i32>| {
        let error = lines().find(|line| line.contains("rror")).unwrap_or("no message").trim();
        Verdict::Unknown(format!("cbmc ended with {code:?}: {error}"))
    };
    // 0 means that all hold, and 10 that some do not. Anything else is no verdict.
    if !matches!(output.code, Some(0 | 10)) {
        return Err(why(output.code));
    }
    let messages: Vec<Value> =
        serde_json::from_str(&output.stdout).map_err(|_| why(output.code))?;
    let of_status = |message: &Value| message["messageText"].as_str().map(str::to_owned);
    if let Some(error) = messages.iter().filter(|m| m["messageType"] == "ERROR").find_map(of_status)
    {
        return Err(Verdict::Unknown(error));
    }
    messages
        .iter()
        .find_map(|message| message["result"].as_array().cloned())
        .filter(|results| !results.is_empty())
        .ok_or_else(|| why(output.code))
}

/// Returns the properties that must hold. Covers and the end are not among them.
fn required(output: &ToolOutput) -> Result<Vec<Value>, Verdict> {
    let mut results = results(output)?;
    results.retain(|result| {
        let description = result["description"].as_str().unwrap_or_default();
        description != "end" && !description.starts_with("cover ")
    });
    Ok(results)
}

fn failed(result: &Value) -> bool {
    result["status"] == "FAILURE"
}

fn is_assertion(result: &Value) -> bool {
    result["description"] == "assertion"
}

/// Returns the name of a property that fails. It is an assertion if any assertion fails.
fn failing(output: &ToolOutput) -> Option<String> {
    let required = required(output).ok()?;
    let assertion = required.iter().find(|result| failed(result) && is_assertion(result));
    let found = assertion.or_else(|| required.iter().find(|result| failed(result)))?;
    found["property"].as_str().map(str::to_owned)
}

/// Returns the verdict about the properties that must hold.
fn verdict_of(output: &ToolOutput, generated: &Generated) -> Verdict {
    let results = match required(output) {
        Ok(results) => results,
        Err(verdict) => return verdict,
    };
    if let Some(result) = results.iter().find(|result| failed(result) && is_assertion(result)) {
        return Verdict::Refuted(counterexample(result, generated));
    }
    if let Some(result) = results.iter().find(|result| failed(result)) {
        let found = counterexample(result, generated);
        let what = result["description"].as_str().unwrap_or("a property");
        return Verdict::Broken(format!("{what} {}", found.location).trim().to_owned());
    }
    if let Some(result) = results.iter().find(|result| result["status"] != "SUCCESS") {
        return Verdict::Unknown(format!("{} is {}", result["property"], result["status"]));
    }
    if results.iter().any(is_assertion) {
        Verdict::Proved
    } else {
        Verdict::Unknown("no assertion was checked".to_owned())
    }
}

/// Checks that the end is not reached, so the harness excludes this case.
fn left_out(output: &ToolOutput) -> Verdict {
    match reached(output, &mut BTreeSet::new()) {
        Verdict::Unreached(_) => Verdict::Proved,
        Verdict::Proved => Verdict::Broken("there are more cases than are checked".to_owned()),
        verdict => verdict,
    }
}

/// Returns the verdict about the end: it is reached if its property fails. Removes the covers that are
/// reached from the set.
fn reached(output: &ToolOutput, unreached: &mut BTreeSet<u32>) -> Verdict {
    let results = match results(output) {
        Ok(results) => results,
        Err(verdict) => return verdict,
    };
    let is_reached = |what: &str| {
        results.iter().any(|result| result["description"] == what && result["status"] == "FAILURE")
    };
    unreached.retain(|line| !is_reached(&format!("cover {line}")));
    if is_reached("end") { Verdict::Proved } else { Verdict::Unreached("its end".to_owned()) }
}

/// Returns the inputs of a trace in their order.
fn counterexample(result: &Value, generated: &Generated) -> Counterexample {
    let mut found = Counterexample::default();
    let (mut file, mut text, mut line) = ((0, 0), (0, 0), 0);
    for step in result["trace"].as_array().into_iter().flatten() {
        let Some(bits) = step["values"][0]["binary"].as_str() else { continue };
        let Ok(value) = u64::from_str_radix(bits, 2) else { continue };
        match step["inputID"].as_str() {
            Some("any") => found.values.push(value),
            Some("file") => file.0 = value,
            Some("file_len") => file.1 = value,
            Some("text") => text.0 = value,
            Some("text_len") => text.1 = value,
            Some("line") => line = value,
            _ => {}
        }
    }
    found.message = generated.text(text.0, text.1).unwrap_or_default();
    if let Some(file) = generated.text(file.0, file.1) {
        let shown = file.rsplit("proofs/src/../../").next().unwrap_or(&file);
        found.location = format!("{shown}:{line}");
    }
    found
}
