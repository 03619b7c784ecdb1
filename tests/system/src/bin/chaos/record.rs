//! The record of a soak, with a digest of the sources that it is of.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::Path;

use fuseline_evidence::Tree;
use fuseline_tokio::Error;

use crate::gauges::ResourceUsage;
use crate::span::TimeSpan;

/// Where it is saved, in the project.
const PATH: &str = "tests/system/chaos/soak.json";

/// Where the reason is, while it is older than its sources.
const OLDER: &str = "tests/system/chaos/older.toml";

/// The sources that a soak is of: what decides, what drives it, and what judges. Not the libraries
/// around.
const SOURCES: [&str; 7] = [
    "core/src",
    "adapters/engine/src",
    "adapters/tokio/src",
    "traces/src",
    "!traces/src/lib.rs",
    "!traces/src/observed",
    "tests/system/src/bin/chaos",
];

/// How many messages a record is of, at least.
const MESSAGES: u64 = 1_000_000;

/// What a soak came to.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Soaked {
    /// A digest of the sources, comments left out.
    pub(crate) sources: String,
    pub(crate) seed: u64,
    pub(crate) operators: u32,
    pub(crate) messages: u64,
    pub(crate) seconds: u64,
    /// Half a second after they began, to their ends.
    pub(crate) strikes: BTreeMap<String, TimeSpan>,
    pub(crate) calm: TimeSpan,
    /// Outputs by who made them.
    pub(crate) answers: BTreeMap<String, u64>,
    /// Why calls failed, and how often.
    pub(crate) failures: BTreeMap<String, u64>,
    pub(crate) longest_output_us: u64,
    pub(crate) greatest_timer_lateness_us: u64,
    pub(crate) trace_lines: u64,
    pub(crate) trace_bytes: u64,
    /// Medians in the calm after each round of disruptions, and in the last.
    pub(crate) taken: Vec<ResourceUsage>,
    /// What did not hold.
    pub(crate) broken: Vec<String>,
}

pub(crate) fn digest(root: &Path) -> Result<String, Error> {
    Ok(Tree::new(root.to_owned()).digest(&SOURCES)?)
}

pub(crate) fn keep(root: &Path, soaked: &Soaked) -> Result<(), Error> {
    let text = serde_json::to_string_pretty(soaked)? + "\n";
    Ok(fs::write(root.join(PATH), text)?)
}

/// Shows the saved record; whether it is whole, and of these sources or named as older.
pub(crate) fn shown(root: &Path) -> Result<bool, Error> {
    let read = |path: &str| fs::read_to_string(root.join(path));
    let soaked: Soaked =
        serde_json::from_str(&read(PATH).map_err(|error| format!("{PATH}: {error}"))?)?;
    let older: BTreeMap<String, String> = toml::from_str(&read(OLDER).unwrap_or_default())?;
    let because = older.get("soak").filter(|because| !because.trim().is_empty());
    let (age, is_well) = match (soaked.sources == digest(root)?, because) {
        (true, None) => ("it is of these sources".to_owned(), true),
        (true, Some(_)) => (format!("{OLDER} names it, and it is of these sources"), false),
        (false, Some(because)) => (format!("it is older than the sources: {because}"), true),
        (false, None) => (
            format!("the sources changed since: `.ci/chaos --soak`, or the reason in {OLDER}"),
            false,
        ),
    };
    println!("{soaked}\n{age}");
    soaked.broken.iter().for_each(|check| println!("{check}"));
    // What is named as older shows nothing, and says so.
    let holds = because.is_some() || soaked.broken.is_empty() && soaked.messages >= MESSAGES;
    if !holds {
        println!("{PATH} is no record of {MESSAGES} messages in which all holds");
    }
    Ok(is_well && holds)
}

impl fmt::Display for Soaked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for ResourceUsage { resident_kib, live_kib, files, tasks } in &self.taken {
            writeln!(
                f,
                "in a calm: {resident_kib} KiB, {live_kib} of them allocated, {files} open files, {tasks} tasks"
            )?;
        }
        let strikes: u64 = self.strikes.values().map(|span| span.times).sum();
        write!(
            f,
            "{} messages of {} operators, {strikes} strikes, {} s, seed {}; the longest output \
             took {} ms, a timer was {} ms late",
            self.messages,
            self.operators,
            self.seconds,
            self.seed,
            self.longest_output_us / 1000,
            self.greatest_timer_lateness_us / 1000
        )
    }
}
