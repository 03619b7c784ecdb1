//! The script that the templates for code hosts run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

const CLI: &str = env!("CARGO_MANIFEST_DIR");

/// Runs the line of a template as its host does, in `folder`, with the built command first on the path.
fn host_runs(folder: &Path, line: &str, variables: &[(&str, &str)]) -> Output {
    let built = Path::new(env!("CARGO_BIN_EXE_fuseline")).parent().unwrap();
    let path = std::env::var("PATH").unwrap();
    let mut command = Command::new("bash");
    command.args(["-c", line]).current_dir(folder);
    command.env("PATH", format!("{}:{path}", built.display()));
    command.envs(variables.iter().copied());
    command.output().unwrap()
}

/// The line of a template that runs the script for `kind`.
fn line(template: &str, kind: &str) -> String {
    line_with(template, &format!(" fuseline-{kind} {kind} "))
}

fn line_with(template: &str, part: &str) -> String {
    let text = fs::read_to_string(Path::new(CLI).join("ci").join(template)).unwrap();
    let mut lines = text.lines().filter(|line| line.contains(part));
    let line = lines.next().unwrap().trim().trim_start_matches("run: ").trim_start_matches("- ");
    assert_eq!(lines.next(), None);
    line.to_owned()
}

fn corpus(name: &str) -> PathBuf {
    Path::new(CLI).join("../traces/corpus").join(name)
}

#[test]
fn both_templates_judge_traces_and_leave_all_results() {
    let (good, bad) = (corpus("f5-same-due-fires-together.jsonl"), corpus("bad/f*.jsonl"));
    for (template, home, arguments) in [
        ("action.yml", ("GITHUB_ACTION_PATH", format!("{CLI}/ci")), "ARGUMENTS"),
        ("gitlab.yml", ("FUSELINE", format!("{CLI}/..")), "CHECK"),
    ] {
        for (traces, code) in [(&good, 0), (&bad, 1)] {
            let dir = tempfile::tempdir().unwrap();
            let variables = [(home.0, home.1.as_str()), (arguments, traces.to_str().unwrap())];
            let ran = host_runs(dir.path(), &line(template, "check"), &variables);
            let printed = String::from_utf8_lossy(&ran.stderr);
            assert_eq!(ran.status.code(), Some(code), "{printed}");
            let read =
                |name| fs::read_to_string(dir.path().join("fuseline-check").join(name)).unwrap();
            let sarif: Value = serde_json::from_str(&read("fuseline.sarif")).unwrap();
            let findings = sarif["runs"][0]["results"].as_array().unwrap().len();
            assert_eq!(findings > 60, code == 1, "{findings}");
            assert_eq!(findings > 0, read("fuseline.xml").contains("<failure"));
            assert_eq!(findings > 0, read("fuseline.xqar").contains("<Issue "));
            assert!(read("fuseline.html").contains("<html"));
        }
    }
}

/// The examples of the templates require that something is judged.
#[test]
fn both_templates_refuse_a_trace_in_which_nothing_happened() {
    for (template, home, arguments) in [
        ("action.yml", ("GITHUB_ACTION_PATH", format!("{CLI}/ci")), "ARGUMENTS"),
        ("gitlab.yml", ("FUSELINE", format!("{CLI}/..")), "CHECK"),
    ] {
        let text = fs::read_to_string(Path::new(CLI).join("ci").join(template)).unwrap();
        assert!(text.contains(": --require-judged build/traces/*.jsonl"), "{template}");
        let dir = tempfile::tempdir().unwrap();
        let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
        fs::write(dir.path().join("empty.jsonl"), header).unwrap();
        let variables = [(home.0, home.1.as_str()), (arguments, "--require-judged *.jsonl")];
        let ran = host_runs(dir.path(), &line(template, "check"), &variables);
        assert_eq!(ran.status.code(), Some(1), "{}", String::from_utf8_lossy(&ran.stderr));
    }
}

#[test]
fn both_templates_drive_a_command() {
    let good = format!("--cases 5 -- '{}' impl", env!("CARGO_BIN_EXE_fuseline"));
    for (template, home, arguments) in [
        ("action.yml", ("GITHUB_ACTION_PATH", format!("{CLI}/ci")), "ARGUMENTS"),
        ("gitlab.yml", ("FUSELINE", format!("{CLI}/..")), "DRIVE"),
    ] {
        for (driven, code) in [(good.as_str(), 0), ("--cases 5 -- cat", 1)] {
            let dir = tempfile::tempdir().unwrap();
            let variables = [(home.0, home.1.as_str()), (arguments, driven)];
            let ran = host_runs(dir.path(), &line(template, "drive"), &variables);
            let printed = String::from_utf8_lossy(&ran.stderr);
            assert_eq!(ran.status.code(), Some(code), "{printed}");
            let sarif = dir.path().join("fuseline-drive/fuseline.sarif");
            let sarif: Value = serde_json::from_str(&fs::read_to_string(sarif).unwrap()).unwrap();
            assert_eq!(sarif["runs"][0]["results"][0].is_object(), code == 1);
        }
    }
}

#[test]
fn both_templates_fail_where_a_cloud_answers_nothing() {
    let patient = "--seconds 0.3 --policy constant --deadline 20000 --cloud name=a,priority=1,";
    for (template, arguments) in [("action.yml", "ARGUMENTS"), ("gitlab.yml", "RUN")] {
        for (cloud, code) in
            [("model=DETR-ResNet-101,drive=cicv5g/rural_n8_v10", 0), ("url=http://127.0.0.1:1", 1)]
        {
            let dir = tempfile::tempdir().unwrap();
            let line = line_with(template, "fuseline run --require-clouds");
            let ran = host_runs(dir.path(), &line, &[(arguments, &format!("{patient}{cloud}"))]);
            let printed = String::from_utf8_lossy(&ran.stderr);
            assert_eq!(ran.status.code(), Some(code), "{printed}");
        }
    }
}

#[test]
fn an_earlier_runs_results_do_not_stay_and_wrong_use_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let judge = format!("'{CLI}/ci/judge'");
    let good = corpus("f5-same-due-fires-together.jsonl");
    let line = format!("{judge} out check '{}'", good.display());
    assert_eq!(host_runs(dir.path(), &line, &[]).status.code(), Some(0));
    let unread = host_runs(dir.path(), &format!("{judge} out check none.jsonl"), &[]);
    assert_eq!(unread.status.code(), Some(2));
    assert!(dir.path().join("out/fuseline.sarif").exists());
    assert!(!dir.path().join("out/fuseline.html").exists());
    let wrong = host_runs(dir.path(), &format!("{judge} out judge x"), &[]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).starts_with("usage: judge FOLDER check"));
}
