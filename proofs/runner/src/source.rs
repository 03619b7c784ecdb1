//! Reads the harnesses from their sources: attributes, bounds, assertions and covers.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use regex::Regex;

use crate::error::Error;

/// The folder of the harness files, from the root.
pub(crate) const FOLDER: &str = "proofs/src/harness";

/// One harness.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Harness {
    pub(crate) name: String,
    /// The name of its file, without `.rs`.
    pub(crate) group: String,
    /// Its documentation on one line, without the bounds.
    pub(crate) says: String,
    /// Its bounds.
    pub(crate) bounds: String,
    /// The number of values of its first choice, if the checker is asked about one at a time.
    pub(crate) cases: Option<u32>,
    pub(crate) unwind: u32,
    pub(crate) solver: String,
    /// The lines of its covers.
    pub(crate) covers: Vec<u32>,
    /// The number of assertions in its own body.
    pub(crate) assertions: usize,
}

/// The contents of the harness files.
#[derive(Debug, Default)]
pub(crate) struct HarnessSources {
    pub(crate) harnesses: Vec<Harness>,
    /// The number of assertions in each function, harness or not, by file and name.
    pub(crate) assertions: BTreeMap<String, usize>,
}

/// Reads all harness files.
///
/// # Errors
/// Returns an error if a file cannot be read or a harness lacks something.
pub(crate) fn read(root: &Path) -> Result<HarnessSources, Error> {
    let folder = root.join(FOLDER);
    let mut files = Vec::new();
    for entry in fs::read_dir(&folder).map_err(Error::file(&folder))? {
        files.push(entry.map_err(Error::file(&folder))?.path());
    }
    files.sort();
    let mut sources = HarnessSources::default();
    for path in files {
        let text = fs::read_to_string(&path).map_err(Error::file(&path))?;
        let group = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        sources.add(&group, &text).map_err(|why| Error::content(&path, &why))?;
    }
    Ok(sources)
}

impl HarnessSources {
    /// Reads one file. It is formatted by rustfmt, so a function ends with a brace in the first column.
    fn add(&mut self, group: &str, text: &str) -> Result<(), String> {
        let name = Regex::new(r"^(?:pub )?fn (\w+)").map_err(|error| error.to_string())?;
        let lines: Vec<&str> = text.lines().collect();
        let mut spoken_for = 0;
        for (at, line) in lines.iter().enumerate() {
            let Some(found) = name.captures(line) else { continue };
            let name = &found[1];
            let ends =
                |line: &&str| *line == "}" || line.starts_with("pub fn") && line.ends_with("{}");
            let length = lines[at..].iter().position(ends).unwrap_or(0);
            let body = &lines[at..=at + length];
            let above = lines[..at].iter().rev().take_while(|line| line.starts_with(['/', '#']));
            let mut above: Vec<&str> = above.copied().collect();
            above.reverse();
            let assertions = body.iter().map(|line| line.matches("kani::assert(").count()).sum();
            if assertions > 0 {
                self.assertions.insert(format!("{group}::{name}"), assertions);
            }
            let covers = (at..=at + length).filter(|line| lines[*line].contains("kani::cover!("));
            let covers: Vec<u32> = covers.filter_map(|line| u32::try_from(line + 1).ok()).collect();
            if above.contains(&"#[kani::proof]") {
                spoken_for += covers.len();
                let harness = Harness::new(group, name, &above, covers, assertions)?;
                self.harnesses.push(harness);
            }
        }
        // A cover anywhere else could be reached in one harness and stay unreached in another.
        if text.matches("kani::cover!(").count() != spoken_for {
            return Err("a cover stands outside a harness".to_owned());
        }
        Ok(())
    }
}

impl Harness {
    /// Returns the name by which Kani selects it with `--exact`.
    pub(crate) fn path(&self) -> String {
        format!("harness::{}::{}", self.group, self.name)
    }

    /// Returns its bounds, and how far its loops are unwound.
    pub(crate) fn stated_bounds(&self) -> String {
        format!("{}; unwind {}", self.bounds, self.unwind)
    }

    fn new(
        group: &str,
        name: &str,
        above: &[&str],
        covers: Vec<u32>,
        assertions: usize,
    ) -> Result<Self, String> {
        let attribute = |word: &str| {
            let head = format!("#[kani::{word}(");
            above.iter().find_map(|line| line.strip_prefix(&head)?.strip_suffix(")]"))
        };
        let said = above.iter().filter_map(|line| line.strip_prefix("///")).map(str::trim);
        let (bounds, says): (Vec<&str>, Vec<&str>) =
            said.partition(|line| line.starts_with("Bounds: "));
        let (cases, says): (Vec<&str>, Vec<&str>) =
            says.into_iter().partition(|line| line.starts_with("Cases: "));
        let lacks = |what: &str| format!("{name} has no {what}");
        let [bounds] = bounds[..] else { return Err(lacks("line of bounds")) };
        if covers.is_empty() {
            return Err(lacks("cover"));
        }
        let number = |line: &&str| line.trim_start_matches("Cases: ").trim_end_matches('.').parse();
        let cases = cases.first().map(number).transpose().map_err(|_| lacks("number of cases"))?;
        // Kani has no default, so a bound that only this runner knew would not be Kani's.
        let unwind = attribute("unwind").ok_or_else(|| lacks("bound: write #[kani::unwind(N)]"))?;
        Ok(Self {
            name: name.to_owned(),
            group: group.to_owned(),
            says: says.join(" ").trim().to_owned(),
            bounds: bounds.trim_start_matches("Bounds: ").trim_end_matches('.').to_owned(),
            cases,
            unwind: unwind.parse().map_err(|_| lacks("number to unwind to"))?,
            solver: attribute("solver").unwrap_or("cadical").to_owned(),
            covers,
            assertions,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "/// P1: once.\n/// Bounds: none.\n#[kani::proof]\n#[kani::unwind(7)]\n\
        pub fn p1_once() {\n    kani::assert(true, \"x\");\n    kani::cover!(true, \"y\");\n}\n";

    #[test]
    fn harness_is_read_with_its_attributes() {
        let mut sources = HarnessSources::default();
        sources.add("slot", TEXT).expect("it is complete");
        let [harness] = &sources.harnesses[..] else { panic!("one harness") };
        assert_eq!((harness.name.as_str(), harness.unwind, harness.assertions), ("p1_once", 7, 1));
        assert_eq!((harness.says.as_str(), harness.bounds.as_str()), ("P1: once.", "none"));
        assert_eq!(harness.covers, [7]);
        assert_eq!(sources.assertions["slot::p1_once"], 1);
    }

    #[test]
    fn cases_are_read_and_are_no_part_of_what_is_said() {
        let mut sources = HarnessSources::default();
        let text = TEXT.replace("/// Bounds", "/// Cases: 9.\n/// Bounds");
        sources.add("slot", &text).expect("it is complete");
        assert_eq!(sources.harnesses[0].cases, Some(9));
        assert_eq!(sources.harnesses[0].says, "P1: once.");
    }

    #[test]
    fn harness_without_a_bound_of_its_loops_is_refused() {
        let text = TEXT.replace("#[kani::unwind(7)]\n", "");
        assert!(HarnessSources::default().add("slot", &text).is_err());
    }

    #[test]
    fn refuses_harness_without_cover_and_stray_cover() {
        let bare = TEXT.replace("    kani::cover!(true, \"y\");\n", "");
        assert!(HarnessSources::default().add("slot", &bare).is_err());
        let stray = format!("{TEXT}fn helper() {{\n    kani::cover!(true, \"z\");\n}}\n");
        assert!(HarnessSources::default().add("slot", &stray).is_err());
    }
}
