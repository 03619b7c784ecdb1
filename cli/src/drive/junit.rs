//! The report as `JUnit` XML, for continuous integration.

use quick_junit::{
    NonSuccessKind, Report as Xml, SerializeError, TestCase, TestCaseStatus, TestSuite,
};

use super::report::{CaseOutcome, DriveReport};

/// Returns the report's cases; all generated ones count as one, named after the one that failed, if
/// any.
pub(super) fn xml(report: &DriveReport) -> Result<String, SerializeError> {
    let mut suite = TestSuite::new(report.name.as_str());
    suite.set_time(report.took);
    for (id, mark) in &report.fixed {
        suite.add_test_case(case(report, id, *mark));
    }
    match &report.failed {
        Some((id, mark)) => {
            suite.add_test_case(case(report, id, *mark));
        }
        None if report.suite.generated > 0 => {
            let (driven, all) = (&report.suite, report.suite.generated);
            let mark = if report.passed == all { CaseOutcome::Passes } else { CaseOutcome::NotRun };
            let span = format!("{} to {}", driven.id(0), driven.id(all - 1));
            suite.add_test_case(case(report, &span, mark));
        }
        None => {}
    }
    if let Some(misbehaviour) = &report.at_end {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
        status.set_message(misbehaviour.to_string());
        suite.add_test_case(TestCase::new("end of input", status));
    }
    if let Some(why) = report.unfinished() {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_message(why);
        suite.add_test_case(TestCase::new("all cases", status));
    }
    let mut xml = Xml::new("fuseline drive");
    xml.add_test_suite(suite);
    xml.to_string()
}

/// Says that the command could not be started.
pub(super) fn error(name: &str, why: &str) -> Result<String, SerializeError> {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
    status.set_message(why);
    let mut case = TestCase::new("start", status);
    case.set_classname("fuseline");
    let mut suite = TestSuite::new(name);
    suite.add_test_case(case);
    let mut xml = Xml::new("fuseline drive");
    xml.add_test_suite(suite);
    xml.to_string()
}

fn case(report: &DriveReport, id: &str, mark: CaseOutcome) -> TestCase {
    let status = match mark {
        CaseOutcome::Passes => TestCaseStatus::success(),
        CaseOutcome::NotRun => TestCaseStatus::skipped(),
        CaseOutcome::Breaks(_) | CaseOutcome::Misbehaves => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status.set_message(mark.word());
            if let Some(entry) = report.findings.iter().find(|entry| entry.case == id) {
                status.set_description(entry.text());
            }
            status
        }
    };
    let mut case = TestCase::new(id, status);
    case.set_classname("fuseline");
    case
}
