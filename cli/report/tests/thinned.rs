//! The page of a trace that is too long to be shown whole: it counts all, and what it shows is whole.

use std::collections::BTreeMap;

use fuseline_report::PageWriter;
use fuseline_testkit::{Generator, Run};
use fuseline_traces::{Events, ExpectedDecisions, Reference};
use serde_json::Value;

/// A run's trace, as the rules demand it.
fn answered(run: &Run) -> Vec<u8> {
    let (mut reference, mut decisions) = (Reference::new(&run.header), ExpectedDecisions::new());
    let mut trace = Vec::new();
    run.header.write(&mut trace);
    trace.push(b'\n');
    for input in &run.inputs {
        input.write(&mut trace);
        trace.push(b'\n');
        reference.apply(input, &mut decisions);
        for (decision, _) in decisions.drain(..) {
            decision.write(&mut trace);
            trace.push(b'\n');
        }
    }
    trace
}

/// What a page of a trace has for its script, and whether the trace conforms.
fn data_of(mut page: PageWriter, trace: &[u8]) -> (Value, bool) {
    let mut events = Events::new("trace", trace).unwrap();
    let mut canvas = page.begin(None, "trace", events.header());
    while let Some(event) = events.next_event().unwrap() {
        canvas.event(events.line(), event).unwrap();
    }
    let conforms = canvas.finish().summary().violations == 0;
    let mut html = Vec::new();
    page.write(&mut html).unwrap();
    let html = String::from_utf8(html).unwrap();
    let (_, rest) = html.rsplit_once("type=\"application/json\" id=\"data\">").unwrap();
    (serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap(), conforms)
}

/// A trace on a page, for comparison.
struct ShownTrace {
    /// Each timestamp's events: line and letter.
    stories: BTreeMap<u64, Vec<(u64, char)>>,
    /// The timestamps by their first line.
    order: Vec<u64>,
    /// Each timestamp with its outcome and the fates of its requests.
    ends: BTreeMap<u64, (i64, String)>,
}

/// The sums of a column of differences, of which great ones are texts.
fn sums(column: &Value) -> Vec<u64> {
    let steps = column.as_array().unwrap().iter().map(|step| {
        let text = step.as_str().map_or_else(|| step.to_string(), str::to_owned);
        text.parse::<i128>().unwrap()
    });
    let sum = |sum: &mut i128, step: i128| {
        *sum += step;
        Some(u64::try_from(*sum).unwrap())
    };
    steps.scan(0, sum).collect()
}

impl ShownTrace {
    fn new(shown: &Value) -> Self {
        let (timestamps, places) = (sums(&shown["timestamps"]), sums(&shown["t"]));
        let letters = shown["ev"].as_str().unwrap().chars();
        let lines = match &shown["line"] {
            Value::Null => (2..places.len() as u64 + 2).collect(),
            column => sums(column),
        };
        let (mut stories, mut order) = (BTreeMap::<_, Vec<_>>::new(), Vec::new());
        for ((line, letter), place) in lines.into_iter().zip(letters).zip(places) {
            if letter != '.' {
                let t = timestamps[usize::try_from(place).unwrap()];
                stories.entry(t).or_insert_with(|| {
                    order.push(t);
                    Vec::new()
                });
                stories.get_mut(&t).unwrap().push((line, letter));
            }
        }
        let sources = shown["sources"].as_array().unwrap().len();
        let fates: Vec<char> = shown["fates"].as_str().unwrap().chars().collect();
        let outcomes = shown["outcome"].as_array().unwrap().iter().map(|it| it.as_i64().unwrap());
        let fates = fates.chunks(sources).map(|fates| fates.iter().collect());
        let ends = timestamps.into_iter().zip(outcomes.zip(fates)).collect();
        Self { stories, order, ends }
    }
}

#[test]
fn a_thinned_page_counts_all_and_shows_some_timestamps_whole() {
    let generator = Generator { seed: 2, commit: None, clouds: 15 };
    let (mut thinned_pages, mut missed_pages) = (0, 0);
    for number in 0..80 {
        let trace = answered(&generator.run(number));
        let (full, _) = data_of(PageWriter::default(), &trace);
        let full = &full["traces"][0];
        for most in [64, 512, 4096] {
            let (page, conforms) = data_of(PageWriter::with_most_events(most), &trace);
            let thinned = &page["traces"][0];
            if full["ev"].as_str().unwrap().len() < most {
                assert_eq!(full, thinned);
                continue;
            }
            thinned_pages += 1;
            assert!(conforms);
            for key in ["account", "deadlines", "judged", "lines", "origin", "sources"] {
                assert_eq!(full[key], thinned[key], "{key}");
            }
            let [whole, some] = [full, thinned].map(ShownTrace::new);
            let notes = &thinned["thinned"];
            assert_eq!(notes["events"], whole_events(&trace));
            let every = usize::try_from(notes["every"].as_u64().unwrap()).unwrap();
            let besides = notes["besides"].as_array().unwrap();
            assert!(some.order.len() < whole.order.len() || every == 1);
            for (t, story) in &some.stories {
                // What was refused and dropped before it was opened may be left out.
                assert!(whole.stories[t].ends_with(story));
                let before = &whole.stories[t][..whole.stories[t].len() - story.len()];
                assert!(before.iter().all(|(_, letter)| "ofrxnd".contains(*letter)), "{before:?}");
                assert_eq!(some.ends[t], whole.ends[t]);
            }
            let timestamps = usize::try_from(notes["timestamps"].as_u64().unwrap()).unwrap();
            assert_eq!(some.order.len() - besides.len(), timestamps.div_ceil(every));
            // The tiles count each message that was opened.
            let tiles = notes["tiles"]["counts"].as_array().unwrap().iter();
            let tile = |tile: &Value, at| {
                tile.as_array().unwrap().iter().skip(at).filter_map(Value::as_u64).sum::<u64>()
            };
            let [all, ended, forwarded] =
                [0, 1, 2].map(|at| tiles.clone().map(|it| tile(it, at)).sum::<u64>());
            let account = |word: &str| thinned["account"][word].as_u64().unwrap();
            assert_eq!(forwarded, account("forwarded"));
            assert_eq!(all - ended, account("missed"));
            assert_eq!(ended - forwarded, account("open"));
            if account("missed") > 0 {
                missed_pages += usize::from(some.ends.values().any(|(outcome, _)| *outcome == -1));
            }
        }
    }
    assert!(thinned_pages > 25 && missed_pages > 15, "{thinned_pages} {missed_pages}");
}

/// How many events a trace has.
fn whole_events(trace: &[u8]) -> u64 {
    trace.split(|byte| *byte == b'\n').count() as u64 - 2
}

#[test]
fn a_thinned_page_shows_what_breaks_a_rule() {
    let generator = Generator { seed: 3, commit: None, clouds: 3 };
    let mut found = 0;
    for number in 0..100 {
        let trace = answered(&generator.run(number));
        let text = String::from_utf8(trace).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let middle = lines.len() / 2;
        let Some(cut) = (middle..lines.len()).find(|at| lines[*at].starts_with(r#"{"ev":"emit""#))
        else {
            continue;
        };
        let mut broken = lines;
        broken.remove(cut);
        let broken = broken.join("\n") + "\n";
        let (page, conforms) = data_of(PageWriter::with_most_events(96), broken.as_bytes());
        let shown = &page["traces"][0];
        assert!(!conforms);
        let Value::Object(notes) = &shown["thinned"] else { continue };
        let (full, _) = data_of(PageWriter::default(), broken.as_bytes());
        let full = &full["traces"][0];
        let t_of = |shown: &Value| {
            let place = shown["violations"][0]["t"].as_u64()?;
            sums(&shown["timestamps"]).get(usize::try_from(place).ok()?).copied()
        };
        let expected = t_of(full).unwrap();
        // An eighth of the events is for what breaks a rule.
        if ShownTrace::new(full).stories[&expected].len() > 12 {
            continue;
        }
        found += 1;
        assert_eq!(t_of(shown), Some(expected));
        assert!(notes["violations"].as_u64().unwrap() > 0);
    }
    assert!(found > 8, "{found}");
}
