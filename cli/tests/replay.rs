//! `fuseline replay`, run as a user runs it.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{ChildStdout, Stdio};

use crate::common::sample::{Lines, TRACE, files, text};
use crate::common::{err, fuseline, out, run};

const INPUTS: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":2,"limit":31},{"p":1,"limit":31}]}
{"ev":"open","at":0,"t":0,"x":{"camera":[1.5,null]}}
{"ev":"offer","at":0,"t":0,"p":1,"deadline":500,"backlog":0}
{"ev":"offer","at":1,"t":0,"p":2,"deadline":500,"backlog":0}
{"at":150,"ev":"result","t":0,"p":1}
{"ev":"tick","at":500}
"#;

#[test]
fn replay_echoes_the_inputs_and_answers_each() {
    let replayed = run(&["replay"], INPUTS);
    assert_eq!((out(&replayed), err(&replayed)), (TRACE, ""));
    assert_eq!(replayed.status.code(), Some(0));
}

#[test]
fn replay_of_a_whole_trace_is_that_trace() {
    let (_dir, paths) = files(&[("trace.jsonl", TRACE)]);
    assert_eq!(out(&run(&["replay", text(&paths[0])], "")), TRACE);
    assert_eq!(out(&run(&["replay", "-"], TRACE)), TRACE);
}

#[test]
fn replay_reproduces_every_conforming_trace_of_the_corpus() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus");
    let mut replayed = 0;
    for entry in fs::read_dir(corpus).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "jsonl") {
            let trace = fs::read_to_string(&path).unwrap();
            assert_eq!(out(&run(&["replay", text(&path)], "")), trace, "{}", path.display());
            replayed += 1;
        }
    }
    assert!(replayed > 0);
}

#[test]
fn replay_answers_an_input_before_it_sees_the_next() {
    let mut child =
        fuseline(&["replay"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let answers = Lines::of(child.stdout.take().unwrap());
    let mut trace = TRACE.lines().peekable();
    for line in INPUTS.lines() {
        writeln!(input, "{line}").unwrap();
        assert_eq!(trace.next(), Some(line));
        assert_eq!(answers.next(), line);
        while let Some(decision) = trace.next_if(|next| !INPUTS.contains(next)) {
            assert_eq!(answers.next(), decision);
        }
    }
    drop(input);
    assert!(child.wait().unwrap().success());
}

#[test]
fn replay_says_line_and_column_of_bad_input_after_what_it_answered() {
    let bad = INPUTS.replace(r#""at":500"#, r#""at":5.5"#);
    let replayed = run(&["replay"], &bad);
    assert_eq!(replayed.status.code(), Some(2));
    assert!(err(&replayed).starts_with("error: stdin:6:"), "{}", err(&replayed));
    assert_eq!(err(&replayed).lines().count(), 1);
    assert!(TRACE.starts_with(out(&replayed)) && out(&replayed).ends_with("\"p\":1}\n"));
}

#[test]
fn replay_is_quiet_when_its_reader_leaves() {
    let mut child = fuseline(&["replay"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let answers: ChildStdout = child.stdout.take().unwrap();
    drop(answers);
    drop(input.write_all(INPUTS.as_bytes()));
    drop(input);
    let output = child.wait_with_output().unwrap();
    assert_eq!((err(&output), output.status.code()), ("", Some(0)));
}
