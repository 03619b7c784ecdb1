//! `fuseline convert` of logs as robots leave them.

use std::fs;

use crate::common::{err, out, run};
use serde_json::{Value, json};
use tempfile::{TempDir, tempdir};

const HEADER: &str = r#"{"fuseline":1,"window":16,"clouds":[{"p":1,"name":"west","limit":31},{"p":2,"name":"east","limit":31}]}"#;

/// A folder with a header and a file.
fn folder(name: &str, text: &str) -> TempDir {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("header.jsonl"), format!("{HEADER}\n")).unwrap();
    fs::write(dir.path().join(name), text).unwrap();
    dir
}

fn convert(dir: &TempDir, name: &str, more: &[&str]) -> std::process::Output {
    let path = |name: &str| dir.path().join(name).display().to_string();
    let (header, file) = (path("header.jsonl"), path(name));
    run(&[&["convert", "--header", &header, &file], more].concat(), "")
}

/// The events of a trace, without its header.
fn events(text: &str, name: &str, more: &[&str]) -> Vec<Value> {
    let dir = folder(name, text);
    let done = convert(&dir, name, more);
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    out(&done).lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn refused(text: &str, name: &str, more: &[&str]) -> String {
    let dir = folder(name, text);
    let done = convert(&dir, name, more);
    assert_eq!((done.status.code(), err(&done).lines().count()), (Some(2), 1), "{}", err(&done));
    err(&done).to_owned()
}

#[test]
fn json_lines_are_read_with_keys_within_others_and_sources_by_name() {
    let log = concat!(
        r#"{"header":{"stamp":1795629600.000000001,"seq":7},"kind":"frame"}"#,
        "\n\n",
        r#"{"header":{"stamp":1795629600.25,"seq":7},"kind":"sent","to":"east","budget":500}"#,
        "\n",
        r#"{"header":{"stamp":1795629600.3,"seq":7},"kind":"heartbeat"}"#,
        "\n",
        r#"{"header":{"stamp":"2026-11-25T18:00:00.4Z","seq":7},"kind":"done","to":"local"}"#,
        "\n",
    );
    let mapped = [
        "--column",
        "at=header.stamp,t=header.seq,ev=kind,p=to,deadline=budget",
        "--event",
        "frame=open,sent=request,done=result,heartbeat=",
        "--unit",
        "s",
        "--unit",
        "deadline=ms",
    ];
    let at = 1_795_629_600_000_000_000_u64;
    let expected = [
        json!({"ev": "open", "at": at + 1, "t": 7}),
        json!({"ev": "request", "at": at + 250_000_000, "t": 7, "p": 2, "due": at + 750_000_000}),
        json!({"ev": "result", "at": at + 400_000_000, "t": 7, "p": 0}),
    ];
    assert_eq!(events(log, "log.jsonl", &mapped), expected);
}

#[test]
fn a_unit_of_one_column_is_that_columns_alone() {
    let rows = "at,ev,t,p,deadline\n1.5,open,1,,\n1.5,request,1,west,500\n";
    let found = events(rows, "events.csv", &["--unit", "s,deadline=ms"]);
    assert_eq!(found[1]["due"], 2_000_000_000_u64);
    let refused = refused(rows, "events.csv", &["--unit", "t=ms"]);
    assert!(
        refused.contains("there is no time \"t\"; give one of at, due, deadline, within, age"),
        "{refused}"
    );
}

#[test]
fn cells_may_be_separated_by_anything() {
    for (separator, text) in [("tab", "\t"), (";", ";"), ("|", "|")] {
        let rows = "at,ev,t\n1,open,1\n".replace(',', text);
        assert_eq!(events(&rows, "events.csv", &["--separator", separator]).len(), 1);
    }
    let refused = refused("at,ev,t\n", "events.csv", &["--separator", "::"]);
    assert!(refused.contains("one ASCII character, or tab"), "{refused}");
}

#[test]
fn a_row_a_frame_becomes_the_events_of_its_columns_in_their_order() {
    let rows = "\
seq;recv;sent;done;failed;own;out;winner
7;2026-11-25T18:00:00Z;2026-11-25T18:00:00.001Z;2026-11-25T18:00:00.2Z;;2026-11-25T18:00:00.3Z;2026-11-25T18:00:00.2Z;east
8;2026-11-25T18:00:00.1Z;2026-11-25T18:00:00.1Z;;2026-11-25T18:00:00.15Z;2026-11-25T18:00:00.4Z;2026-11-25T18:00:00.4Z;local
";
    let frame = "t=seq,open=recv,emit=out,by=winner,east.request=sent,east.deadline=0.5,\
                 east.result=done,east.fail=failed,local.result=own";
    let found = events(rows, "frames.csv", &["--separator", ";", "--unit", "s", "--frame", frame]);
    let at = 1_795_629_600_000_000_000_u64;
    let ms = |ms: u64| at + ms * 1_000_000;
    let expected = [
        json!({"ev": "open", "at": at, "t": 7}),
        json!({"ev": "request", "at": ms(1), "t": 7, "p": 2, "due": ms(501)}),
        json!({"ev": "open", "at": ms(100), "t": 8}),
        json!({"ev": "request", "at": ms(100), "t": 8, "p": 2, "due": ms(600)}),
        json!({"ev": "fail", "at": ms(150), "t": 8, "p": 2}),
        json!({"ev": "result", "at": ms(200), "t": 7, "p": 2}),
        json!({"ev": "emit", "at": ms(200), "t": 7, "p": 2}),
        json!({"ev": "result", "at": ms(300), "t": 7, "p": 0}),
        json!({"ev": "result", "at": ms(400), "t": 8, "p": 0}),
        json!({"ev": "emit", "at": ms(400), "t": 8, "p": 0}),
    ];
    assert_eq!(found, expected);
}

#[test]
fn what_is_wrong_in_a_log_is_reported_with_its_line() {
    let frames = "recv,out,winner,sent\n1,2,south,\n";
    for (text, name, args, expected) in [
        (
            "{\"ev\":\"open\",\"t\":1}\n",
            "log.jsonl",
            &[][..],
            "1: this open has no key \"at\"; name it with --column at=NAME; the row has t, ev",
        ),
        ("\n{\"ev\":\"open\",\"at\":1\n", "log.jsonl", &[], "2: not a JSON object"),
        (
            "{\"ev\":\"open\",\"at\":\"1.5 h\",\"t\":1}\n",
            "log.jsonl",
            &[],
            "1: column \"at\": \"1.5 h\" is not an instant; write a number of ns, a number with \
             its unit",
        ),
        ("{\"ev\":\"ping\",\"at\":1}\n", "log.jsonl", &[], "or skip it with --event ping="),
        (
            "{\"ev\":\"fail\",\"at\":1,\"t\":1,\"p\":\"south\"}\n",
            "log.jsonl",
            &[],
            "\"south\" is not a known source; the header has east, local, west",
        ),
        (
            frames,
            "frames.csv",
            &["--frame", "open=recv,emit=out,by=winner"],
            "2: column \"winner\": \"south\" is not a known source",
        ),
        (frames, "frames.csv", &["--frame", "emit=out"], ": no column for open"),
        (
            frames,
            "frames.csv",
            &["--frame", "open=rcv"],
            ": --frame open=rcv: the file has no \"rcv\"; it has recv, ",
        ),
        (
            frames,
            "frames.csv",
            &["--frame", "open=recv,emit=out"],
            "2: the output does not say whose result it is, and no result of its message came \
             before it",
        ),
        (
            "recv,sent\n1,2\n",
            "frames.csv",
            &["--frame", "open=recv,west.request=sent"],
            "2: the request to west has no deadline: no column is given for it; ",
        ),
        (
            frames,
            "frames.csv",
            &["--frame", "open=recv,south.result=sent"],
            ": --frame south.…: \"south\" is not a known source; the header has ",
        ),
        ("x", "log.mcap", &["--frame", "open=recv"], "--frame is for rows of CSV and JSON"),
    ] {
        let refused = refused(text, name, args);
        assert!(refused.contains(expected), "{text}: {refused}");
    }
}

#[test]
fn a_header_is_made_by_asking_what_the_file_does_not_say() {
    let dir =
        folder("log.csv", "at,ev,t,p\n0,open,1,\n1,result,1,east\n2,result,1,local\n3,fail,1,3\n");
    let file = dir.path().join("log.csv").display().to_string();
    let answers = "2\nfar\ndetector\npatient\n32\n";
    let done = run(&["convert", "--write-header", &file], answers);
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    let header: Value = serde_json::from_str(out(&done)).unwrap();
    assert_eq!((&header["operator"], &header["commit"]), (&"detector".into(), &"patient".into()));
    let clouds = header["clouds"].as_array().unwrap();
    let named: Vec<_> = clouds.iter().map(|cloud| (&cloud["p"], &cloud["name"])).collect();
    assert_eq!(named, [(&2.into(), &"east".into()), (&3.into(), &"far".into())]);
    assert!(err(&done).contains("priority of east, the greater the better: "), "{}", err(&done));
    let silent = run(&["convert", "--write-header", &file], "");
    assert_eq!(silent.status.code(), Some(2));
    assert!(err(&silent).contains("asks for priority of east"), "{}", err(&silent));
}

#[test]
fn times_of_day_are_taken_up_to_their_bounds_and_no_further() {
    let log = |at: &str| format!("{{\"ev\":\"tick\",\"at\":\"{at}\"}}\n");
    for (at, seconds) in [
        ("1970-01-01T23:59:59Z", 86_399_u64),
        // A leap second is the next one.
        ("1970-01-31T23:59:60Z", 31 * 86_400),
        ("1970-12-31 00:00:00", 364 * 86_400),
        ("1972-02-29T00:00:00+00", 789 * 86_400),
    ] {
        let found = events(&log(at), "log.jsonl", &[]);
        assert_eq!(found, [json!({"ev": "tick", "at": seconds * 1_000_000_000})], "{at}");
    }
    for at in [
        "2026-11-25T18:60:00Z",
        "2026-11-25T18:00:61Z",
        "2026-11-25T18:00:00:00Z",
        "2026-11-31T18:00:00Z",
        "2026-12-32T18:00:00Z",
        "2026-11-00T18:00:00Z",
        "2026-00-25T18:00:00Z",
        "2100-02-29T18:00:00Z",
    ] {
        let refused = refused(&log(at), "log.jsonl", &[]);
        assert!(refused.contains("is not an instant"), "{at}: {refused}");
    }
}

/// The words of the chapter's `names=`, with what is added to them.
fn names_of(chapter: &str) -> Vec<String> {
    let (_, names) = chapter.split_once("names=\"--").unwrap();
    let (_, more) = chapter.split_once("names=\"$names ").unwrap();
    let words = |text: &str| text.split('"').next().unwrap().to_owned();
    let names = format!("--{} {}", words(names), words(more));
    names.split_whitespace().map(str::to_owned).collect()
}

/// The chapter of the book, with the log that ships.
#[test]
fn the_books_log_is_judged_as_its_chapter_says() {
    let book = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/book/src/start");
    let read = |name: &str| fs::read_to_string(format!("{book}/{name}")).unwrap();
    let chapter = read("own-log.md");
    let names = names_of(&chapter);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let (log, header) = (path("robot.jsonl"), path("header.jsonl"));
    fs::write(&log, read("robot.jsonl")).unwrap();
    // Each screen has the lines that the chapter shows.
    let place = format!("{}/", dir.path().display());
    let known = &names[..names.len() - 3];
    for (options, shown) in [
        (&[][..], "name      what (52): frame, sent, done, out, heartbeat"),
        (&[], "name      frame.id (50): 1, 2, 3, 4, 5, 6, …"),
        (&[], "name      source (40): west, local"),
        (
            known,
            "rows that cannot be read, at which convert stops without --skip-bad: 2 (first line 1: not a JSON object: ",
        ),
        (
            &names[..],
            "west      results 140 ms to 261 ms after the request; deadlines 200 ms, 10 of 10 answered; 2 late;",
        ),
        (
            &names[..],
            "time      1.047 s from line 2 to line 53; 10 messages, one every 100 ms, the longest gap 100 ms",
        ),
        (known, "requests without a deadline, at which convert stops: 1 (line 15: "),
        (&names[..], "clock     all stamps are multiples of 1 ms"),
        (&names[..], "not used  battery, seq"),
    ] {
        let explained = run(&[&["convert", "--explain", &log], options].concat(), "");
        assert_eq!((explained.status.code(), err(&explained)), (Some(0), ""));
        let screen = out(&explained).replace(&place, "");
        assert!(screen.contains(shown) && chapter.contains(shown), "{shown}: {screen}");
    }
    let made = run(&[&["convert", "--write-header"], &names[..], &[&log]].concat(), "1\n\n\n\n");
    assert_eq!(made.status.code(), Some(0), "{}", err(&made));
    fs::write(&header, out(&made)).unwrap();
    let trace = run(&[&["convert", "--header", &header], &names[..], &[&log]].concat(), "");
    assert_eq!(trace.status.code(), Some(0), "{}", err(&trace));
    assert!(
        err(&trace).contains("rows skipped, because they cannot be read: 2"),
        "{}",
        err(&trace)
    );
    let judge = ["check", "--observed", "--lateness", "4ms", "--tolerance"];
    let judged = run(&[&judge[..], &["1ms"]].concat(), out(&trace));
    assert_eq!((judged.status.code(), err(&judged)), (Some(1), ""));
    let verdict = out(&judged).lines().next().unwrap().replace("stdin", "robot-trace.jsonl");
    assert!(chapter.contains(&verdict), "{verdict}");
    let swallowed = run(&[&judge[..], &["100ms"]].concat(), out(&trace));
    assert_eq!(swallowed.status.code(), Some(3));
    assert!(out(&swallowed).contains("in doubt: 10 coarse\n"), "{}", out(&swallowed));
    assert!(chapter.contains("in doubt: 10 coarse\n"));
}

/// Returns the events of a log that is converted, and the text on standard error.
fn noted(text: &str, name: &str, more: &[&str]) -> (Vec<Value>, String) {
    let dir = folder(name, text);
    let done = convert(&dir, name, more);
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    let events = out(&done).lines().skip(1).map(|line| serde_json::from_str(line).unwrap());
    (events.collect(), err(&done).to_owned())
}

#[test]
fn mistyped_names_are_refused_with_the_closest() {
    let log = "{\"at\":1,\"ev\":\"open\",\"frame\":1}\n{\"at\":2,\"ev\":\"miss\",\"frame\":1}\n";
    for (option, named) in [
        (
            ["--column", "t=frame,of=fram"],
            "--column of=fram: the file has no \"fram\"; it has frame,",
        ),
        (["--column", "t=farme"], "--column t=farme: the file has no \"farme\"; it has frame,"),
        (["--frame", "t=frme,open=at"], "--frame t=frme: the file has no \"frme\"; it has frame,"),
    ] {
        let refused = refused(log, "log.jsonl", &option);
        assert!(refused.contains(named), "{refused}");
    }
}

#[test]
fn constants_stand_where_names_do() {
    let rows = "at,ev,t,p\n0,open,1,\n1,request,1,west\n9,result,1,west\n9,emit,1,west\n";
    let (events, notes) = noted(rows, "log.csv", &["--column", "within=30ns,deadline=20ns"]);
    assert_eq!((&events[0]["within"], &events[1]["due"]), (&30.into(), &21.into()));
    assert_eq!(notes, "");
    let calls = "{\"id\":4,\"from\":0,\"call\":{\"end\":9}}\n";
    let frame = "t=id,open=from,within=30ns,local.deadline=50ns,west.request=from,west.deadline=20ns,\
                 west.result=call.end,emit=call.end,by=west";
    let (events, _) = noted(calls, "log.jsonl", &["--frame", frame]);
    let expected = [
        json!({"ev": "open", "at": 0, "t": 4, "deadline": 50, "within": 30}),
        json!({"ev": "request", "at": 0, "t": 4, "p": 1, "due": 20}),
        json!({"ev": "result", "at": 9, "t": 4, "p": 1}),
        json!({"ev": "emit", "at": 9, "t": 4, "p": 1}),
    ];
    assert_eq!(events, expected);
    let one = "at,ev,t\n0,open,1\n1,request,1\n9,result,1\n9,emit,1\n";
    let (events, _) = noted(one, "log.csv", &["--column", "p=east", "--deadline", "east=7ns,9ns"]);
    assert_eq!((&events[1]["p"], &events[1]["due"]), (&2.into(), &8.into()));
}

#[test]
fn source_of_an_output_is_guessed_or_refused() {
    let log = |last: u64| {
        format!(
            "at,ev,t,p\n0,open,1,\n10000000,result,1,local\n{last},result,1,west\n40000000,emit,1,\n"
        )
    };
    let (events, notes) = noted(&log(30_000_000), "log.csv", &[]);
    assert_eq!(events[3]["p"], 1);
    let note = "outputs that do not say whose result they are (the latest result was taken): 1 \
                (line 5: west)";
    assert!(notes.contains(note), "{notes}");
    let refused = refused(&log(10_500_000), "log.csv", &[]);
    assert!(
        refused.contains(
            "log.csv:5: the output does not say whose result it is, and the results of west and \
             local came at the same time"
        ),
        "{refused}"
    );
}

#[test]
fn keys_of_a_trace_are_read_where_they_are_named() {
    let log = "{\"at\":0,\"ev\":\"open\",\"t\":1,\"seq\":9,\"age\":3,\"within\":8}\n\
               {\"at\":5,\"ev\":\"result\",\"t\":1,\"p\":0,\"of\":1,\"for\":1}\n\
               {\"at\":5,\"ev\":\"emit\",\"t\":1,\"p\":0}\n";
    let (events, notes) = noted(log, "log.jsonl", &[]);
    assert_eq!(events[0], json!({"ev": "open", "at": 0, "t": 1}));
    for key in ["of", "for", "within"] {
        let note = format!("values of the key \"{key}\", which no --column names: 1 (line ");
        assert!(notes.contains(&note), "{notes}");
    }
    let (events, notes) =
        noted(log, "log.jsonl", &["--column", "of=of,for=for,within=within,age=age"]);
    assert_eq!(events[0], json!({"ev": "open", "at": 0, "t": 1, "within": 8, "age": 3}));
    assert_eq!((&events[1]["of"], &events[1]["for"], &*notes), (&1.into(), &1.into(), ""));
}

#[test]
fn runs_of_a_log_are_split() {
    let run = |at: u64, t: u64| {
        format!("{at},open,{t},\n{},result,{t},0\n{},emit,{t},0\n", at + 9, at + 9)
    };
    let second = 1_000_000_000;
    let opens = |all: &[(u64, u64)]| {
        let rows = all.iter().map(|(at, t)| run(at * second, *t)).collect::<String>();
        format!("at,ev,t,p\n{rows}")
    };
    for (all, line, counts) in [
        // The clock begins again, and ids go on.
        (&[(5, 1), (6, 2), (7, 3), (0, 4), (1, 5)][..], 11, [9, 6]),
        // Both begin again.
        (&[(5, 10), (6, 11), (7, 12), (5, 3), (6, 4)], 11, [9, 6]),
        // The counter begins again, at an id that was there, or before it.
        (&[(1, 1), (2, 2), (3, 3), (4, 1), (5, 2)], 11, [9, 6]),
        (&[(1, 5), (2, 6), (3, 7), (4, 4), (5, 5), (6, 6)], 11, [9, 9]),
    ] {
        let dir = folder("log.csv", &opens(all));
        let refused = convert(&dir, "log.csv", &[]);
        assert_eq!(refused.status.code(), Some(2), "{all:?}: {}", out(&refused));
        let stands =
            err(&refused).contains("the log restarts here") && err(&refused).contains("--split");
        assert!(stands, "{all:?}: {}", err(&refused));
        let sorted = convert(&dir, "log.csv", &["--sort"]);
        assert_eq!(sorted.status.code(), Some(2), "{all:?}: {}", out(&sorted));
        assert!(err(&sorted).contains("the log restarts here"), "{}", err(&sorted));
        let path = |name: &str| dir.path().join(name).display().to_string();
        let split = convert(&dir, "log.csv", &["--split", "-o", &path("trace.jsonl")]);
        assert_eq!(split.status.code(), Some(0), "{}", err(&split));
        let lines = ["trace-1.jsonl", "trace-2.jsonl"]
            .map(|name| fs::read_to_string(path(name)).unwrap().lines().count() - 1);
        assert_eq!(lines, counts, "{all:?}: {}", err(&split));
        assert!(err(&split).contains(&format!("from line {line}")), "{}", err(&split));
    }
    // These are no restarts: rows as their frames end, an id that opens twice, a counter that
    // wraps.
    for (all, note) in [
        (
            &[(1, 1), (2, 2), (2, 2), (3, 3)][..],
            "events that repeat an earlier one in every value: 3",
        ),
        (
            &[(1, 1), (2, 2), (3, 2), (4, 3)],
            "messages whose id was opened before: 1 (line 8: message 2, first at line 5)",
        ),
        (
            &[(1, 65_534), (2, 65_535), (3, 0), (4, 1)],
            "messages with a lower id than the one before: 1 (line 8: 0 after 65535)",
        ),
    ] {
        let (_, notes) = noted(&opens(all), "log.csv", &[]);
        assert!(notes.contains(note), "{notes}");
    }
    let frames = "t,open,end\n2,2000000000,2500000000\n1,1000000000,3500000000\n";
    let (events, _) =
        noted(frames, "frames.csv", &["--frame", "t=t,open=open,local.result=end,emit=end"]);
    assert_eq!(events[0]["t"], 1);
}

#[test]
fn screen_has_what_convert_understood() {
    let rows = "at,ev,t,p,deadline,own\n0,open,a,,,1\n1,request,a,west,50,1\n30,result,a,west,,1\n29,emit,a,west,,1\n\
                100,open,b,,,1\n101,request,b,west,50,1\n102,result,b,local,,1\n152,emit,b,local,,1\n";
    let dir = folder("log.csv", rows);
    let file = dir.path().join("log.csv").display().to_string();
    let done = run(&["convert", "--explain", "--unit", "ms", &file], "");
    assert_eq!((done.status.code(), err(&done)), (Some(0), ""));
    for line in [
        "log.csv: 8 rows",
        "1 emit of local, 1 emit of west, 2 open, 2 request of west, 1 result of local, 1 result of west",
        "152 ms from line 2 to line 9; 2 messages, one every 100 ms, the longest gap 100 ms before line 6",
        "not used  own",
        "west      results 29 ms after the request; deadlines 50 ms, 1 of 2 answered; outputs -1 ms after its result",
        "clock     all stamps are multiples of 1 ms",
        "events that came after later ones and were sorted: 1 (line 5: 1 ms before line 4)",
        "messages numbered in their order, because their ids are texts (x keeps them): 2 (first line 2: a is 0)",
        "--write-header -o header.jsonl",
        "--header header.jsonl -o trace.jsonl",
        "fuseline check --observed --tolerance 1ms --lateness 2ms trace.jsonl",
        "lateness 2 ms: outputs that waited for a deadline (1) came 1 ms after it; this is twice the median",
    ] {
        assert!(out(&done).contains(line), "{line}: {}", out(&done));
    }
}

#[test]
fn local_may_have_another_name() {
    let rows = "at,ev,t,p\n0,open,1,\n9,result,1,onboard\n9,emit,1,onboard\n";
    let (events, notes) = noted(rows, "log.csv", &["--local", "onboard"]);
    assert_eq!((&events[1]["p"], &events[2]["p"], &*notes), (&0.into(), &0.into(), ""));
    let unknown = refused(rows, "log.csv", &[]);
    assert!(unknown.contains("if it is local, give --local onboard"), "{unknown}");
    let mistyped = refused(rows, "log.csv", &["--local", "onboard,onbord"]);
    assert!(mistyped.contains("--local: the log has no source \"onbord\""), "{mistyped}");
    let dir = folder("log.csv", rows);
    let file = dir.path().join("log.csv").display().to_string();
    let header = run(&["convert", "--write-header", "--local", "onboard", &file], "\n\n\n");
    assert!(out(&header).contains("\"clouds\":[]"), "{}{}", out(&header), err(&header));
}

#[test]
fn what_stands_for_no_value_is_no_id() {
    let rows = "at,ev,t,p\n0,open,12.0,\n9,result,NaN,0\n9,emit,12.0,0\n";
    let refused = refused(rows, "log.csv", &[]);
    let expected = "log.csv:3: column \"t\": \"NaN\" is not an id; if it stands for no value, say so with --missing=NaN";
    assert!(refused.contains(expected), "{refused}");
    let (events, notes) = noted(rows, "log.csv", &["--missing", "nan", "--skip-bad"]);
    assert_eq!((events.len(), &events[0]["t"]), (2, &12.into()));
    assert!(
        notes.contains("rows skipped, because they cannot be read: 1 (line 3: column \"t\""),
        "{notes}"
    );
}

#[test]
fn units_that_cannot_be_meant_are_noted() {
    let rows = "at,ev,t\n1795629600.1,open,1\n1795629600.2,open,2\n1795629600.3,open,3\n";
    let (_, notes) = noted(rows, "log.csv", &[]);
    for note in [
        "times rounded to a nanosecond: 3 (first line 2: 1795629600.1); read as nanoseconds; is --unit right?",
        "doubtful instants: messages come every 0 ns; is --unit right?",
    ] {
        assert!(notes.contains(note), "{notes}");
    }
    let (_, notes) = noted(rows, "log.csv", &["--unit", "s"]);
    assert_eq!(notes, "");
    let refused = refused("at;ev;t\n1;open;1\n", "log.csv", &[]);
    assert!(
        refused.contains("the row has at;ev;t; give the character between cells with --separator"),
        "{refused}"
    );
}

#[test]
fn one_odd_id_is_noted_with_its_line() {
    let log = "ev,at,t\nopen,0,1\nmiss,5,1\nopen,9,2\nmiss,12,2.5\n";
    let (_, notes) = noted(log, "log.csv", &[]);
    let odd = "lines whose id is not a whole number, although others are: 1 (line 5: 2.5)";
    assert!(notes.contains(odd), "{notes}");
    let (_, notes) = noted("ev,at,t\nopen,0,a\nmiss,5,a\n", "log.csv", &[]);
    assert!(!notes.contains("not a whole number"), "{notes}");
}

#[test]
fn an_instant_of_minus_one_is_noted() {
    let log = "open,miss,t\n0,-1,1\n9,12,2\n";
    let (_, notes) = noted(log, "log.csv", &["--frame", "open=open,miss=miss,t=t"]);
    assert!(notes.contains("1 (line 2); if they stand for no value, say so with --missing=-1"));
}

#[test]
fn attempts_that_no_column_names_are_noted() {
    let log = "ev,at,t,p,due,try\nopen,0,1,,,\nrequest,1,1,west,9,0\nmiss,12,1,,,\n";
    let (_, notes) = noted(log, "log.csv", &[]);
    assert!(notes.contains("1 (line 3: 0); if it is the number of an attempt"), "{notes}");
}

#[test]
fn spaces_around_names_are_no_part_of_them() {
    let log = concat!(
        r#"{"ev":"open ","at":0,"t":1}"#,
        "\n",
        r#"{"ev":"request","at":1,"t":1,"p":" west","deadline":" ","due":50}"#,
        "\n",
    );
    let found = events(log, "log.jsonl", &[]);
    assert_eq!((&found[1]["p"], &found[1]["due"]), (&json!(1), &json!(50)));
    let log = log.replace(",\"due\":50", "");
    let message = refused(&log, "log.jsonl", &[]);
    assert!(message.contains("\"deadline\" is null or empty"), "{message}");
}

#[test]
fn a_source_that_the_header_lacks_is_noted() {
    let log = "ev,at,t,p,deadline\nopen,0,1,,\nrequest,1,1,2,9\nrequest,1,1,3,9\n";
    let (_, notes) = noted(log, "log.csv", &["--unit", "ms"]);
    assert!(notes.contains("that the header does not have: 1 (line 4: p 3)"), "{notes}");
}

#[test]
fn results_before_their_requests_are_noted() {
    let log = "open,t,west.request,west.deadline,west.result\n1000,1,1001,50,40\n";
    let frame = "open=open,t=t,west.request=west.request,west.deadline=west.deadline,\
                 west.result=west.result";
    let (_, notes) = noted(log, "log.csv", &["--unit", "ms", "--frame", frame]);
    assert!(notes.contains("results before their requests: 1 (line 2: by 961 ms)"), "{notes}");
}

/// Excel and PowerShell write it.
#[test]
fn utf_16_is_read() {
    let rows = "at\tev\tt\n1\topen\t7\n2\tmiss\t7\n";
    for (mark, bytes) in
        [([0xff, 0xfe], u16::to_le_bytes as fn(u16) -> [u8; 2]), ([0xfe, 0xff], u16::to_be_bytes)]
    {
        let dir = folder("log.csv", "");
        let text: Vec<u8> = mark.into_iter().chain(rows.encode_utf16().flat_map(bytes)).collect();
        fs::write(dir.path().join("log.csv"), text).unwrap();
        let done = convert(&dir, "log.csv", &["--separator", "tab"]);
        assert_eq!((out(&done).lines().count(), err(&done)), (3, ""));
    }
}

#[test]
fn stamps_in_local_time_are_noted() {
    let second = |at: u64| format!("2026-11-25T{:02}:00:{:02}Z", 18 + at / 3600, at % 60);
    let log = |sent: u64| {
        let (open, sent, done) = (second(0), second(sent), second(2));
        format!("open,t,sent,done\n{open},1,{sent},{done}\n")
    };
    let frame =
        "open=open,t=t,west.request=sent,west.deadline=5s,west.result=done,emit=done,by=west";
    let (_, notes) = noted(&log(3601), "log.csv", &["--frame", frame]);
    let note = "events that lie hours, or half hours, from their message's open: 1 (line 2: \
                request 3601 s after it); is one of them in local time and the other in UTC?";
    assert!(notes.contains(note), "{notes}");
    let (_, notes) = noted(&log(1), "log.csv", &["--frame", frame]);
    assert_eq!(notes, "");
}

#[test]
fn deadlines_of_no_source_are_refused() {
    let rows = "at,ev,t,p\n0,open,1,\n1,request,1,west\n9,result,1,west\n9,emit,1,west\n";
    let message = refused(rows, "log.csv", &["--deadline", "9ns,wset=7ns"]);
    let expected = "--deadline wset=: the log has no source \"wset\"; the header has west, ";
    assert!(message.contains(expected), "{message}");
}

#[test]
fn instants_beyond_a_trace_are_refused() {
    let rows = "at,ev,t\n1795629600,open,1\n1795629600000,open,2\n";
    let message = refused(rows, "log.csv", &["--unit", "s"]);
    assert!(
        message.contains("log.csv:3: column \"at\": \"1795629600000\" is an instant after"),
        "{message}"
    );
}

/// Three things that a newcomer took for the operator's faults.
#[test]
fn explain_says_what_would_mislead() {
    let message = |t: u64| {
        let at = t * 100;
        let (by, sent) = if t == 3 { ("cpu", at + 180) } else { ("gpu", at + 151) };
        let result = at + 150;
        format!(
            "{at},open,{t},,None\n{at},request,{t},gpu,180\n{result},result,{t},gpu,\n{sent},emit,{t},{by},\n"
        )
    };
    let log = "at,ev,t,p,deadline\n".to_owned() + &(0..4).map(message).collect::<String>();
    let dir = folder("log.csv", &log);
    let file = dir.path().join("log.csv").display().to_string();
    let explain = |more: &[&str]| {
        let args = ["convert", "--explain", "--sort", "--unit", "ms", &file];
        let done = run(&[&args[..], more].concat(), "");
        assert_eq!(done.status.code(), Some(0), "{}", err(&done));
        out(&done).to_owned()
    };
    assert!(explain(&[]).contains("say so with --missing=None"), "{}", explain(&[]));
    let screen = explain(&["--missing", "None"]);
    for part in [
        "outputs of a source without a request, a result or a failure: 1 (line 17: cpu); if it is local, say so with \
         --local cpu",
        "--period 100ms also checks that messages come in time, but counts the 180 ms after the \
         last message as a gap",
    ] {
        assert!(screen.contains(part), "{part} is not in\n{screen}");
    }
}
