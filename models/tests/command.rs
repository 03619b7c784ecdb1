//! Tests the command from outside.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Output, Stdio};

fn models(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fuseline-models")).args(args).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

#[test]
fn what_holds_is_reported_in_a_table_and_exits_with_0() {
    let output = models(&["check", "1x2w1"]);
    let out = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{out}");
    for name in ["1x2w1-eager", "1x2w1-patient", "1x2w1-progressive"] {
        let row = out.lines().find(|line| line.contains(name)).expect("a row");
        assert!(row.trim_end().ends_with(" holds") && row.contains(" 267 "), "{row}");
    }
}

#[test]
fn json_is_one_object_a_configuration() {
    let output = models(&["check", "--json", "1x2w1"]);
    let lines: Vec<serde_json::Value> = text(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("an object"))
        .collect();
    assert_eq!(lines.len(), 3);
    let [first, ..] = &lines[..] else { panic!("{lines:?}") };
    assert_eq!(first["config"], "1x2w1-eager");
    assert_eq!(first["holds"], true);
    assert_eq!(first["states"], 267);
    assert_eq!(first["violations"], serde_json::json!({}));
    assert_eq!(first["unmet"], serde_json::json!([]));
}

#[test]
fn unknown_configuration_exits_with_2() {
    for args in [&["check", "1x"][..], &["explore", "1x2w1"], &["check", "--what"], &["prove"]] {
        let output = models(args);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.starts_with("error: ") && message.lines().count() == 1, "{message}");
        assert_eq!(text(&output.stdout), "");
    }
}

#[test]
fn taken_address_exits_with_2() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let output = models(&["explore", "1x2w1-eager", "--listen", &address]);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(
        message.lines().last().is_some_and(|line| line.starts_with("error: --listen")),
        "{message}"
    );
}

#[test]
fn the_list_names_every_configuration_with_its_states() {
    let out = text(&models(&["list"]).stdout);
    for config in fuseline_models::WORLDS {
        let row = out.lines().find(|line| line.trim_start().starts_with(config.name));
        assert!(row.expect("a row").trim_end().ends_with(&config.states.to_string()), "{out}");
    }
}

#[test]
fn the_explorer_shows_steps_in_the_words_of_the_trace() {
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("one").port();
    let address = format!("127.0.0.1:{port}");
    let mut explorer = Command::new(env!("CARGO_BIN_EXE_fuseline-models"))
        .args(["explore", "1x2w1-eager", "--listen", &address])
        .stderr(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut message = String::new();
    let mut stderr = BufReader::new(explorer.stderr.take().expect("a pipe"));
    stderr.read_line(&mut message).expect("a line");
    assert!(message.contains(&address), "{message}");
    // The command prints this line before it listens.
    let steps = loop {
        if let Some(answer) = request(&address, "/.states/0") {
            break answer;
        }
        assert!(explorer.try_wait().expect("a state").is_none(), "the explorer ended");
        std::thread::yield_now();
    };
    explorer.kill().expect("it ends");
    explorer.wait().expect("it ended");
    let action = r#""action":"{\"ev\":\"open\",\"at\":0,\"t\":0,\"deadline\":0}""#;
    let refusal = r#"{\"ev\":\"refuse\",\"at\":0,\"t\":0,\"why\":\"deadline\"}"#;
    let step = format!("{action},\"outcome\":\"{refusal}\\nnow 0, nothing opened\"");
    assert!(steps.contains(&step), "{steps}");
}

/// Returns the server's response for a path, if it listens.
fn request(address: &str, path: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    Some(answer)
}
