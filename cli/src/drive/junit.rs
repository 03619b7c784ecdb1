//! The report as `JUnit` XML, for continuous integration.

use quick_junit::{NonSuccessKind, Report, SerializeError, TestCase, TestCaseStatus, TestSuite};

use super::report::{CaseOutcome, DriveReport};

/// Returns the report's cases; all generated ones count as one, named after the one that failed, if
/// any.
pub(super) fn xml(report: &DriveReport) -> Result<String, SerializeError> {
    let mut suite = TestSuite::new(report.name.as_str());
    suite.set_time(report.took);
    suite.add_test_cases(report.fixed.iter().map(|(id, mark)| case(report, id, *mark)));
    let all = report.suite.generated;
    if let Some((id, mark)) = &report.failed {
        suite.add_test_case(case(report, id, *mark));
    } else if all > 0 {
        let mark = if report.passed == all { CaseOutcome::Passes } else { CaseOutcome::NotRun };
        let span = format!("{} to {}", report.suite.id(0), report.suite.id(all - 1));
        suite.add_test_case(case(report, &span, mark));
    }
    if let Some(misbehaviour) = &report.at_end {
        let status = non_success(NonSuccessKind::Failure, misbehaviour.to_string());
        suite.add_test_case(TestCase::new("end of input", status));
    }
    if let Some(why) = report.unfinished() {
        let status = non_success(NonSuccessKind::Error, why);
        suite.add_test_case(TestCase::new("all cases", status));
    }
    document(suite)
}

/// Says that the command could not be started.
pub(super) fn error(name: &str, why: &str) -> Result<String, SerializeError> {
    let mut case = TestCase::new("start", non_success(NonSuccessKind::Error, why.to_owned()));
    case.set_classname("fuseline");
    let mut suite = TestSuite::new(name);
    suite.add_test_case(case);
    document(suite)
}

fn document(suite: TestSuite) -> Result<String, SerializeError> {
    let mut report = Report::new("fuseline drive");
    report.add_test_suite(suite);
    report.to_string()
}

fn case(report: &DriveReport, id: &str, mark: CaseOutcome) -> TestCase {
    let status = match mark {
        CaseOutcome::Passes => TestCaseStatus::success(),
        CaseOutcome::NotRun => TestCaseStatus::skipped(),
        CaseOutcome::Breaks(_) | CaseOutcome::Misbehaves => {
            let mut status = non_success(NonSuccessKind::Failure, mark.word());
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

fn non_success(kind: NonSuccessKind, message: String) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(kind);
    status.set_message(message);
    status
}
