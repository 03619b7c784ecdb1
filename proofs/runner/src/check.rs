//! What the checker says of one harness.

use serde_json::Value;

use crate::error::Error;
use crate::source::Harness;
use crate::tools::{Limits, Ran, Tools};
use crate::translate::{Copy, Generated};

/// Loops of the memory run as often as there are bytes to move; all others as often as the harness says.
const MEMORY_LOOPS: [(&str, u32); 2] = [("memory_copy", 6), ("memory_fill", 2)];

/// The verdict about a harness.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Verdict {
    /// Every assertion holds, nothing panics, every cover and the end are reached.
    Proved,
    /// An assertion of a harness does not hold.
    Refuted(Counterexample),
    /// Something else than an assertion goes wrong: a panic, a trap, a loop beyond its bound.
    Broken(String),
    /// A cover or the end of the harness is not reached, so that it proves less than it says.
    Unreached(String),
    /// No verdict within the limits.
    TimedOut,
    /// The checker or its solver failed.
    Unknown(String),
}

/// The values for which an assertion does not hold.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Counterexample {
    /// What the assertion says.
    pub(crate) message: String,
    /// Its file and line.
    pub(crate) place: String,
    /// In the order in which the harness draws them.
    pub(crate) values: Vec<u64>,
}

/// A verdict and what it cost.
#[derive(Clone, Debug)]
pub(crate) struct Checked {
    pub(crate) verdict: Verdict,
    pub(crate) seconds: f64,
    pub(crate) peak_mib: u64,
}

impl Checked {
    /// What cannot be given to the checker.
    fn broken(why: String) -> Self {
        Self { verdict: Verdict::Broken(why), seconds: 0.0, peak_mib: 0 }
    }
}

impl Verdict {
    pub(crate) fn word(&self) -> String {
        match self {
            Self::Proved => "proved".to_owned(),
            Self::Refuted(found) => format!("REFUTED: {} ({})", found.message, found.place),
            Self::Broken(what) => format!("BROKEN: {what}"),
            Self::Unreached(what) => format!("UNREACHED: {what}"),
            Self::TimedOut => "TIMED OUT".to_owned(),
            Self::Unknown(why) => format!("NO VERDICT: {why}"),
        }
    }
}

/// Asks whether the harness holds, and whether it reaches what it must.
///
/// # Errors
/// It does not build, or Ctrl-C.
pub(crate) fn prove(
    tools: &Tools,
    copy: &Copy,
    harness: &Harness,
    limits: Limits,
) -> Result<Checked, Error> {
    let generated = match copy.generate(harness)? {
        Ok(generated) => generated,
        Err(why) => return Ok(Checked::broken(why)),
    };
    copy.compile(harness, false)?;
    let ran = ask(tools, &generated, harness, limits, &["--unwinding-assertions", "--trace"])?;
    let mut checked =
        Checked { verdict: held(&ran, &generated), seconds: ran.seconds, peak_mib: ran.peak_mib };
    if checked.verdict == Verdict::Proved {
        copy.compile(harness, true)?;
        let ran = ask(tools, &generated, harness, limits, &["--no-unwinding-assertions"])?;
        checked.verdict = reached(&ran, harness);
        checked.seconds += ran.seconds;
        checked.peak_mib = checked.peak_mib.max(ran.peak_mib);
    }
    Ok(checked)
}

/// Asks for a counterexample to an assertion of the harness, and to nothing else.
///
/// # Errors
/// It does not build, or Ctrl-C.
pub(crate) fn refute(
    tools: &Tools,
    copy: &Copy,
    harness: &Harness,
    limits: Limits,
) -> Result<Checked, Error> {
    let generated = match copy.generate(harness)? {
        Ok(generated) => generated,
        Err(why) => return Ok(Checked::broken(why)),
    };
    copy.compile(harness, false)?;
    let only = ["--property", "w2c_kani_check.assertion.1", "--trace"];
    let ran = ask(tools, &generated, harness, limits, &only)?;
    let verdict = held(&ran, &generated);
    Ok(Checked { verdict, seconds: ran.seconds, peak_mib: ran.peak_mib })
}

fn ask(
    tools: &Tools,
    generated: &Generated,
    harness: &Harness,
    limits: Limits,
    more: &[&str],
) -> Result<Ran, Error> {
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
        // Without this the checker would fall back to its own without a word.
        external => arguments.extend(["--external-sat-solver".to_owned(), external.to_owned()]),
    }
    arguments.extend(more.iter().map(|word| (*word).to_owned()));
    tools.run(generated.folder(), limits, "cbmc", &arguments)
}

/// The properties with their results, or why there are none.
fn results(ran: &Ran) -> Result<Vec<Value>, Verdict> {
    if ran.timed_out {
        return Err(Verdict::TimedOut);
    }
    let lines = || ran.complained.lines().chain(ran.printed.lines().rev());
    let why = |code: Option<i32>| {
        let said = lines().find(|line| line.contains("rror")).unwrap_or("nothing said").trim();
        Verdict::Unknown(format!("cbmc ended with {code:?}: {said}"))
    };
    // 0: all hold, 10: some do not. Anything else is no verdict.
    if !matches!(ran.code, Some(0 | 10)) {
        return Err(why(ran.code));
    }
    let said: Vec<Value> = serde_json::from_str(&ran.printed).map_err(|_| why(ran.code))?;
    let of_status = |message: &Value| message["messageText"].as_str().map(str::to_owned);
    if let Some(error) = said.iter().filter(|m| m["messageType"] == "ERROR").find_map(of_status) {
        return Err(Verdict::Unknown(error));
    }
    said.iter()
        .find_map(|message| message["result"].as_array().cloned())
        .filter(|results| !results.is_empty())
        .ok_or_else(|| why(ran.code))
}

/// Whether every property holds.
fn held(ran: &Ran, generated: &Generated) -> Verdict {
    let results = match results(ran) {
        Ok(results) => results,
        Err(verdict) => return verdict,
    };
    let failed = |result: &&Value| result["status"] == "FAILURE";
    let is_assertion = |result: &&Value| result["description"] == "assertion";
    if let Some(result) = results.iter().filter(failed).find(is_assertion) {
        return Verdict::Refuted(counterexample(result, generated));
    }
    if let Some(result) = results.iter().find(failed) {
        let found = counterexample(result, generated);
        let what = result["description"].as_str().unwrap_or("a property");
        return Verdict::Broken(format!("{what} {}", found.place).trim().to_owned());
    }
    if let Some(result) = results.iter().find(|result| result["status"] != "SUCCESS") {
        return Verdict::Unknown(format!("{} is {}", result["property"], result["status"]));
    }
    if results.iter().any(|result| is_assertion(&result)) {
        Verdict::Proved
    } else {
        Verdict::Unknown("no assertion was looked at".to_owned())
    }
}

/// Whether each cover and the end are reached: whether their properties fail.
fn reached(ran: &Ran, harness: &Harness) -> Verdict {
    let results = match results(ran) {
        Ok(results) => results,
        Err(verdict) => return verdict,
    };
    let is_reached = |what: &str| {
        results.iter().any(|result| result["description"] == what && result["status"] == "FAILURE")
    };
    if !is_reached("end") {
        return Verdict::Unreached("its end".to_owned());
    }
    let covers = harness.covers.iter();
    match covers.copied().find(|line| !is_reached(&format!("cover {line}"))) {
        Some(line) => Verdict::Unreached(format!("the cover at line {line}")),
        None => Verdict::Proved,
    }
}

/// The inputs of a trace, in their order.
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
        found.place = format!("{shown}:{line}");
    }
    found
}
