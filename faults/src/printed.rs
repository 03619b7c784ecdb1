//! Reads cargo's output of a run of witnesses.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use regex::Regex;

/// The results of a run, by witness.
pub(crate) type Outcomes = BTreeMap<String, bool>;

/// Reads the lines of the test harness. A test that began and never ended is red. In a program
/// `all_…` each module is a file of tests, and its name takes the place of the program's name.
pub(crate) fn read_tests(program: &str, printed: &str) -> Outcomes {
    static TEST: LazyLock<Regex> =
        LazyLock::new(|| regex(r"(?m)^test (\S+)(?: - should panic)? \.\.\.(?: (ok|ignored))?"));
    let begin = if program.starts_with("all_") { String::new() } else { format!("{program}::") };
    let mut outcomes = Outcomes::new();
    for found in TEST.captures_iter(printed) {
        let outcome = found.get(2).map(|outcome| outcome.as_str());
        if outcome != Some("ignored") {
            outcomes.insert(format!("{begin}{}", &found[1]), outcome == Some("ok"));
        }
    }
    outcomes
}

/// Reads the lines of the test harness about traces.
pub(crate) fn read_traces(_: &str, printed: &str) -> Outcomes {
    read_tests("all_", printed)
}

/// Reads the lines of the harnesses. A harness is named when it begins, and again when it has
/// ended.
pub(crate) fn read_steps(_: &str, printed: &str) -> Outcomes {
    static STEP: LazyLock<Regex> = LazyLock::new(|| regex(r"(?m)harness (\w+) \.\.\.(?: (ok))?"));
    STEP.captures_iter(printed).map(|found| (found[1].to_owned(), found.get(2).is_some())).collect()
}

/// Reads the lines of pytest, with all cases of a test as one. A test that began and never ended is
/// red.
pub(crate) fn read_pytest(_: &str, printed: &str) -> Outcomes {
    static CASE: LazyLock<Regex> =
        LazyLock::new(|| regex(r"^tests/(\w+)\.py::(\w+)(?:.* (PASSED|SKIPPED|FAILED|ERROR)\b)?"));
    let mut outcomes = Outcomes::new();
    for found in printed.lines().filter_map(|line| CASE.captures(line)) {
        let outcome = found.get(3).map(|outcome| outcome.as_str());
        if outcome != Some("SKIPPED") {
            let held = outcomes.entry(format!("{}::{}", &found[1], &found[2])).or_insert(true);
            *held &= outcome == Some("PASSED");
        }
    }
    outcomes
}

/// Reads the lines of the tests with real peers.
pub(crate) fn read_peers(_: &str, printed: &str) -> Outcomes {
    static CASE: LazyLock<Regex> =
        LazyLock::new(|| regex(r"(?m)^(passed|failed) +[\d.]+ s  (\w+)"));
    let found = CASE.captures_iter(printed);
    found.map(|found| (format!("peers::{}", &found[2]), &found[1] == "passed")).collect()
}

/// Reads one JSON object for each configuration. A property that is broken there is red. The
/// configuration itself has an outcome if it holds or breaks no property.
pub(crate) fn read_models(_: &str, printed: &str) -> Outcomes {
    #[derive(serde::Deserialize)]
    struct Verdict {
        config: String,
        holds: bool,
        violations: BTreeMap<String, Vec<String>>,
    }
    let verdicts = printed.lines().filter_map(|line| serde_json::from_str::<Verdict>(line).ok());
    let mut outcomes = Outcomes::new();
    for verdict in verdicts {
        outcomes.extend(verdict.violations.keys().map(|claim| (claim.clone(), false)));
        // A configuration that has too few states breaks no property.
        if verdict.holds || verdict.violations.is_empty() {
            outcomes.insert(verdict.config, verdict.holds);
        }
    }
    outcomes
}

/// Returns the complete lines that report failures. It also works while the program is running.
pub(crate) fn failures(printed: &str) -> String {
    let is_failure = |line: &&str| {
        let is_model = line.starts_with('{') && line.contains(r#""holds":false"#);
        line.ends_with('\n') && (is_model || line.contains("... FAILED"))
    };
    printed.split_inclusive('\n').filter(is_failure).collect()
}

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of<const N: usize>(outcomes: [(&str, bool); N]) -> Outcomes {
        outcomes.map(|(name, held)| (name.to_owned(), held)).into()
    }

    #[test]
    fn unended_test_is_red() {
        let printed = "test f1_a ... ok\ntest f2_b ... FAILED\ntest f3_c ... ignored, not here\ntest f4_d ... ";
        let expected = of([("rules::f1_a", true), ("rules::f2_b", false), ("rules::f4_d", false)]);
        assert_eq!(read_tests("rules", printed), expected);
    }

    #[test]
    fn module_is_program_where_there_are_many() {
        assert_eq!(read_tests("all_tokio", "test link::f1_a ... ok\n"), of([("link::f1_a", true)]));
    }

    #[test]
    fn unended_harness_is_red() {
        let printed = "test every ... harness p1_a ...\nharness p1_a ... ok\nharness p2_b ...\n\
            harness p2_b ... FAILED: x\nharness p3_c ...\n";
        let expected = of([("p1_a", true), ("p2_b", false), ("p3_c", false)]);
        assert_eq!(read_steps("random", printed), expected);
    }

    #[test]
    fn python_test_held_if_each_case_did() {
        let printed = "tests/a.py::test_b[0.0] PASSED   [ 10%]\ntests/a.py::test_b[x-[1]] FAILED   [ 20%]\n\
            tests/a.py::test_c PASSED   [ 40%]\ntests/a.py::test_d SKIPPED (no)   [ 50%]\n\
            FAILED tests/a.py::test_b[x-[1]] - assert 1 == 2\ntests/a.py::test_e ";
        let expected = of([("a::test_b", false), ("a::test_c", true), ("a::test_e", false)]);
        assert_eq!(read_pytest("pytest", printed), expected);
    }

    #[test]
    fn test_that_still_runs_is_no_failure() {
        let printed = "test f1_a ... ok\ntest f2_b ... FAILED\ntest f3_c ... ";
        let expected = of([("rules::f2_b", false)]);
        assert_eq!(read_tests("rules", &failures(printed)), expected);
        assert_eq!(failures("test f2_b ... FAILED"), "");
        let broken = "{\"config\":\"b\",\"holds\":false,\"violations\":{}}\n";
        assert_eq!(failures(&format!("b: does not hold\n{broken}")), broken);
    }

    #[test]
    fn property_broken_anywhere_is_red() {
        let printed = r#"{"config":"a","holds":true,"violations":{}}
            {"config":"b","holds":false,"violations":{"P1 once":["{}"]}}
            {"config":"c","holds":false,"violations":{}}"#;
        let expected = of([("P1 once", false), ("a", true), ("c", false)]);
        assert_eq!(read_models("models", printed), expected);
    }
}
