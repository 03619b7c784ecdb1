//! OpenTelemetry's spans, to and from traces, as a user does it.

use std::fmt::Write as _;
use std::fs;

use crate::common::{err, out, run};
use serde_json::{Value, json};
use tempfile::tempdir;

const HEADER: &str =
    r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"name":"infer.Model/Infer","limit":31}]}"#;
const MS: u64 = 1_000_000;

/// A span from a millisecond to another; kind 3 is a client's.
fn span(id: &str, parent: &str, name: &str, kind: u64, ms: [u64; 2], more: &Value) -> Value {
    let mut span = json!({
        "traceId": "t", "spanId": id, "parentSpanId": parent, "name": name, "kind": kind,
        "startTimeUnixNano": (ms[0] * MS).to_string(), "endTimeUnixNano": (ms[1] * MS).to_string(),
    });
    let more = more.as_object().unwrap().clone();
    span.as_object_mut().unwrap().extend(more);
    span
}

fn converted(spans: &[Value], more: &[&str]) -> std::process::Output {
    let dir = tempdir().unwrap();
    let (header, file) = (dir.path().join("header.jsonl"), dir.path().join("spans.json"));
    fs::write(&header, format!("{HEADER}\n")).unwrap();
    let export = json!({"resourceSpans": [{"scopeSpans": [{"spans": spans}]}]});
    // As an exporter does it that writes one after the other.
    let empty = json!({"resourceSpans": []});
    fs::write(&file, format!("{export}\n{empty}\n")).unwrap();
    let (header, file) = (header.to_str().unwrap(), file.to_str().unwrap());
    let has_local = spans.iter().any(|span| span["name"] == "plan");
    let local = if has_local { &["--span", "local=plan"][..] } else { &[] };
    run(&[&["convert", "--header", header, file], local, more].concat(), "")
}

/// The lines after the header.
fn events(spans: &[Value], more: &[&str]) -> Vec<String> {
    let converted = converted(spans, more);
    assert_eq!(converted.status.code(), Some(0), "{}", err(&converted));
    out(&converted).lines().skip(1).map(str::to_owned).collect()
}

#[test]
fn a_message_is_opened_and_ended_by_its_span_and_requested_by_client_spans() {
    let code = |code: u64| {
        json!({"attributes": [{"key": "rpc.grpc.status_code", "value": {"intValue": code}}],
            "status": {"code": 2}})
    };
    let spans = [
        span("1", "", "decide", 1, [1, 41], &json!({})),
        span("1l", "1", "plan", 1, [1, 5], &json!({})),
        // Below another span, and out of time: no result, and no failure of the cloud.
        span("1s", "1", "steps", 1, [1, 41], &json!({})),
        span("1c", "1s", "infer.Model/Infer", 3, [1, 41], &code(4)),
        // Spans below a client span belong to it.
        span("1d", "1c", "tcp.connect", 3, [1, 2], &json!({})),
        span("2", "", "decide", 1, [51, 60], &json!({})),
        span("2c", "2", "infer.Model/Infer", 3, [51, 60], &json!({})),
        span("3", "", "decide", 1, [101, 110], &json!({"status": {"code": "STATUS_CODE_ERROR"}})),
        span("3c", "3", "infer.Model/Infer", 3, [101, 109], &code(14)),
    ];
    let lines = events(&spans, &["--deadline", "40ms"]);
    assert_eq!(
        lines,
        [
            r#"{"ev":"open","at":1000000,"t":0}"#,
            r#"{"ev":"request","at":1000000,"t":0,"p":1,"due":41000000}"#,
            r#"{"ev":"result","at":5000000,"t":0,"p":0}"#,
            r#"{"ev":"emit","at":41000000,"t":0,"p":0}"#,
            r#"{"ev":"open","at":51000000,"t":1}"#,
            r#"{"ev":"request","at":51000000,"t":1,"p":1,"due":91000000}"#,
            r#"{"ev":"emit","at":60000000,"t":1,"p":1}"#,
            r#"{"ev":"result","at":60000000,"t":1,"p":1}"#,
            r#"{"ev":"open","at":101000000,"t":2}"#,
            r#"{"ev":"request","at":101000000,"t":2,"p":1,"due":141000000}"#,
            r#"{"ev":"fail","at":109000000,"t":2,"p":1}"#,
            r#"{"ev":"miss","at":110000000,"t":2}"#,
        ]
    );
}

/// The attribute has had several names; the stable one is `rpc.status_code`.
#[test]
fn cancelled_call_is_no_failure_of_the_cloud() {
    let call = |key: &str, code: Value| {
        let value = if code.is_u64() { "intValue" } else { "stringValue" };
        json!({"attributes": [{"key": key, "value": {value: code}}], "status": {"code": 2}})
    };
    for (key, code, failures) in [
        ("rpc.status_code", json!("CANCELLED"), 0),
        ("rpc.status_code", json!("DEADLINE_EXCEEDED"), 0),
        ("rpc.response.status_code", json!("CANCELLED"), 0),
        ("rpc.grpc.status_code", json!(1), 0),
        ("rpc.connect_rpc.error_code", json!("canceled"), 0),
        ("rpc.status_code", json!("UNAVAILABLE"), 1),
    ] {
        let spans = [
            span("1", "", "decide", 1, [1, 21], &json!({})),
            span("1l", "1", "plan", 1, [1, 5], &json!({})),
            span("1c", "1", "infer.Model/Infer", 3, [1, 20], &call(key, code.clone())),
        ];
        let lines = events(&spans, &["--deadline", "40ms"]);
        let failed = lines.iter().filter(|line| line.contains(r#""ev":"fail""#)).count();
        assert_eq!(failed, failures, "{key} {code}: {lines:?}");
    }
}

#[test]
fn several_client_spans_are_attempts_also_one_that_is_linked() {
    let link = json!({"links": [{"traceId": "t", "spanId": "a"}], "status": {"code": 2}});
    let spans = [
        span("1", "", "decide", 1, [1, 9], &json!({})),
        span("a", "1", "infer.Model/Infer", 3, [1, 9], &json!({})),
        span("b", "elsewhere", "infer.Model/Infer", 3, [3, 4], &link),
    ];
    let lines = events(&spans, &["--deadline", "40ms", "--span", "message=decide"]);
    assert!(
        lines.contains(
            &r#"{"ev":"request","at":3000000,"t":0,"p":1,"due":43000000,"try":1}"#.into()
        )
    );
    assert!(
        lines.contains(&r#"{"ev":"fail","at":4000000,"t":0,"p":1,"try":1}"#.into()),
        "{lines:?}"
    );
    assert!(lines.contains(&r#"{"ev":"result","at":9000000,"t":0,"p":1,"try":0}"#.into()));
}

#[test]
fn attributes_are_named_by_options() {
    let attributes = |pairs: &[(&str, Value)]| {
        let pairs = pairs.iter().map(|(key, value)| json!({"key": key, "value": value}));
        json!({"attributes": pairs.collect::<Vec<_>>()})
    };
    let frame = attributes(&[
        ("frame.id", json!({"intValue": "77"})),
        ("used", json!({"stringValue": "infer.Model/Infer"})),
    ]);
    let call = attributes(&[
        ("peer", json!({"stringValue": "infer.Model/Infer"})),
        ("budget", json!({"stringValue": "25ms"})),
        ("reply.of", json!({"intValue": 76})),
        ("reply.for", json!({"intValue": 77})),
    ]);
    let spans =
        [span("1", "", "decide", 1, [1, 9], &frame), span("a", "1", "POST", 3, [1, 8], &call)];
    let names = "t=frame.id,by=used,p=peer,deadline=budget,of=reply.of,for=reply.for";
    assert_eq!(
        events(&spans, &["--attribute", names]),
        [
            r#"{"ev":"open","at":1000000,"t":77}"#,
            r#"{"ev":"request","at":1000000,"t":77,"p":1,"due":26000000}"#,
            r#"{"ev":"result","at":8000000,"t":77,"p":1,"of":76,"for":77}"#,
            r#"{"ev":"emit","at":9000000,"t":77,"p":1}"#,
        ]
    );
}

#[test]
fn what_cannot_be_read_is_reported_with_its_place() {
    let message = span("1", "", "decide", 1, [1, 9], &json!({}));
    let call = span("a", "1", "other", 3, [1, 8], &json!({}));
    let known = span("a", "1", "infer.Model/Infer", 3, [1, 8], &json!({}));
    let late =
        json!({"attributes": [{"key": "fuseline.deadline", "value": {"stringValue": "soon"}}]});
    let soon = span("a", "1", "infer.Model/Infer", 3, [1, 8], &late);
    for (spans, expected) in [
        (vec![], "the file has no complete span"),
        (vec![message.clone(), call], "\"other\" is not a known source; the header has"),
        (
            vec![message.clone(), known],
            "has no deadline: there is no attribute \"fuseline.deadline\"",
        ),
        (
            vec![message, soon],
            "the span \"infer.Model/Infer\" with the id a: attribute \"fuseline.deadline\": \"soon\" is not a duration",
        ),
        (vec![json!({"spanId": "1", "name": "a"})], "missing field `startTimeUnixNano`"),
    ] {
        let failed = converted(&spans, &[]);
        assert_eq!(failed.status.code(), Some(2), "{expected}");
        assert!(err(&failed).contains(expected), "{}", err(&failed));
        assert_eq!(out(&failed), "");
    }
}

#[test]
fn an_exported_trace_comes_back_and_conforms() {
    let dir = tempdir().unwrap();
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/corpus");
    let outputs = |text: &str| {
        let is_kept = |line: &&str| {
            ["open", "request", "emit", "miss"]
                .iter()
                .any(|ev| line.contains(&format!(r#""ev":"{ev}""#)))
        };
        let mut lines: Vec<String> = text.lines().filter(is_kept).map(str::to_owned).collect();
        lines.sort();
        lines
    };
    for name in [
        "f5-coarse-tick-decides-what-fine-ticks-decide-eager",
        "f4-failure-releases-what-is-held",
        "f6-missed-at-the-last-timer",
        "f7-pending-clouds-are-cancelled",
    ] {
        let trace = format!("{corpus}/{name}.jsonl");
        let spans = dir.path().join(format!("{name}.json")).display().to_string();
        let exported = run(&["export", "--otlp", &trace, "-o", &spans], "");
        assert_eq!(err(&exported), "");
        let back = run(&["convert", "--header", &trace, &spans], "");
        assert_eq!(err(&back), "");
        assert_eq!(outputs(out(&back)), outputs(&fs::read_to_string(&trace).unwrap()), "{name}");
        let check = ["check", "--observed", "--tolerance", "1ns", "--lateness", "1s"];
        let judged = run(&check, out(&back));
        assert!(out(&judged).contains(": no violation found, "), "{}", out(&judged));
    }
}

/// A trace's clock may begin with its first message: instant 0 is one as any other.
#[test]
fn what_ends_at_instant_0_is_not_taken_for_what_the_trace_leaves_open() {
    let dir = tempdir().unwrap();
    let (trace, spans) = (dir.path().join("trace.jsonl"), dir.path().join("spans.json"));
    let shown = |lines: &[&str]| {
        let header = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":4,"resume":0}]}"#;
        let open = r#"{"ev":"open","at":0,"t":0}"#;
        let request = r#"{"ev":"request","at":0,"t":0,"p":1,"due":9}"#;
        let lines = [&[header, open, request], lines].concat();
        fs::write(&trace, lines.join("\n") + "\n").unwrap();
        let (trace, spans) = (trace.to_str().unwrap(), spans.to_str().unwrap());
        let exported = run(&["export", "--force", "--otlp", trace, "-o", spans], "");
        assert_eq!((exported.status.code(), err(&exported)), (Some(0), ""));
        let exported: Value = serde_json::from_slice(&fs::read(spans).unwrap()).unwrap();
        let spans = exported["resourceSpans"][0]["scopeSpans"][0]["spans"].as_array().unwrap();
        let ended = |span: &Value| {
            let attributes = span["attributes"].as_array().unwrap();
            attributes
                .iter()
                .find(|it| it["key"] == "fuseline.ended")
                .map_or("", |it| it["value"]["stringValue"].as_str().unwrap())
                .to_owned()
        };
        let one = |span: &Value| (span["status"]["code"].as_u64().unwrap(), ended(span));
        spans.iter().map(one).collect::<Vec<_>>()
    };
    let retired = || (0, "retired".to_owned());
    let open = || (0, String::new());
    // Local, the cloud, the message.
    let emitted = [r#"{"ev":"result","at":0,"t":0,"p":1}"#, r#"{"ev":"emit","at":0,"t":0,"p":1}"#];
    assert_eq!(shown(&emitted), [(1, String::new()), retired(), (1, String::new())]);
    assert_eq!(
        shown(&[r#"{"ev":"miss","at":0,"t":0}"#]),
        [retired(), retired(), (2, String::new())]
    );
    assert_eq!(shown(&[]), [open(), open(), (1, String::new())]);
}

/// A text attribute.
fn named(key: &str, value: &str) -> Value {
    json!({"key": key, "value": {"stringValue": value}})
}

#[test]
fn other_clients_say_by_an_option_who_ended_a_call() {
    let timeout = json!({"attributes": [named("error.type", "timeout")], "status": {"code": 2}});
    let spans = [
        span("1", "", "decide", 1, [1, 21], &json!({})),
        span("1l", "1", "plan", 1, [1, 5], &json!({})),
        span("1c", "1", "infer.Model/Infer", 3, [1, 20], &timeout),
    ];
    let more = ["--deadline", "40ms"];
    let done = converted(&spans, &more);
    let note = "failed client spans that ended with their message and before their deadline, read as failures of the cloud: 1 \
                (the span \"infer.Model/Infer\" with the id 1c); if the caller ended them, give --cancelled error.type=timeout";
    assert!(err(&done).contains(note), "{}", err(&done));
    assert!(out(&done).contains("\"ev\":\"fail\""), "{}", out(&done));
    let done = converted(&spans, &[&more[..], &["--cancelled", "error.type=timeout"]].concat());
    assert!(!err(&done).contains("failed client spans"), "{}", err(&done));
    assert!(!out(&done).contains("\"ev\":\"fail\""), "{}", out(&done));
    let done = converted(&spans, &[&more[..], &["--cancelled", "eror.type=timeout"]].concat());
    assert!(err(&done).contains("the file has no attribute \"eror.type\""), "{}", err(&done));
    let done = converted(&spans, &[&more[..], &["--cancelled", "error.type=timeuot"]].concat());
    let message = "--cancelled error.type=timeuot: the file has no attribute \"error.type\" with \
                   the value \"timeuot\"; it has timeout";
    assert!(err(&done).contains(message), "{}", err(&done));
}

#[test]
fn spans_left_out_are_counted() {
    let message = |trace: &str, id: &str, ms: [u64; 2]| {
        let mut span = span(id, "", "decide", 1, ms, &json!({}));
        span["traceId"] = trace.into();
        span
    };
    let call = |trace: &str, id: &str, parent: &str, ms: [u64; 2]| {
        let mut span = span(id, parent, "infer.Model/Infer", 3, ms, &json!({}));
        span["traceId"] = trace.into();
        span
    };
    // The second trace has the same ids of spans; the third has no root; the fourth ends before it
    // begins.
    let spans = [
        message("a", "1", [1, 9]),
        call("a", "2", "1", [1, 8]),
        message("b", "1", [101, 109]),
        call("b", "2", "1", [101, 108]),
        call("b", "2", "1", [101, 108]),
        call("c", "2", "1", [201, 208]),
        message("d", "1", [309, 301]),
    ];
    let done = converted(&spans, &["--deadline", "40ms"]);
    assert_eq!((out(&done).lines().count(), done.status.code()), (9, Some(0)), "{}", out(&done));
    for note in [
        "spans exported twice; each was used once: 1 (the span \"infer.Model/Infer\" with the id 2)",
        "client spans skipped, because no message is above them (its span may not be in the file): 1",
        "messages skipped, because one of their spans ends before it begins: 1 (the span \"decide\" with the id 1: by 8 ms)",
    ] {
        assert!(err(&done).contains(note), "{}", err(&done));
    }
}

#[test]
fn spans_that_cannot_be_read_are_left_out() {
    let own = |deadline: &str| json!({"attributes": [named("fuseline.deadline", deadline)]});
    let mut broken = span("3", "", "decide", 1, [201, 209], &json!({}));
    broken["startTimeUnixNano"] = Value::Null;
    let spans = [
        span("1", "", "decide", 1, [1, 9], &json!({})),
        span("1c", "1", "infer.Model/Infer", 3, [1, 8], &own("40ms")),
        span("2", "", "decide", 1, [101, 109], &json!({})),
        span("2c", "2", "infer.Model/Infer", 3, [101, 108], &own("soon")),
        broken,
    ];
    assert_eq!(converted(&spans, &[]).status.code(), Some(2));
    let done = converted(&spans, &["--skip-bad"]);
    assert_eq!((out(&done).lines().count(), done.status.code()), (5, Some(0)), "{}", err(&done));
    let note = "rows skipped, because they cannot be read: 2 (first the span \"decide\" with the id 3: missing field";
    assert!(err(&done).contains(note), "{}", err(&done));
}

/// The spans of one message may stand in several files, and some in two.
#[test]
fn spans_of_several_files_are_one_log() {
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let message = span("1", "", "decide", 1, [1, 9], &json!({}));
    let call = span("2", "1", "infer.Model/Infer", 3, [1, 8], &json!({}));
    fs::write(path("header.jsonl"), format!("{HEADER}\n")).unwrap();
    // Without any wrapper.
    fs::write(path("one.json"), json!([call, message]).to_string()).unwrap();
    fs::write(path("two.json"), json!([message]).to_string()).unwrap();
    let (header, one, two) = (path("header.jsonl"), path("one.json"), path("two.json"));
    let more = ["--deadline", "40ms"];
    let done = run(&[&["convert", "--header", &header, &one, &two], &more[..]].concat(), "");
    assert_eq!((out(&done).lines().count(), done.status.code()), (5, Some(0)), "{}", err(&done));
    assert!(err(&done).contains("two.json: spans exported twice; each was used once: 1"));
    let other = json!([{"traceID": "1", "operationName": "decide"}]).to_string();
    fs::write(&one, other).unwrap();
    let done = run(&["convert", "--header", &header, &one], "");
    assert_eq!(done.status.code(), Some(2));
    assert!(err(&done).contains("an older format of Jaeger or Zipkin"), "{}", err(&done));
    fs::write(&one, "[]").unwrap();
    let done = run(&["convert", "--from", "otlp", "--header", &header, &one], "");
    assert!(err(&done).contains("the file has no complete span"), "{}", err(&done));
    fs::write(&one, "INFO: {\"spans\":[]}").unwrap();
    let done = run(&["convert", "--from", "otlp", "--header", &header, &one], "");
    assert!(err(&done).contains("remove that with grep"), "{}", err(&done));
}

#[test]
fn sources_of_spans_are_no_unused_names() {
    let spans = [
        span("1", "", "decide", 1, [1, 9], &json!({})),
        span("2", "1", "infer.Model/Infer", 3, [1, 8], &json!({})),
        span("3", "1", "resize", 1, [1, 2], &json!({})),
    ];
    let shown = converted(&spans, &["--deadline", "40ms", "--explain", "--span", "message=decide"]);
    assert!(out(&shown).contains("\nnot used  resize\n"), "{}", out(&shown));
}

#[test]
fn spans_that_never_ended_are_counted() {
    let spans = [
        span("1", "", "decide", 1, [1, 9], &json!({})),
        span("2", "1", "infer.Model/Infer", 3, [1, 0], &json!({})),
        span("3", "1", "plan", 1, [1, 2], &json!({})),
    ];
    let done = converted(&spans, &["--deadline", "40ms"]);
    let note = "spans that have not ended, read as unfinished: 1 (the span \"infer.Model/Infer\" with the id 2)";
    assert!(err(&done).contains(note), "{}", err(&done));
}

/// Under progressive a message goes on after its output.
#[test]
fn a_progressive_output_comes_back() {
    let dir = tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (trace, spans) = (at("trace.jsonl"), at("spans.json"));
    let lines = concat!(
        r#"{"fuseline":1,"window":4,"commit":"progressive","clouds":[{"p":1,"name":"west","limit":31}]}"#,
        "\n",
        r#"{"ev":"open","at":1000000,"t":1}"#,
        "\n",
        r#"{"ev":"request","at":1000000,"t":1,"p":1,"due":51000000}"#,
        "\n",
        r#"{"ev":"result","at":9000000,"t":1,"p":0}"#,
        "\n",
        r#"{"ev":"emit","at":9000001,"t":1,"p":0}"#,
        "\n",
    );
    for end in ["", "{\"ev\":\"final\",\"at\":51000000,\"t\":1,\"p\":0}\n"] {
        fs::write(&trace, format!("{lines}{end}")).unwrap();
        let exported = run(&["export", "--otlp", "--force", &trace, "-o", &spans], "");
        assert_eq!(err(&exported), "");
        let back = run(&["convert", "--header", &trace, &spans], "");
        assert_eq!(out(&back), lines);
    }
}

/// Whatever is recorded, its spans have the same verdict, or the export says what they lack.
#[test]
fn drawn_traces_come_back_with_their_verdicts() {
    let dir = tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (trace, spans, back) = (at("trace.jsonl"), at("spans.json"), at("back.jsonl"));
    let check = ["check", "--json", "--observed", "--tolerance", "1ms", "--lateness", "5ms"];
    let verdict = |path: &str| {
        let verdict: Value =
            serde_json::from_str(out(&run(&[&check[..], &[path]].concat(), ""))).unwrap();
        let broken = verdict["violations"].as_array().unwrap();
        let broken: std::collections::BTreeSet<(u64, String)> = broken
            .iter()
            .map(|it| (it["t"].as_u64().unwrap(), it["rule"].as_str().unwrap().to_owned()))
            .collect();
        (broken, verdict["judged"].clone())
    };
    let (mut compared, mut broken, mut noted) = (0, 0, 0);
    for seed in 0..48 {
        fs::write(&trace, drawn(seed)).unwrap();
        let exported = run(&["export", "--otlp", "--force", &trace, "-o", &spans], "");
        assert_eq!(exported.status.code(), Some(0), "{}", err(&exported));
        let converted = run(&["convert", "--header", &trace, "--force", &spans, "-o", &back], "");
        assert_eq!(converted.status.code(), Some(0), "{seed}: {}", err(&converted));
        if err(&exported).contains("spans cannot express them") {
            noted += 1;
            continue;
        }
        compared += 1;
        let own = verdict(&trace);
        broken += u64::from(!own.0.is_empty());
        let text = fs::read_to_string(&trace).unwrap();
        assert_eq!(verdict(&back), own, "{seed}: {text}\n{}", fs::read_to_string(&back).unwrap());
    }
    assert!(compared > 20 && broken > 8 && noted > 4, "{compared} {broken} {noted}");
}

/// A recorded run of four messages, the second of which goes wrong in a way of its own.
fn drawn(seed: u64) -> String {
    let mut text = format!("{HEADER}\n");
    let mut line = |ev: &str, at: u64, t: u64, more: &str| {
        let at = at * MS;
        writeln!(text, "{{\"ev\":\"{ev}\",\"at\":{at},\"t\":{t}{more}}}")
            .expect("a string takes all");
    };
    let wrong = seed % 8;
    for t in 1..=4 {
        let start = 200 * t + seed;
        let is_wrong = t == 2;
        line("open", start, t, "");
        line("request", start + 1, t, &format!(",\"p\":1,\"due\":{}", (start + 81) * MS));
        let local = start + 10 + seed % 7;
        line("result", local, t, ",\"p\":0");
        match (is_wrong, wrong) {
            // A second output, a miss after the output, a second request.
            (true, 0) => {
                line("result", start + 40, t, ",\"p\":1");
                line("emit", start + 40, t, ",\"p\":1");
                line("emit", start + 45, t, ",\"p\":1");
            }
            (true, 1) => {
                line("result", start + 40, t, ",\"p\":1");
                line("emit", start + 40, t, ",\"p\":1");
                line("miss", start + 41, t, "");
            }
            // The first result wins.
            (true, 2) => line("emit", local, t, ",\"p\":0"),
            // Local's result is passed over.
            (true, 3) => line("miss", start + 82, t, ""),
            // A late result is sent.
            (true, 4) => {
                line("result", start + 130, t, ",\"p\":1");
                line("emit", start + 130, t, ",\"p\":1");
            }
            // The better result is held back.
            (true, 5) => {
                line("result", start + 30, t, ",\"p\":1");
                line("emit", start + 81, t, ",\"p\":0");
            }
            // Nothing comes out.
            (true, 6) => {}
            // The cloud fails, or answers.
            _ if (seed + t).is_multiple_of(3) => {
                line("fail", start + 50, t, ",\"p\":1");
                line("emit", start + 50, t, ",\"p\":0");
            }
            _ => {
                line("result", start + 40, t, ",\"p\":1");
                line("emit", start + 41, t, ",\"p\":1");
            }
        }
    }
    text
}
