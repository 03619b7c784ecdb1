//! `JUnit` XML, a case for each trace.

use std::io::{self, Write};

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use crate::results::{Level, Subject};

pub(super) fn write(judged: &[Subject], out: &mut dyn Write) -> io::Result<()> {
    let mut suite = TestSuite::new("traces");
    suite.add_test_cases(judged.iter().map(case));
    let mut report = Report::new("fuseline check");
    report.add_test_suite(suite);
    report.serialize(out).map_err(io::Error::other)
}

fn case(judged: &Subject) -> TestCase {
    let status = match &judged.verdict {
        Err(why) => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
            status.set_message(why.as_str());
            status
        }
        Ok(_) if judged.conforms => TestCaseStatus::success(),
        Ok(verdict) => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            let breaks = judged.problems.iter().any(|it| it.level == Level::Violation);
            status.set_type(if breaks { "violation" } else { "doubt" });
            let texts: Vec<&str> = judged.problems.iter().map(|it| it.text.as_str()).collect();
            status.set_message(verdict.as_str());
            status.set_description(texts.join("\n\n"));
            status
        }
    };
    let mut case = TestCase::new(judged.name.as_str(), status);
    case.set_classname("fuseline");
    case
}
