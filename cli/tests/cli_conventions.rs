//! Tests what users expect of a command: completions, manual pages, colours, help, clouds from a
//! file.
#![cfg(unix)]

use std::fs;
use std::path::Path;

use crate::common::{err, fuseline, out, run};
use tempfile::tempdir;

const CORPUS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/corpus");
const COMMANDS: [&str; 14] = [
    "run",
    "probe",
    "serve",
    "replay",
    "check",
    "convert",
    "export",
    "drive",
    "impl",
    "deadline",
    "report",
    "completions",
    "man",
    "scenario",
];

fn printed(args: &[&str]) -> String {
    let done = run(args, "");
    assert_eq!(done.status.code(), Some(0), "{args:?}: {}", err(&done));
    out(&done).to_owned()
}

#[test]
fn each_shell_gets_a_script_that_knows_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = printed(&["completions", shell]);
        for command in COMMANDS {
            assert!(script.contains(command), "{shell}: {command}");
        }
        assert!(script.contains("accept"), "{shell}");
    }
}

#[test]
fn each_command_has_a_manual_page() {
    let dir = tempdir().unwrap();
    let folder = dir.path().join("man1");
    printed(&["man", folder.to_str().unwrap()]);
    for command in COMMANDS {
        let page = fs::read_to_string(folder.join(format!("fuseline-{command}.1"))).unwrap();
        assert!(page.contains(&format!(".TH fuseline-{command} 1")), "{command}");
        assert!(!page.contains('`'), "{command}");
    }
    assert!(folder.join("fuseline.1").exists());
    assert!(folder.join("fuseline-scenario-red-light.1").exists());
    let again = run(&["man", folder.to_str().unwrap()], "");
    assert_eq!(again.status.code(), Some(2), "{}", err(&again));
}

#[test]
fn help_has_no_marks_of_rustdoc() {
    for command in COMMANDS {
        for flag in ["-h", "--help"] {
            let help = printed(&[command, flag]);
            assert!(!help.contains('`') && !help.contains("<http"), "{command} {flag}: {help}");
            // An example is a line that can be copied, or ends where the shell goes on.
            let (_, examples) = help.split_once("Examples:\n").unwrap_or_default();
            let mut goes_on = false;
            for line in examples.lines().take_while(|line| line.starts_with("  ")) {
                let is_command = ["fuseline ", "man ", "some-program "]
                    .iter()
                    .any(|word| line.trim_start().starts_with(word));
                assert!(is_command || goes_on, "{command} {flag}: {line}");
                goes_on = line.ends_with('\\');
            }
        }
    }
    assert!(!printed(&["--help"]).contains('`'));
}

#[test]
fn colours_are_printed_where_they_are_wanted() {
    let trace = Path::new(CORPUS).join("f0-clock-at-its-end-stays-there.jsonl");
    let trace = trace.to_str().unwrap();
    for args in [["--color", "always", "check", trace], ["check", "--color", "always", trace]] {
        assert!(printed(&args).contains("\u{1b}["), "{args:?}");
    }
    for args in [&["check", trace][..], &["check", "--color", "never", trace]] {
        assert!(!printed(args).contains('\u{1b}'), "{args:?}");
    }
    let unknown = run(&["--color", "sometimes"], "");
    assert_eq!(unknown.status.code(), Some(2));
}

#[test]
fn clouds_may_stand_in_a_file() {
    let dir = tempdir().unwrap();
    let file = dir.path().join("fuseline.toml");
    fs::write(
        &file,
        "[[cloud]]\nname = \"own\"\npriority = 3\nmodel = \"my-detector\"\nruntime = \"45ms\"\nap = 52.5\n\
         drive = \"cicv5g/rural_n8_v10\"\n",
    )
    .unwrap();
    let args = ["run", "--for", "0.3s", "--local", "mine,runtime=60ms,ap=40", "--config"];
    let args = [&args[..], &[file.to_str().unwrap()]].concat();
    let done = fuseline(&args).current_dir(dir.path()).output().unwrap();
    // A busy host may leave the cloud without a result, which is a doubt.
    assert_ne!(done.status.code(), Some(2), "{}", err(&done));
    let reported = out(&done);
    assert!(reported.contains("3 own    my-detector                 45.0 ms"), "{reported}");
    assert!(reported.contains("0 local  mine                        60.0 ms"), "{reported}");
    assert!(reported.contains("the given runtimes"), "{reported}");
    // Each has an AP, so that nothing is unknown.
    assert!(!reported.contains("A ? under mean AP"), "{reported}");

    let both = [&args[..], &["--cloud", "name=a,priority=1,url=http://h"]].concat();
    assert_eq!(run(&both, "").status.code(), Some(2));
    let cloud = "[[cloud]]\nname = \"a\"\npriority = 1\nmodel = \"DINO-SWIN-Tiny\"\n";
    let drive = "drive = \"cicv5g/rural_n8_v10\"\n";
    for (text, expected) in [
        ("[[cloud]]\nname = \"a\"\n", "1:1: priority is missing"),
        (&format!("{cloud}drive = \"none\""), "5:9: cloud \"a\": no built-in drive"),
        (&format!("{cloud}{drive}start = \"9h\""), "6:9: cloud \"a\": the start of "),
        (&format!("{cloud}{drive}{cloud}{drive}"), "7:8: two clouds are called \"a\""),
        ("[[cloud]]\nname = \"a\"\npriority = 1\nurl = \"a b\"", "4:7: cloud \"a\": "),
        (
            "[[cloud]]\nname = \"a\"\npriority = 1\nurl = \"http://h\"\nca = \"none\"",
            "5:6: none: No such file",
        ),
    ] {
        fs::write(&file, text).unwrap();
        let refused = run(&args, "");
        assert_eq!(refused.status.code(), Some(2), "{text}");
        let expected = format!("fuseline.toml:{expected}");
        assert!(err(&refused).contains(&expected), "{expected}: {}", err(&refused));
    }
}

/// On a terminal, which `script` makes.
#[test]
fn a_long_file_has_a_bar_on_a_terminal_and_no_other_has_one() {
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    // The lines are long, so that they are few.
    let tick = format!("{{\"ev\":\"tick\",\"at\":7,\"x\":\"{}\"}}\n", "x".repeat(500));
    let ticks = |count| header.to_owned() + &tick.repeat(count);
    fs::write(path("long.jsonl"), ticks(40_000)).unwrap();
    fs::write(path("short.jsonl"), ticks(7)).unwrap();
    for (name, has_bar) in [("long.jsonl", true), ("short.jsonl", false)] {
        for command in ["check", "report -o page.html --force", "export --mcap -o out.mcap --force"]
        {
            let line = format!("'{}' {command} '{name}'", env!("CARGO_BIN_EXE_fuseline"));
            let mut script = std::process::Command::new("script");
            let shown = script.args(["-qec", &line, "/dev/null"]).current_dir(dir.path());
            let shown = shown.stdin(std::process::Stdio::null()).output().unwrap();
            let text = out(&shown);
            let code = if command.starts_with("export") { 0 } else { 3 };
            assert_eq!(shown.status.code(), Some(code), "{line}: {text}");
            assert_eq!(text.contains(" % "), has_bar, "{line}: {text}");
        }
    }
    let piped = run(&["check", &path("long.jsonl")], "");
    assert_eq!(err(&piped), "");
}

/// A browser of one's own notes what it is to open.
#[test]
fn a_page_is_opened_where_that_is_wanted_and_no_other_is() {
    use std::os::unix::fs::PermissionsExt as _;
    use std::time::{Duration, Instant};

    let dir = tempdir().unwrap();
    let (browser, opened) = (dir.path().join("xdg-open"), dir.path().join("opened"));
    fs::write(&browser, format!("#!/bin/sh\necho \"$1\" >> '{}'\n", opened.display())).unwrap();
    fs::set_permissions(&browser, fs::Permissions::from_mode(0o755)).unwrap();
    for (page, more) in [("unseen.html", &[][..]), ("seen.html", &["--open"])] {
        let report = format!("--report={page}");
        let args = ["run", "--for", "0.2s", "--force", "--trace", "t.jsonl", &report];
        // Two messages may come to nothing where the host has much to do.
        let accept = ["--accept", "silent,unjudged,unanswered"];
        let mut command = fuseline(&[&args[..], &accept, more].concat());
        let ran = command.current_dir(dir.path()).env("PATH", dir.path()).output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
        assert!(dir.path().join(page).is_file());
    }
    let start = Instant::now();
    while !fs::read_to_string(&opened).is_ok_and(|text| text.ends_with('\n')) {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing was opened");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(fs::read_to_string(&opened).unwrap(), "seen.html\n");
}
