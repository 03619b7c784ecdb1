//! The columns of a page, read back beside the trace that they are of.

#[path = "../../tests/common/drawn.rs"]
mod drawn;
#[path = "../../tests/common/recount.rs"]
#[expect(dead_code, reason = "what is exported of calls is of no page")]
mod recount;

use std::cmp::Reverse;
use std::collections::BTreeMap;

use drawn::DrawnTrace;
use fuseline_report::PageWriter;
use fuseline_traces::{Annotations, Decision, Event, Events, Input, Origin};
use serde_json::{Value, json};

const TRACES: u64 = 60;

/// Returns what a page has of a trace for its script.
fn data_of(text: &str, most: usize) -> Value {
    let mut events = Events::observed("trace", text.as_bytes()).unwrap();
    let mut page = PageWriter::with_most_events(most);
    let mut canvas = page.begin(None, "trace", events.header());
    while let Some(event) = events.next_event().unwrap() {
        canvas.annotated_event(events.line(), event, events.annotations()).unwrap();
    }
    let _ = canvas.finish();
    let mut html = Vec::new();
    page.write(&mut html).unwrap();
    let html = String::from_utf8(html).unwrap();
    let (_, rest) = html.rsplit_once("type=\"application/json\" id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// A number, which is a text where a script could not hold it.
fn exact(value: &Value) -> i128 {
    let text = value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned);
    text.parse().unwrap()
}

fn exacts(column: &Value) -> Vec<i128> {
    column.as_array().unwrap().iter().map(exact).collect()
}

fn sums(column: &Value) -> Vec<i128> {
    let sum = |sum: &mut i128, step: i128| {
        *sum += step;
        Some(*sum)
    };
    exacts(column).into_iter().scan(0, sum).collect()
}

fn instant(event: &Event) -> u64 {
    match event {
        Event::Input(input) => input.at(),
        Event::Decision(decision) => decision.at(),
    }
}

/// An event's letter, its source, and what it has more.
fn parts(event: &Event) -> (char, Option<u64>, Vec<Value>) {
    match *event {
        Event::Input(input) => match input {
            Input::Open { deadline, .. } => {
                ('o', None, vec![deadline.map_or(json!(-1), |it| json!(it))])
            }
            Input::Offer { p, deadline, backlog, .. } => {
                ('f', Some(p), vec![json!(deadline), json!(backlog)])
            }
            Input::Result { p, .. } => ('r', Some(p), vec![]),
            Input::Fail { p, .. } => ('x', Some(p), vec![]),
            Input::Tick { .. } => ('.', None, vec![]),
        },
        Event::Decision(decision) => match decision {
            Decision::Timer { p, .. } => ('t', Some(p), vec![]),
            Decision::RefuseOpen { why, .. } => ('n', None, vec![json!(why.as_str())]),
            Decision::RefuseOffer { p, why, .. } => ('n', Some(p), vec![json!(why.as_str())]),
            Decision::Request { at, p, due, .. } => ('q', Some(p), vec![json!(due - at)]),
            Decision::Hold { p, .. } => ('h', Some(p), vec![]),
            Decision::Drop { p, why, .. } => ('d', Some(p), vec![json!(why.as_str())]),
            Decision::Emit { p, .. } => ('e', Some(p), vec![]),
            Decision::Final { p, .. } => ('z', Some(p), vec![]),
            Decision::Miss { .. } => ('m', None, vec![]),
            Decision::Cancel { p, .. } => ('c', Some(p), vec![]),
        },
    }
}

/// D11.
#[test]
fn each_event_is_read_back_with_all_that_it_says() {
    for number in 0..TRACES {
        let trace = DrawnTrace::draw(number);
        let page = data_of(&trace.text(), 1 << 20);
        let shown = &page["traces"][0];
        let sources = shown["sources"].as_array().unwrap();
        for source in sources {
            let p = u64::try_from(exact(&source["p"])).unwrap();
            let is_registered = trace.header.clouds.iter().any(|cloud| u64::from(cloud.p) == p);
            assert_eq!(source["known"], p == 0 || is_registered);
            if let Some(name) = source["name"].as_str() {
                assert_eq!(name, trace.name(p, ""));
            }
        }
        let (timestamps, places) = (sums(&shown["timestamps"]), sums(&shown["t"]));
        let (instants, origin) = (sums(&shown["at"]), exact(&shown["origin"]));
        let mut more = shown["x"].as_array().unwrap().iter();
        // All lines are there, so that none needs its number.
        assert!(shown["line"].is_null());
        let letters = shown["ev"].as_str().unwrap();
        assert_eq!(letters.len(), trace.events.len());
        for (index, (letter, (event, _))) in letters.chars().zip(&trace.events).enumerate() {
            let (own, p, extra) = parts(event);
            assert_eq!((letter, instants[index] + origin), (own, instant(event).into()));
            if let Some(t) = event.t() {
                let place = usize::try_from(places[index]).unwrap();
                assert_eq!(timestamps[place], t.into(), "{event:?}");
            }
            let source = shown["p"][index].as_u64().unwrap().checked_sub(1);
            let source = source.map(|place| &sources[usize::try_from(place).unwrap()]["p"]);
            assert_eq!(source.map(exact), p.map(i128::from), "{event:?}");
            let words = &page[if own == 'd' { "drops" } else { "refusals" }];
            for extra in extra {
                let more = more.next().unwrap();
                if extra.is_string() {
                    let place = usize::try_from(exact(more)).unwrap();
                    assert_eq!(words[place]["word"], extra, "{event:?}");
                } else {
                    assert_eq!(exact(more), exact(&extra), "{event:?}");
                }
            }
        }
        assert_eq!(more.next(), None);
        lineages(&trace, shown, &timestamps);
        deadlines(&trace, shown);
    }
}

/// The lineage of a message is shown at the first open of each timestamp.
fn lineages(trace: &DrawnTrace, shown: &Value, timestamps: &[i128]) {
    let mut expected = BTreeMap::new();
    for (event, annotations) in &trace.events {
        let Event::Input(Input::Open { t, .. }) = event else { continue };
        let Annotations { age, origin, missing, .. } = annotations;
        if age.is_some() || origin.is_some() || !missing.is_empty() {
            let (stream, seq) = match origin {
                Some(Origin { stream, seq }) => (Some(stream.to_string()), *seq),
                None => (None, None),
            };
            let missing: Vec<String> = missing.iter().map(ToString::to_string).collect();
            expected.entry(i128::from(*t)).or_insert((age.map(i128::from), stream, seq, missing));
        }
    }
    let rows = shown["lineages"].as_array().map_or(&[][..], Vec::as_slice);
    let read = rows.iter().map(|row| {
        let place = usize::try_from(exact(&row["t"])).unwrap();
        let missing = row["missing"].as_array().into_iter().flatten();
        let missing = missing.map(|input| input.as_str().unwrap().to_owned()).collect();
        let age = Some(&row["age"]).filter(|age| !age.is_null()).map(exact);
        let origin = row["origin"].as_str().map(ToOwned::to_owned);
        (timestamps[place], (age, origin, row["seq"].as_u64(), missing))
    });
    assert_eq!(read.collect::<BTreeMap<_, _>>(), expected);
    assert_eq!(rows.len(), expected.len());
}

/// Compares the due instants of requests, counted from their messages, and each source's least,
/// median and greatest deadline.
fn deadlines(trace: &DrawnTrace, shown: &Value) {
    let (messages, _) = trace.recount(|_, _| false);
    let (mut counts, mut of) = (BTreeMap::<u64, u64>::new(), BTreeMap::<u64, Vec<u64>>::new());
    for (event, _) in &trace.events {
        let Event::Decision(Decision::Request { at, t, p, due }) = *event else { continue };
        let own = messages.iter().rfind(|message| message.t == t && message.opened <= at).unwrap();
        // To three digits.
        let digits = (due - own.opened).to_string().len();
        let unit = 10_u64.pow(u32::try_from(digits.saturating_sub(3)).unwrap());
        *counts.entry((due - own.opened).saturating_add(unit / 2) / unit * unit).or_default() += 1;
        of.entry(p).or_default().push(due - at);
    }
    let mut commonest: Vec<(u64, u64)> = counts.into_iter().collect();
    commonest.sort_by_key(|(deadline, count)| (Reverse(*count), *deadline));
    let commonest: Vec<i128> = commonest.iter().take(3).map(|(it, _)| i128::from(*it)).collect();
    assert_eq!(exacts(&shown["deadlines"]), commonest);
    for row in shown["account"]["rows"].as_array().unwrap() {
        let source = &shown["sources"][usize::try_from(exact(&row["place"])).unwrap()];
        let own = of.get_mut(&u64::try_from(exact(&source["p"])).unwrap());
        let expected = own.map(|own| {
            own.sort_unstable();
            let median = own.len().div_ceil(2) - 1;
            [own[0], own[median], own[own.len() - 1]].map(i128::from).to_vec()
        });
        let spread = Some(&row["deadlines"]).filter(|it| !it.is_null()).map(exacts);
        assert_eq!(spread, expected);
    }
}

/// D11: a page that cannot hold a trace is the page of its first events, with the verdict on all.
#[test]
fn a_capped_page_is_that_of_the_first_events() {
    let mut capped = 0;
    for number in 0..TRACES {
        let trace = DrawnTrace::draw(number);
        let (shown, whole) = (data_of(&trace.text(), 32), data_of(&trace.text(), usize::MAX));
        let [shown, whole] = [&shown, &whole].map(|page| &page["traces"][0]);
        assert!(whole["capped"].is_null());
        if trace.events.len() <= 32 {
            assert_eq!(shown, whole);
            continue;
        }
        capped += 1;
        let text = trace.text();
        let first: String = text.split_inclusive('\n').take(33).collect();
        let first = data_of(&first, usize::MAX);
        let about_all = ["conforms", "judged", "doubts", "cause", "lines", "violations", "places"];
        for (key, value) in shown.as_object().unwrap() {
            let violations = whole["violations"].as_array().unwrap();
            let rules = |page: &Value| {
                let rows = page["violations"].as_array().unwrap().iter();
                rows.map(|row| (row["line"].clone(), row["rule"].clone())).collect::<Vec<_>>()
            };
            match key.as_str() {
                "violations" => assert_eq!(rules(shown), rules(whole)),
                "places" => assert_eq!(value["line"], whole[key]["line"]),
                "capped" => {
                    let more = whole["places"]["line"].as_array().unwrap().len();
                    let (events, violations) = (trace.events.len(), violations.len() + more);
                    assert_eq!(*value, json!({ "events": events, "violations": violations }));
                }
                key if about_all.contains(&key) => assert_eq!(*value, whole[key], "{key}"),
                key => assert_eq!(*value, first["traces"][0][key], "{key}"),
            }
        }
    }
    assert!(capped > 10, "{capped}");
}

/// D2, D18: which values a source may send is for the header and the values to say.
#[test]
fn a_page_is_judged_with_the_further_keys_of_its_header() {
    let header = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9,"max_age":2}]}"#;
    let events = [
        r#"{"ev":"open","at":0,"t":5}"#,
        r#"{"ev":"offer","at":0,"t":5,"p":1,"deadline":40,"backlog":0}"#,
        r#"{"ev":"request","at":0,"t":5,"p":1,"due":40}"#,
        r#"{"ev":"result","at":9,"t":5,"p":1,"of":3}"#,
        r#"{"ev":"emit","at":9,"t":5,"p":1,"of":3}"#,
    ];
    let text = events.iter().fold(header.to_owned() + "\n", |text, line| text + line + "\n");
    for (with, meant, violations) in
        [(true, "", 0), (false, "", 1), (true, ",\"for\":5", 0), (true, ",\"for\":6", 1)]
    {
        let text = text.replace("\"of\":3", &format!("\"of\":3{meant}"));
        let mut events = Events::new("trace", text.as_bytes()).unwrap();
        let mut page = PageWriter::default();
        let mut canvas = page.begin(None, "trace", events.header());
        if with {
            canvas = canvas.with_header_annotations(events.header_annotations());
        }
        while let Some(event) = events.next_event().unwrap() {
            canvas.annotated_event(events.line(), event, events.annotations()).unwrap();
        }
        assert_eq!(canvas.finish().broken(), violations);
    }
}
