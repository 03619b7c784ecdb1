//! What cargo printed when the witnesses of a kind ran.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use regex::Regex;

/// What a run printed, by witness: whether it held.
pub(crate) type Outcomes = BTreeMap<String, bool>;

/// The witness that all generated runs of a drive are.
pub(crate) const GENERATED: &str = "generated runs";

/// Lines of the test harness. A test that began and never ended is red. In a program `all_…` a module is a file of tests,
/// whose name stands for the program's.
pub(crate) fn read_tests(printed: &str) -> Outcomes {
    static BINARY: LazyLock<Regex> =
        LazyLock::new(|| regex(r"^ +Running .*/deps/(\w+)-[0-9a-f]+\)"));
    static TEST: LazyLock<Regex> = LazyLock::new(|| regex(r"^test (\S+) \.\.\.(?: (ok|ignored))?"));
    let mut outcomes = Outcomes::new();
    let mut binary = String::new();
    for line in printed.lines() {
        if let Some(found) = BINARY.captures(line) {
            let is_of_many = found[1].starts_with("all_");
            binary = if is_of_many { String::new() } else { format!("{}::", &found[1]) };
        } else if let Some(found) = TEST.captures(line) {
            let outcome = found.get(2).map(|outcome| outcome.as_str());
            if outcome != Some("ignored") {
                outcomes.insert(format!("{binary}{}", &found[1]), outcome == Some("ok"));
            }
        }
    }
    outcomes
}

/// Lines of pytest, all cases of a test as one. A test that began and never ended is red.
pub(crate) fn read_pytest(printed: &str) -> Outcomes {
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

/// A JSON object a configuration: the properties that are broken there, or the configuration itself if it holds.
pub(crate) fn read_models(printed: &str) -> Outcomes {
    #[derive(serde::Deserialize)]
    struct Verdict {
        config: String,
        holds: bool,
        violations: BTreeMap<String, Vec<String>>,
    }
    let verdicts = printed.lines().filter_map(|line| serde_json::from_str::<Verdict>(line).ok());
    let mut outcomes = Outcomes::new();
    for verdict in verdicts {
        outcomes.extend(verdict.violations.into_keys().map(|claim| (claim, false)));
        if verdict.holds {
            outcomes.insert(verdict.config, true);
        }
    }
    outcomes
}

/// A JSON object: how the cases of the corpus ended, and whether a generated run differed.
pub(crate) fn read_drive(printed: &str) -> Outcomes {
    #[derive(serde::Deserialize)]
    struct DrivePrinted {
        fixed: Vec<Case>,
        generated: GeneratedPrinted,
    }
    #[derive(serde::Deserialize)]
    struct Case {
        case: String,
        result: String,
    }
    #[derive(serde::Deserialize)]
    struct GeneratedPrinted {
        failed: Option<String>,
        passed: u64,
    }
    let mut driven =
        printed.lines().filter_map(|line| serde_json::from_str::<DrivePrinted>(line).ok());
    let Some(DrivePrinted { fixed, generated }) = driven.next() else { return Outcomes::new() };
    // What a silent command leaves unsaid did not run.
    let ran =
        fixed.into_iter().filter(|case| case.result == "pass" || case.result.starts_with("fail"));
    let mut outcomes: Outcomes = ran.map(|case| (case.case, case.result == "pass")).collect();
    if generated.failed.is_some() || generated.passed > 0 {
        outcomes.insert(GENERATED.to_owned(), generated.failed.is_none());
    }
    outcomes
}

fn regex(pattern: &str) -> Regex {
    Regex::new(pattern).expect("a sound pattern")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_that_began_and_never_ended_is_red() {
        let printed = "     Running tests/rules.rs (/x/deps/rules-0a1b)\n\
            test f1_a ... ok\ntest f2_b ... FAILED\ntest f3_c ... ignored, not here\ntest f4_d ... ";
        let expected = [("rules::f1_a", true), ("rules::f2_b", false), ("rules::f4_d", false)];
        assert_eq!(
            read_tests(printed),
            expected.map(|(name, held)| (name.to_owned(), held)).into()
        );
    }

    #[test]
    fn in_a_program_of_many_files_each_module_is_a_program() {
        let printed =
            "     Running tests/main.rs (/x/deps/all_tokio-0a1b)\ntest link::f1_a ... ok\n";
        assert_eq!(read_tests(printed), [("link::f1_a".to_owned(), true)].into());
    }

    #[test]
    fn a_test_of_python_held_if_each_of_its_cases_did() {
        let printed = "tests/a.py::test_b[0.0] PASSED   [ 10%]\ntests/a.py::test_b[x-[1]] FAILED   [ 20%]\n\
            tests/a.py::test_c PASSED   [ 40%]\ntests/a.py::test_d SKIPPED (no)   [ 50%]\n\
            FAILED tests/a.py::test_b[x-[1]] - assert 1 == 2\ntests/a.py::test_e ";
        let expected = [("a::test_b", false), ("a::test_c", true), ("a::test_e", false)];
        let expected = expected.map(|(name, held)| (name.to_owned(), held));
        assert_eq!(read_pytest(printed), expected.into());
    }

    #[test]
    fn a_build_that_failed_ran_nothing() {
        assert!(read_tests("error: could not compile `fuseline-core`").is_empty());
        assert!(read_models("error: could not compile `fuseline-core`").is_empty());
    }

    #[test]
    fn a_violated_property_is_red_in_whatever_configuration() {
        let printed = r#"{"config":"a","holds":true,"states":1,"violations":{}}
            {"config":"b","holds":false,"states":1,"violations":{"P1 once":["{}"]}}"#;
        let expected = [("P1 once", false), ("a", true)];
        let expected = expected.map(|(name, held)| (name.to_owned(), held));
        assert_eq!(read_models(printed), expected.into());
    }

    #[test]
    fn a_case_that_was_not_driven_says_nothing() {
        let printed = r#"{"fixed":[{"case":"a","result":"pass"},{"case":"b","result":"fail, F1"},
            {"case":"c","result":"not run"}],"generated":{"failed":null,"passed":0,"runs":20}}"#;
        let expected = [("a", true), ("b", false)].map(|(name, held)| (name.to_owned(), held));
        assert_eq!(read_drive(&printed.replace('\n', "")), expected.into());
    }
}
