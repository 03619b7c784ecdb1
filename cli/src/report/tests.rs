//! Tests that the page, the tables of a run and the operator's own counts agree.

use std::time::Duration;

use fuseline_engine::{Engine, EngineConfig, Local, Recorder, Recording, SourceTally, Tally};
use fuseline_report::{PageWriter, RequestRow, TraceStatistics};
use fuseline_testkit::{Generator, Run};
use fuseline_traces::{Events, Input};
use serde_json::Value;

use crate::run::sources_table;

/// Drives an operator through a run's inputs. Returns its tally and the trace that it recorded.
fn operate(run: &Run) -> (Tally, Vec<u8>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("trace.jsonl");
    let local = Local { waiting: Some(usize::MAX), ..Local::default() };
    let mut config = EngineConfig { local, ..EngineConfig::from(&run.header) };
    config.clouds.iter_mut().for_each(|cloud| cloud.calls = 1);
    let mut engine: Engine<(), ()> = Engine::new(config).unwrap();
    engine.record(Recorder::create(&path, &run.header, Recording::default()).unwrap()).unwrap();
    for input in &run.inputs {
        let cloud = |p: u64| u16::try_from(p).ok();
        match *input {
            Input::Open { at, t, deadline } => {
                engine.open(at, t, deadline.map(Duration::from_nanos), (), []);
            }
            Input::Offer { at, t, p, deadline, .. } => {
                if let Some(p) = cloud(p) {
                    engine.offer(at, t, p, Duration::from_nanos(deadline), ());
                }
            }
            Input::Result { at, t, p } => {
                if let Some(p) = cloud(p) {
                    engine.result(at, t, p, ());
                }
            }
            Input::Fail { at, t, p } => {
                if let Some(p) = cloud(p) {
                    engine.fail(at, t, p, &"it failed");
                }
            }
            Input::Tick { at } => engine.tick(at),
        }
        while engine.next_effect().is_some() {}
    }
    engine.finish().unwrap();
    (engine.counts().tally(), std::fs::read(path).unwrap())
}

fn statistics_of(trace: &[u8]) -> TraceStatistics {
    let mut reader = Events::new("trace", trace).unwrap();
    let header = reader.header();
    let clouds = header.clouds.iter().map(|cloud| cloud.p);
    let mut statistics = TraceStatistics::new(clouds, header.commit, false);
    while let Some(event) = reader.next_event().unwrap() {
        statistics.event(&event);
    }
    statistics
}

/// Checks a row against the operator's counts. Sums check the figures that the operator does not
/// count separately.
fn holds(row: &RequestRow, tally: &SourceTally, is_local: bool) {
    let [requests, forwarded, discarded, late, failed, superseded, open, refused] = row.counts;
    assert_eq!(requests, forwarded + discarded + late + failed + superseded + open, "{row:?}");
    assert_eq!(requests, tally.admitted, "{row:?}");
    assert_eq!(forwarded, tally.forwarded(), "{row:?}");
    assert_eq!(failed, tally.failed, "{row:?}");
    assert_eq!(refused, tally.refused.values().sum::<u64>(), "{row:?}");
    // A held result's timer fires too, except for local's, which is disarmed.
    assert!(late == tally.timers || !is_local && late < tally.timers, "{row:?}");
    if !is_local {
        assert_eq!(superseded, tally.cancelled, "{row:?}");
    }
    // The accepted results were held or sent at once, and the rest are pending.
    let at_once = tally.outputs.get(&fuseline_engine::Trigger::Arrival).copied().unwrap_or(0);
    let accepted = tally.held + tally.preliminary + at_once;
    assert!(
        forwarded + discarded <= accepted && accepted <= forwarded + discarded + open,
        "{row:?}"
    );
}

/// Returns the numbers in a row of a table for people.
fn numbers(line: &str) -> Vec<u64> {
    line.split_whitespace().filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn run_and_page_report_what_the_operator_counted() {
    let generator = Generator { seed: 1, commit: None, clouds: 15 };
    // Two of the runs fill the greatest window, and ten are long.
    for number in 0..500 {
        let run = generator.run(number);
        let (tally, trace) = operate(&run);
        let statistics = statistics_of(&trace);
        let totals = statistics.totals();
        assert_eq!(totals.missed, tally.missed);
        assert_eq!(totals.forwarded, tally.forwarded());
        assert_eq!(totals.refused, tally.refused.values().sum::<u64>());
        assert_eq!(totals.messages, tally.messages + totals.refused);
        assert_eq!(totals.rows.len(), tally.sources.len());
        for (i, (row, tally)) in totals.rows.iter().zip(&tally.sources).enumerate() {
            assert_eq!(row.p, u64::from(tally.source.priority));
            holds(row, tally, i == 0);
        }

        let table = sources_table(&totals, |row| format!("source-{}", row.p));
        let shown: Vec<&str> = table.lines().filter(|line| line.contains("source-")).collect();
        assert_eq!(shown.len(), totals.rows.len());
        let page = data(&trace);
        let reported = &page["traces"][0]["account"];
        for (row, line) in totals.rows.iter().zip(shown) {
            let mut counts = row.counts.to_vec();
            if !table.contains(" open ") {
                assert_eq!(counts.remove(6), 0);
            }
            assert_eq!(&numbers(line)[..], &counts[..]);
            let index = page["traces"][0]["sources"].as_array().unwrap();
            let index = index.iter().position(|source| source["p"] == row.p).unwrap();
            let reported = reported["rows"].as_array().unwrap();
            let reported = reported.iter().find(|row| row["place"] == index).unwrap();
            assert_eq!(&reported["counts"], &serde_json::json!(row.counts));
        }
        for (word, count) in [
            ("messages", totals.messages),
            ("forwarded", totals.forwarded),
            ("missed", totals.missed),
            ("refused", totals.refused),
            ("open", totals.open),
        ] {
            assert_eq!(&reported[word], &Value::from(count));
        }
    }
}

/// Returns the data of a trace's page.
fn data(trace: &[u8]) -> Value {
    let mut page = PageWriter::default();
    let mut events = Events::new("trace", trace).unwrap();
    let mut canvas = page.begin(None, "trace", events.header());
    while let Some(event) = events.next_event().unwrap() {
        canvas.event(events.line(), event).unwrap();
    }
    assert!(canvas.finish().broken() == 0);
    let mut html = Vec::new();
    page.write(&mut html).unwrap();
    let html = String::from_utf8(html).unwrap();
    let (_, rest) = html.rsplit_once("type=\"application/json\" id=\"data\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}
