//! The results of a checker bundle, in the format of ASAM's quality checker framework.

use std::io::{self, Write};

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use crate::results::{Level, Problem, RuleText, Subject, rules};

/// Of the format.
const VERSION: &str = "1.0.0";
/// Who states the rules, the standard, and its version; the rule's name follows.
const RULE: &str = "fuseline.spec:fuseline:1.0:";

pub(super) fn write(judged: &[Subject], out: &mut dyn Write) -> io::Result<()> {
    let rules: Vec<RuleText> = rules(judged).into_iter().collect();
    let mut xml = Writer::new_with_indent(&mut *out, b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let results = xml.create_element("CheckerResults").with_attribute(("version", VERSION));
    results.write_inner_content(|xml| {
        let number = |holds: fn(&Subject) -> bool| judged.iter().filter(|it| holds(it)).count();
        let (conform, read) = (number(|it| it.conforms), number(|it| it.verdict.is_ok()));
        let summary =
            format!("{conform} of {} conform, {} not read", judged.len(), judged.len() - read);
        let bundle = xml.create_element("CheckerBundle").with_attributes([
            ("name", "fuseline"),
            ("version", env!("CARGO_PKG_VERSION")),
            ("build_date", ""),
            ("description", "Whether operators follow the rules of SPEC.md"),
            ("summary", &summary),
        ]);
        bundle.write_inner_content(|xml| {
            let mut issues = 0;
            judged.iter().try_for_each(|judged| checker(xml, judged, &rules, &mut issues))
        })?;
        Ok(())
    })?;
    writeln!(out)
}

/// One for each input, since a location names no file.
fn checker<W: Write>(
    xml: &mut Writer<W>,
    judged: &Subject,
    rules: &[RuleText],
    issues: &mut u64,
) -> io::Result<()> {
    let (status, summary) = match &judged.verdict {
        Ok(verdict) => ("completed", clean(verdict)),
        Err(why) => ("error", clean(why)),
    };
    let name = clean(&judged.name);
    let checker = xml.create_element("Checker").with_attributes([
        ("checkerId", name.as_str()),
        ("description", judged.judge),
        ("status", status),
        ("summary", &summary),
    ]);
    checker.write_inner_content(|xml| {
        let input = [("name", "InputFile"), ("value", &name)];
        xml.create_element("Param").with_attributes(input).write_empty()?;
        for (id, _) in rules {
            let uid = format!("{RULE}{id}");
            let rule = xml.create_element("AddressedRule");
            rule.with_attribute(("ruleUID", uid.as_str())).write_empty()?;
        }
        for problem in &judged.problems {
            issue(xml, problem, *issues)?;
            *issues += 1;
        }
        Ok(())
    })?;
    Ok(())
}

fn issue<W: Write>(xml: &mut Writer<W>, problem: &Problem, number: u64) -> io::Result<()> {
    let text = clean(&problem.text);
    let (number, uid) = (number.to_string(), format!("{RULE}{}", problem.rule.0));
    let issue = xml.create_element("Issue").with_attributes([
        ("issueId", number.as_str()),
        ("description", &text),
        (
            "level",
            match problem.level {
                Level::Violation => "1",
                Level::Doubt => "2",
                Level::Accepted => "3",
            },
        ),
        ("ruleUID", &uid),
    ]);
    issue.write_inner_content(|xml| {
        let Some(line) = problem.line else { return Ok(()) };
        let (line, sentence) = (line.to_string(), problem.rule.1);
        let locations = xml.create_element("Locations").with_attribute(("description", sentence));
        locations.write_inner_content(|xml| {
            let row = xml.create_element("FileLocation").with_attribute(("row", line.as_str()));
            row.write_empty().map(|_| ())
        })?;
        Ok(())
    })?;
    Ok(())
}

/// A text without the characters that XML has not, such as a file's name may have.
fn clean(text: &str) -> String {
    text.chars().map(|it| if it.is_control() && !it.is_whitespace() { '?' } else { it }).collect()
}
