//! Tests the parser: what it refuses, where and why, and that it reads what the writer wrote.

use fuseline_traces::{
    Cloud, Commit, Decision, Defect, DropReason, Event, Events, Header, Input, Line, OfferRefusal,
    OpenRefusal, parse,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

/// A line that is refused, the column, and the error.
type Refused<'a> = (&'a [u8], u64, &'a str);

/// The error for a number.
const NUMBER: &str = "a whole number from 0 to 18446744073709551615, digits alone";

fn refused(cases: &[Refused<'_>]) {
    for (line, column, message) in cases {
        let shown = String::from_utf8_lossy(line);
        let error = parse(line).expect_err(&shown);
        let message = message.replace("NUMBER", NUMBER);
        assert_eq!((error.column, error.message), (*column, message), "{shown}");
    }
}

#[test]
fn what_is_no_object_is_refused() {
    refused(&[
        (b"", 1, "the line is blank; remove it"),
        (b" \t ", 1, "the line is blank; remove it"),
        (b"\r", 1, "the line ends in CR LF; end it in LF alone"),
        (b"{\"ev\":\"tick\",\"at\":1}\r", 21, "the line ends in CR LF; end it in LF alone"),
        (b"\xef\xbb\xbf{}", 1, "the line begins with a byte-order mark; remove it"),
        (b"{\"ev\":\"\xff\"}", 8, "invalid UTF-8; a trace is UTF-8 text"),
        (b"{\"ev\":\"tick\",\"x\":\"\xed\xa0\x80\"}", 19, "invalid UTF-8; a trace is UTF-8 text"),
        (b"\x1b[31m", 1, "expected `{` at the start of a line, found `\\u{1b}`"),
        (b"tick", 1, "expected `{` at the start of a line, found `tick`"),
        (b"[1]", 1, "expected `{` at the start of a line, found `[`"),
        (b"{", 2, "expected a key in quotes, found the line's end"),
        (b"{}", 2, "key \"ev\" is missing; an event has it, a header has \"fuseline\""),
        (b"{ev:1}", 2, "expected a key in quotes, found `ev`"),
        (b"{\"ev\" \"tick\"}", 7, "expected `:` after a key, found `\"tick\"`"),
        (b"{\"at\":1 \"t\":1}", 9, "expected `,` or `}`, found `\"t\"`"),
        (b"{\"at\":1,}", 9, "expected a key in quotes, found `}`"),
        (b"{,\"at\":1}", 2, "expected a key in quotes, found `,`"),
        (b"{\"at\":1,,\"t\":1}", 9, "expected a key in quotes, found `,`"),
        (b"{\"ev\":\"tick\",\"at\":1} {}", 22, "more after the object; a line is one object"),
        (b"{\"ev\":\"tick\",\"at\":1}}", 21, "more after the object; a line is one object"),
        (
            b"{\"e\tv\":1}",
            4,
            "control character (\\u0000-\\u001F) found while parsing a string; \
             a line is one JSON object",
        ),
        (b"{\"ev\":\"tick", 11, "EOF while parsing a string; a line is one JSON object"),
    ]);
}

#[test]
fn what_is_no_whole_number_is_refused() {
    refused(&[
        (b"{\"ev\":\"tick\",\"at\":null}", 19, "expected NUMBER, found `null`"),
        (b"{\"ev\":\"tick\",\"at\":1.0}", 19, "expected NUMBER, found `1.0`"),
        (b"{\"ev\":\"tick\",\"at\":1e3}", 19, "expected NUMBER, found `1e3`"),
        (b"{\"ev\":\"tick\",\"at\":1E3}", 19, "expected NUMBER, found `1E3`"),
        (b"{\"ev\":\"tick\",\"at\":-1}", 19, "expected NUMBER, found `-1`"),
        (b"{\"ev\":\"tick\",\"at\":-0}", 19, "expected NUMBER, found `-0`"),
        (b"{\"ev\":\"tick\",\"at\":+1}", 19, "expected NUMBER, found `+1`"),
        (b"{\"ev\":\"tick\",\"at\":01}", 19, "expected NUMBER, found `01`"),
        (b"{\"ev\":\"tick\",\"at\":00}", 19, "expected NUMBER, found `00`"),
        (b"{\"ev\":\"tick\",\"at\": }", 20, "expected NUMBER, found `}`"),
        (b"{\"ev\":\"tick\",\"at\":\"1\"}", 19, "expected NUMBER, found `\"1\"`"),
        (b"{\"ev\":\"tick\",\"at\":true}", 19, "expected NUMBER, found `true`"),
        (b"{\"ev\":\"tick\",\"at\":[1]}", 19, "expected NUMBER, found `[`"),
        (
            b"{\"ev\":\"tick\",\"at\":18446744073709551616}",
            19,
            "expected NUMBER, found `18446744073709551616`",
        ),
        (
            b"{\"ev\":\"tick\",\"at\":99999999999999999999999999999999}",
            19,
            "expected NUMBER, found `999999999999999999999999…`",
        ),
        (b"{\"ev\":\"tick\",\"at\":1x}", 20, "expected `,` or `}`, found `x`"),
    ]);
}

#[test]
fn keys_that_do_not_fit_the_event_are_refused() {
    let result = "a result line; it takes ev, at, t, p, of, for, x";
    refused(&[
        (
            b"{\"ev\":\"result\",\"at\":1,\"tt\":2,\"p\":0}",
            23,
            &format!("unknown key \"tt\" in {result}"),
        ),
        (
            b"{\"tt\":{},\"ev\":\"result\",\"at\":1,\"t\":2,\"p\":0}",
            2,
            &format!("unknown key \"tt\" in {result}"),
        ),
        (b"{\"evv\":\"result\"}", 2, "unknown key \"evv\""),
        (
            b"{\"ev\":\"result\",\"at\":1,\"t\":2,\"p\":0,\"X\":0}",
            35,
            &format!("unknown key \"X\" in {result}"),
        ),
        (
            b"{\"ev\":\"result\",\"at\":1,\"due\":5,\"t\":2,\"p\":0}",
            23,
            &format!("key \"due\" is not allowed in {result}"),
        ),
        (
            b"{\"ev\":\"request\",\"at\":1,\"t\":2,\"p\":1,\"deadline\":5}",
            36,
            "key \"deadline\" is not allowed in a request line; it takes ev, at, t, p, due, x",
        ),
        (
            b"{\"ev\":\"tick\",\"at\":1,\"t\":2}",
            21,
            "key \"t\" is not allowed in a tick line; it takes ev, at, x",
        ),
        (b"{\"ev\":\"result\",\"at\":1,\"p\":0}", 28, &format!("key \"t\" is missing in {result}")),
        (
            b"{\"ev\":\"open\",\"at\":1}",
            20,
            "key \"t\" is missing in an open line; it takes ev, at, t, deadline, within, \
             age, origin, seq, missing, x",
        ),
        (
            b"{\"ev\":\"refuse\",\"at\":1,\"t\":2,\"p\":1}",
            34,
            "key \"why\" is missing in a refuse line; it takes ev, at, t, p, why, x",
        ),
        (b"{\"at\":1,\"at\":1}", 9, "key \"at\" is given twice; give it once"),
        (b"{\"at\":1,\"\\u0061t\":1}", 9, "key \"at\" is given twice; give it once"),
        (b"{\"x\":1,\"x\":1}", 8, "key \"x\" is given twice; give it once"),
        (b"{\"ev\":\"tick\",\"ev\":\"tick\"}", 14, "key \"ev\" is given twice; give it once"),
    ]);
}

#[test]
fn words_that_are_not_known_are_refused() {
    refused(&[
        (
            b"{\"ev\":\"opne\"}",
            7,
            "unknown ev \"opne\"; it is one of open, offer, result, fail, tick, timer, refuse, \
             request, hold, drop, emit, final, miss, cancel",
        ),
        (b"{\"ev\":5}", 7, "expected a word in quotes, found `5`"),
        (b"{\"ev\":null}", 7, "expected a word in quotes, found `null`"),
        (
            b"{\"ev\":\"drop\",\"at\":1,\"t\":2,\"p\":0,\"why\":\"queue\"}",
            33,
            "unknown why \"queue\" in a drop line; it is one of unknown, superseded, \
             unsolicited, duplicate, late",
        ),
        (
            b"{\"ev\":\"refuse\",\"at\":1,\"t\":2,\"why\":\"late\"}",
            29,
            "unknown why \"late\" in a refuse line without p, of an open; it is one of order, full, \
             deadline",
        ),
        (
            b"{\"ev\":\"refuse\",\"at\":1,\"t\":2,\"p\":1,\"why\":\"full\"}",
            35,
            "unknown why \"full\" in a refuse line with p, of an offer; it is one of unknown, closed, \
             duplicate, outranked, deadline, queue",
        ),
        (
            b"{\"ev\":\"a\\u0000very long word that nobody wants to see\"}",
            7,
            "unknown ev \"a\\0very long word that no…\"; it is one of open, offer, result, fail, \
             tick, timer, refuse, request, hold, drop, emit, final, miss, cancel",
        ),
    ]);
}

#[test]
fn headers_beyond_their_limits_are_refused() {
    let takes = "a cloud's entry; it takes p, name, limit, resume, max_age, x";
    let sixteen: Vec<_> = (1..=16).map(|p| format!("{{\"p\":{p},\"limit\":1}}")).collect();
    let sixteen = format!("{{\"fuseline\":1,\"window\":1,\"clouds\":[{}]}}", sixteen.join(","));
    let last = sixteen.rfind("{\"p\":16").expect("it is there") as u64 + 1;
    refused(&[
        (b"{\"fuseline\":2}", 13, "fuseline, the format's version, is 2; this version reads 1"),
        (b"{\"fuseline\":1.0}", 13, "expected NUMBER, found `1.0`"),
        (b"{\"fuseline\":1,\"window\":0}", 24, "window is 0; it must be from 1 to 1024"),
        (b"{\"fuseline\":1,\"window\":1025}", 24, "window is 1025; it must be from 1 to 1024"),
        (
            b"{\"fuseline\":1,\"window\":1}",
            25,
            "key \"clouds\" is missing in a header line; it takes fuseline, operator, window, \
             commit, clouds, x",
        ),
        (
            b"{\"fuseline\":1,\"window\":1,\"clouds\":[],\"ev\":\"tick\"}",
            38,
            "key \"ev\" is not allowed in a header line; it takes fuseline, operator, window, \
             commit, clouds, x",
        ),
        (b"{\"commit\":\"lazy\"}", 11, "unknown commit \"lazy\"; it is one of eager or patient"),
        (b"{\"commit\":null}", 11, "expected a word in quotes, found `null`"),
        (b"{\"operator\":null}", 13, "expected a name in quotes, found `null`"),
        (
            b"{\"operator\":\"\\ud800\"}",
            20,
            "unexpected end of hex escape; a line is one JSON object",
        ),
        (b"{\"clouds\":{}}", 11, "expected `[` at the start of clouds, found `{`"),
        (b"{\"clouds\":[1]}", 12, "expected `{` at the start of a cloud's entry, found `1`"),
        (b"{\"clouds\":[{\"p\":0}]}", 17, "p of a cloud is 0; it must be from 1 to 65535"),
        (b"{\"clouds\":[{\"p\":65536}]}", 17, "p of a cloud is 65536; it must be from 1 to 65535"),
        (b"{\"clouds\":[{\"limit\":0}]}", 21, "limit of a cloud is 0; it must be at least 1"),
        (b"{\"clouds\":[{\"p\":1}]}", 12, &format!("key \"limit\" is missing in {takes}")),
        (b"{\"clouds\":[{\"limit\":1}]}", 12, &format!("key \"p\" is missing in {takes}")),
        (b"{\"clouds\":[{\"q\":1}]}", 13, &format!("unknown key \"q\" in {takes}")),
        (b"{\"clouds\":[{\"p\":1,\"p\":1}]}", 19, "key \"p\" is given twice; give it once"),
        (b"{\"clouds\":[{\"name\":7}]}", 20, "expected a name in quotes, found `7`"),
        (b"{\"clouds\":[{\"resume\":null}]}", 22, "expected NUMBER, found `null`"),
        (
            b"{\"clouds\":[{\"p\":1,\"limit\":5,\"resume\":5}]}",
            12,
            "resume 5 is not below limit 5; give a lower resume",
        ),
        (
            b"{\"clouds\":[{\"p\":7,\"limit\":5},{\"p\":7,\"limit\":9}]}",
            30,
            "a second cloud with p 7; give each its own",
        ),
        (sixteen.as_bytes(), last, "the header lists a sixteenth cloud; it may list up to 15"),
        (
            b"{\"clouds\":[{\"p\":1,\"limit\":1},]}",
            30,
            "expected `{` at the start of a cloud's entry, found `]`",
        ),
    ]);
}

#[test]
fn x_may_be_anything_but_broken() {
    let deep = format!("{}{}", "[".repeat(30_000), "]".repeat(30_000));
    let twice = "{\"a\":1,\"a\":null}";
    for x in ["null", "-1.5e-300", "1e999", twice, "\"\\ud800\"", "\"\\\\\\\"\"", "{}", "[]", &deep]
    {
        let line = format!("{{\"x\":{x},\"ev\":\"tick\",\"at\":1}}");
        assert_eq!(parse(line.as_bytes()), Ok(event(Input::Tick { at: 1 })), "{line:.60}");
    }
    for x in ["", "nul", "[1,]", "{1:2}", "\"\\x\"", "[[", "1.", "'a'", "NaN"] {
        let line = format!("{{\"x\":{x},\"ev\":\"tick\",\"at\":1}}");
        assert!(parse(line.as_bytes()).is_err(), "{line}");
    }
}

#[test]
fn defaults_are_those_of_the_format() {
    let line = b"{\"fuseline\":1,\"window\":1024,\"clouds\":[{\"p\":65535,\"limit\":7}]}";
    let cloud = Cloud { p: 65535, name: None, limit: 7, resume: 6 };
    let header =
        Header { operator: None, window: 1024, commit: Commit::Eager, clouds: vec![cloud] };
    assert_eq!(parse(line), Ok(Line::Header(header)));
}

#[test]
fn writes_keys_in_one_order_without_white_space() {
    let cloud = |p, name: &str, resume| Cloud { p, name: Some(name.into()), limit: 31, resume };
    let header = Header {
        operator: Some("detector".into()),
        window: 16,
        commit: Commit::Eager,
        clouds: vec![cloud(1, "west/detr-r101", 0), cloud(2, "east/swin-l", 30)],
    };
    assert_eq!(
        header.to_string(),
        "{\"fuseline\":1,\"operator\":\"detector\",\"window\":16,\"commit\":\"eager\",\"clouds\":[\
         {\"p\":1,\"name\":\"west/detr-r101\",\"limit\":31,\"resume\":0},\
         {\"p\":2,\"name\":\"east/swin-l\",\"limit\":31}]}"
    );
    let offer = Input::Offer { at: 1, t: 2, p: 3, deadline: 4, backlog: 5 };
    assert_eq!(
        offer.to_string(),
        "{\"ev\":\"offer\",\"at\":1,\"t\":2,\"p\":3,\"deadline\":4,\"backlog\":5}"
    );
    let refuse = Decision::RefuseOpen { at: 1, t: 2, why: OpenRefusal::Full };
    assert_eq!(refuse.to_string(), "{\"ev\":\"refuse\",\"at\":1,\"t\":2,\"why\":\"full\"}");
}

/// Reads each kind of line, with numbers up to and beyond what one pass reads, and with each change
/// of one byte.
#[test]
fn changed_lines_say_in_one_pass_what_the_parser_says() {
    const NUMBERS: [u64; 6] = [0, 7, 98_765_432, 123_456_789, 9_999_999_999_999_999_999, u64::MAX];
    let lines = [
        r#"{"ev":"open","at":A,"t":B}"#,
        r#"{"ev":"open","at":A,"t":B,"deadline":C}"#,
        r#"{"ev":"offer","at":A,"t":B,"p":C,"deadline":A,"backlog":B}"#,
        r#"{"ev":"result","at":A,"t":B,"p":C}"#,
        r#"{"ev":"result","at":A,"t":B,"p":C,"of":A}"#,
        r#"{"ev":"fail","at":A,"t":B,"p":C}"#,
        r#"{"ev":"tick","at":A}"#,
        r#"{"ev":"timer","at":A,"t":B,"p":C}"#,
        r#"{"ev":"refuse","at":A,"t":B,"why":"full"}"#,
        r#"{"ev":"refuse","at":A,"t":B,"p":C,"why":"queue"}"#,
        r#"{"ev":"request","at":A,"t":B,"p":C,"due":A}"#,
        r#"{"ev":"hold","at":A,"t":B,"p":C}"#,
        r#"{"ev":"drop","at":A,"t":B,"p":C,"why":"late"}"#,
        r#"{"ev":"emit","at":A,"t":B,"p":C}"#,
        r#"{"ev":"emit","at":A,"t":B,"p":C,"of":A}"#,
        r#"{"ev":"final","at":A,"t":B,"p":C}"#,
        r#"{"ev":"miss","at":A,"t":B}"#,
        r#"{"ev":"cancel","at":A,"t":B,"p":C}"#,
    ];
    let written = b"{}[]\\\",: \t019.-+eEnulxaoprtfd";
    for (line, place) in lines.iter().zip(0..) {
        let number = |shift: usize| NUMBERS[(place + shift) % NUMBERS.len()].to_string();
        let line = [("A", 0), ("B", 1), ("C", 2)]
            .iter()
            .fold((*line).to_string(), |line, (name, shift)| line.replace(name, &number(*shift)));
        let bytes = line.as_bytes();
        agrees_after(&line, bytes);
        for at in 1..=bytes.len() {
            let (before, after) = bytes.split_at(at);
            for byte in written {
                agrees_after(&line, &[before, &[*byte], after].concat());
                agrees_after(
                    &line,
                    &[before, &[*byte], after.get(1..).unwrap_or_default()].concat(),
                );
            }
            agrees_after(&line, &[before, after.get(1..).unwrap_or_default()].concat());
        }
    }
}

/// Compares the reading of a line with that of the same line with a blank in it, one column later.
fn agrees(bytes: &[u8]) {
    let spaced = [b"{ ", bytes.strip_prefix(b"{").expect("an object")].concat();
    let spaced = parse(&spaced).map_err(|error| (error.column - 1, error.message));
    let said = parse(bytes).map_err(|error| (error.column, error.message));
    assert_eq!(said, spaced, "{}", bytes.escape_ascii());
}

/// Does the same after another event of the trace.
fn agrees_after(before: &str, bytes: &[u8]) {
    agrees(bytes);
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}";
    let trace = [header.as_bytes(), before.as_bytes(), bytes, b""].join(&b'\n');
    let mut events = Events::new("trace", &trace[..]).expect("a header");
    assert!(events.next_event().is_ok_and(|event| event.is_some()));
    let read = events.next_event().map_err(|error| match error.defect {
        Defect::Line(why) => (error.column, why.message),
        defect => panic!("{defect}"),
    });
    let read = read.map(|event| event.map(Line::Event));
    let said = parse(bytes).map(Some).map_err(|error| (error.column, error.message));
    assert_eq!(read, said, "{}", bytes.escape_ascii());
}

proptest! {
    #[test]
    fn what_is_written_is_read_back(line in lines()) {
        prop_assert_eq!(parse(line.to_string().as_bytes()), Ok(line));
    }

    #[test]
    fn accepts_white_space_and_any_order_of_keys(line in lines()) {
        let json: serde_json::Value = serde_json::from_str(&line.to_string()).unwrap();
        let spaced = serde_json::to_string_pretty(&json).unwrap().replace('\n', " \t");
        prop_assert_eq!(parse(spaced.as_bytes()), Ok(line));
    }

    /// A cut or changed line is accepted only if `serde_json` reads the same JSON.
    #[test]
    fn damaged_lines_are_taken_only_where_they_are_json(
        line in lines(),
        at in any::<prop::sample::Index>(),
        byte in select(&b"{}[]\",:\\ \t019.-+eEnulx"[..]),
        remove in any::<bool>(),
    ) {
        let mut bytes = line.to_string().into_bytes();
        let at = at.index(bytes.len());
        if remove { bytes.remove(at); } else { bytes[at] = byte; }
        if let Ok(line) = parse(&bytes) {
            let json: serde_json::Value = serde_json::from_slice(&bytes).expect("it is JSON");
            for (key, value) in json.as_object().expect("it is an object") {
                let written: serde_json::Value = serde_json::from_str(&line.to_string()).unwrap();
                prop_assert!(key == "x" || key == "clouds" || written.get(key) == Some(value));
            }
        }
    }

    /// A line with a blank in it is not read in one pass.
    #[test]
    fn lines_read_in_one_pass_say_what_the_parser_says(line in lines()) {
        agrees(line.to_string().as_bytes());
    }

    #[test]
    fn any_bytes_are_answered(bytes in vec(any::<u8>(), 0..80)) {
        let _ = parse(&bytes);
    }
}

fn lines() -> impl Strategy<Value = Line> {
    prop_oneof![
        1 => headers().prop_map(Line::Header),
        4 => inputs().prop_map(event),
        6 => decisions().prop_map(|decision| Line::Event(Event::Decision(decision))),
    ]
}

fn headers() -> impl Strategy<Value = Header> {
    let name = || option::of(any::<String>());
    let cloud = (name(), 1..=u64::MAX, any::<u64>());
    let clouds = prop::collection::btree_map(1..=u16::MAX, cloud, 0..=15).prop_map(|clouds| {
        let cloud = |(p, (name, limit, resume))| Cloud { p, name, limit, resume: resume % limit };
        clouds.into_iter().map(cloud).collect::<Vec<_>>()
    });
    let commit = select(&Commit::ALL[..]);
    (name(), 1..=1024_u16, commit, clouds.prop_shuffle())
        .prop_map(|(operator, window, commit, clouds)| Header { operator, window, commit, clouds })
}

/// Generates numbers of each length.
fn number() -> impl Strategy<Value = u64> {
    (any::<u64>(), 0..64_u32).prop_map(|(number, shift)| number >> shift)
}

fn inputs() -> impl Strategy<Value = Input> {
    let n = number;
    prop_oneof![
        (n(), n(), option::of(n())).prop_map(|(at, t, deadline)| Input::Open { at, t, deadline }),
        (n(), n(), n(), n(), n()).prop_map(|(at, t, p, deadline, backlog)| Input::Offer {
            at,
            t,
            p,
            deadline,
            backlog
        }),
        (n(), n(), n()).prop_map(|(at, t, p)| Input::Result { at, t, p }),
        (n(), n(), n()).prop_map(|(at, t, p)| Input::Fail { at, t, p }),
        n().prop_map(|at| Input::Tick { at }),
    ]
}

fn decisions() -> impl Strategy<Value = Decision> {
    let n = number;
    let (open, offer) = (select(&OpenRefusal::ALL[..]), select(&OfferRefusal::ALL[..]));
    let drop = select(&DropReason::ALL[..]);
    prop_oneof![
        (n(), n(), n()).prop_map(|(at, t, p)| Decision::Timer { at, t, p }),
        (n(), n(), open).prop_map(|(at, t, why)| Decision::RefuseOpen { at, t, why }),
        (n(), n(), n(), offer).prop_map(|(at, t, p, why)| Decision::RefuseOffer { at, t, p, why }),
        (n(), n(), n(), n()).prop_map(|(at, t, p, due)| Decision::Request { at, t, p, due }),
        (n(), n(), n()).prop_map(|(at, t, p)| Decision::Hold { at, t, p }),
        (n(), n(), n(), drop).prop_map(|(at, t, p, why)| Decision::Drop { at, t, p, why }),
        (n(), n(), n()).prop_map(|(at, t, p)| Decision::Emit { at, t, p }),
        (n(), n(), n()).prop_map(|(at, t, p)| Decision::Final { at, t, p }),
        (n(), n()).prop_map(|(at, t)| Decision::Miss { at, t }),
        (n(), n(), n()).prop_map(|(at, t, p)| Decision::Cancel { at, t, p }),
    ]
}

const fn event(input: Input) -> Line {
    Line::Event(Event::Input(input))
}
