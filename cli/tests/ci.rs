//! The script that the templates for code hosts run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

const CLI: &str = env!("CARGO_MANIFEST_DIR");

/// Runs the line of a template as its host does, in `folder`, with the built command first on the
/// path.
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
        let dir = tempfile::tempdir().unwrap();
        for (traces, code) in [(&good, 0), (&bad, 1), (&good, 0)] {
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
            assert!(read("fuseline.html").contains("<html"));
        }
    }
}

/// A37.
#[test]
fn both_templates_fail_where_nothing_is_judged() {
    for (template, home, arguments) in [
        ("action.yml", ("GITHUB_ACTION_PATH", format!("{CLI}/ci")), "ARGUMENTS"),
        ("gitlab.yml", ("FUSELINE", format!("{CLI}/..")), "CHECK"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
        fs::write(dir.path().join("empty.jsonl"), header).unwrap();
        for (traces, code) in [("*.jsonl", 3), ("--accept unjudged *.jsonl", 0)] {
            let variables = [(home.0, home.1.as_str()), (arguments, traces)];
            let ran = host_runs(dir.path(), &line(template, "check"), &variables);
            let printed = String::from_utf8_lossy(&ran.stderr);
            assert_eq!(ran.status.code(), Some(code), "{printed}");
        }
    }
}

/// The commands that install the command, with a cargo that writes down what it is asked for.
#[test]
fn both_templates_install_the_whole_command() {
    for (template, home) in [
        ("action.yml", ("GITHUB_ACTION_PATH", format!("{CLI}/ci"))),
        ("gitlab.yml", ("FUSELINE", format!("{CLI}/.."))),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let cargo = "#!/usr/bin/env bash\nprintf '%s\\n' \"$@\" >>\"$ASKED\"\n";
        fs::create_dir(at("bin")).unwrap();
        fs::write(at("bin/cargo"), cargo).unwrap();
        let line = line_with(template, "cargo install");
        let line = format!("chmod +x bin/cargo; PATH=\"$PWD/bin:$PATH\"; {line}");
        let (asked, folder) = (at("asked"), at(""));
        let variables = [(home.0, home.1.as_str()), ("ASKED", &asked), ("HOME", &folder)];
        // A workspace may persist.
        for _ in 0..2 {
            let ran = host_runs(dir.path(), &line, &variables);
            assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
        }
        let asked: Vec<String> =
            fs::read_to_string(asked).unwrap().lines().map(str::to_owned).collect();
        for part in ["install", "--locked", "--profile", "shipped", "--root"] {
            assert!(asked.iter().any(|it| it == part), "{template}: {asked:?}");
        }
        let path = asked.iter().position(|it| it == "--path").unwrap();
        assert!(Path::new(&asked[path + 1]).join("Cargo.toml").exists(), "{asked:?}");
    }
}

/// The key of the cache changes with the sources.
#[test]
fn the_actions_cache_is_of_its_sources() {
    let dir = tempfile::tempdir().unwrap();
    let home = dir.path().join("cli/ci");
    fs::create_dir_all(&home).unwrap();
    let output = dir.path().join("output");
    let variables = [
        ("GITHUB_ACTION_PATH", home.to_str().unwrap()),
        ("GITHUB_OUTPUT", output.to_str().unwrap()),
    ];
    let line = line_with("action.yml", "sha256sum");
    for source in ["fn main() {}", "fn main() {}", "fn main() { }"] {
        fs::write(dir.path().join("cli/main.rs"), source).unwrap();
        let ran = host_runs(dir.path(), &line, &variables);
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }
    let text = fs::read_to_string(output).unwrap();
    let hashes: Vec<&str> = text.lines().collect();
    assert!(hashes[0].starts_with("hash=") && hashes[0].len() == 21, "{text}");
    assert_eq!((hashes[0] == hashes[1], hashes[1] == hashes[2]), (true, false), "{text}");
}

#[test]
fn json_is_printed_beside_the_results() {
    let dir = tempfile::tempdir().unwrap();
    let good = corpus("f5-same-due-fires-together.jsonl");
    let line = format!("'{CLI}/ci/judge' out check --json '{}'", good.display());
    for _ in 0..2 {
        let ran = host_runs(dir.path(), &line, &[]);
        assert_eq!(ran.status.code(), Some(0), "{}", String::from_utf8_lossy(&ran.stderr));
        let verdict: Value = serde_json::from_slice(&ran.stdout).unwrap();
        assert_eq!(verdict["conforms"], true);
        assert!(dir.path().join("out/fuseline.html").exists());
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
            let junit = dir.path().join("fuseline-drive/fuseline.xml");
            assert_eq!(fs::read_to_string(junit).unwrap().contains("<failure"), code == 1);
        }
    }
}

#[test]
fn both_templates_fail_where_a_cloud_answers_nothing() {
    let patient = "--for 300ms --policy constant --deadline 20s --cloud name=a,priority=1,";
    for (template, arguments) in [("action.yml", "ARGUMENTS"), ("gitlab.yml", "RUN")] {
        for (cloud, code) in
            [("model=DETR-ResNet-101,drive=cicv5g/rural_n8_v10", 0), ("url=http://127.0.0.1:1", 3)]
        {
            let dir = tempfile::tempdir().unwrap();
            let line = line_with(template, "fuseline run --force");
            // A workspace may persist.
            for _ in 0..2 {
                let variables = [(arguments, &*format!("{patient}{cloud}"))];
                let ran = host_runs(dir.path(), &line, &variables);
                let printed = String::from_utf8_lossy(&ran.stderr);
                assert_eq!(ran.status.code(), Some(code), "{printed}");
            }
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
