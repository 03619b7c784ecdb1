//! The spans of an operator on tokio, exported as `tracing-opentelemetry` does it, come back as its
//! trace.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{err, out, run};
use fuseline_tokio::{
    Call, Config, Error, Lineage, Local, Operator, Recording, Setup, Trace, spawn, stream,
};
use serde_json::{Map, Value, json};
use tempfile::tempdir;
use tokio::time::{Instant, sleep};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

const MS: Duration = Duration::from_millis(1);

/// Spans as OTLP JSON, by the runtime's clock.
#[derive(Clone)]
struct SpanExporter {
    start: Instant,
    under_way: Arc<Mutex<BTreeMap<u64, Map<String, Value>>>>,
    ended: Arc<Mutex<Vec<Value>>>,
}

/// Adds a span's fields to what is exported of it.
struct FieldWriter<'a>(&'a mut Map<String, Value>);

impl FieldWriter<'_> {
    fn attribute(&mut self, field: &Field, value: &Value) {
        let attributes = self.0.entry("attributes").or_insert_with(|| json!([]));
        let attribute = json!({"key": field.name(), "value": value});
        attributes.as_array_mut().unwrap().push(attribute);
    }
}

impl Visit for FieldWriter<'_> {
    fn record_i64(&mut self, field: &Field, value: i64) {
        self.attribute(field, &json!({"intValue": value.to_string()}));
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "otel.kind" => {
                let kind = if value == "client" { 3 } else { 1 };
                self.0.insert("kind".into(), json!(kind));
            }
            "otel.status_code" => {
                let code = if value == "ERROR" { 2 } else { 1 };
                self.0.insert("status".into(), json!({"code": code}));
            }
            _ => self.attribute(field, &json!({"stringValue": value})),
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.attribute(field, &json!({"stringValue": format!("{value:?}")}));
    }
}

impl SpanExporter {
    fn new() -> Self {
        let (under_way, ended) = (Arc::default(), Arc::default());
        Self { start: Instant::now(), under_way, ended }
    }

    fn now(&self) -> Value {
        json!(self.start.elapsed().as_nanos().to_string())
    }

    fn write(&self, path: &Path) {
        let spans = self.ended.lock().unwrap().clone();
        let export = json!({"resourceSpans": [{"scopeSpans": [{"spans": spans}]}]});
        fs::write(path, export.to_string()).unwrap();
    }
}

impl<S: tracing::Subscriber + for<'a> LookupSpan<'a>> Layer<S> for SpanExporter {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let current = || context.current_span().id().cloned();
        let contextual = attributes.is_contextual().then(current).flatten();
        let parent = attributes.parent().cloned().or(contextual);
        let parent = parent.map(|parent| parent.into_u64().to_string()).unwrap_or_default();
        let span = json!({
            "spanId": id.into_u64().to_string(), "parentSpanId": parent,
            "name": attributes.metadata().name(), "startTimeUnixNano": self.now(),
        });
        let mut span = span.as_object().unwrap().clone();
        attributes.record(&mut FieldWriter(&mut span));
        self.under_way.lock().unwrap().insert(id.into_u64(), span);
    }

    fn on_record(&self, id: &Id, values: &Record<'_>, _: Context<'_, S>) {
        let mut under_way = self.under_way.lock().unwrap();
        values.record(&mut FieldWriter(under_way.get_mut(&id.into_u64()).unwrap()));
    }

    fn on_close(&self, id: Id, _: Context<'_, S>) {
        let mut span = self.under_way.lock().unwrap().remove(&id.into_u64()).unwrap();
        span.insert("endTimeUnixNano".into(), self.now());
        self.ended.lock().unwrap().push(span.into());
    }
}

/// Two clouds and local, which do as the message says: after how long they answer, and whether they
/// fail.
struct Planned;

impl Operator for Planned {
    type Input = [(u32, bool); 3];
    type Output = usize;

    fn setup(self, setup: &mut Setup<Self::Input, usize>) -> Local<Self::Input, usize> {
        for (priority, index) in [(1, 1), (7, 2)] {
            let handle = move |(after, fails): (u32, bool), _: Call| act(index, after, fails);
            let message_handler = move |message: &Self::Input, _| Some((message[index], 50 * MS));
            setup.use_cloud(handle, message_handler, Ok, priority);
        }
        Local::futures(4, |message: Arc<Self::Input>, _| act(0, message[0].0, message[0].1))
    }
}

async fn act(index: usize, after: u32, fails: bool) -> Result<usize, Error> {
    sleep(after * MS).await;
    if fails { Err("as planned".into()) } else { Ok(index) }
}

/// Plays them, 100 ms apart, with a trace and spans in this folder; stops after this long if it is
/// to.
fn play(folder: &Path, messages: &[[(u32, bool); 3]], stops_after: Option<Duration>) {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    let runtime = builder.enable_time().start_paused(true).build().unwrap();
    let exporter = {
        let _entered = runtime.enter();
        SpanExporter::new()
    };
    let subscriber = tracing_subscriber::registry().with(exporter.clone());
    // Spans of what is under way end with the runtime.
    tracing::subscriber::with_default(subscriber, || {
        runtime.block_on(act_out(folder, messages, stops_after));
        drop(runtime);
    });
    exporter.write(&folder.join("spans.json"));
}

async fn act_out(folder: &Path, messages: &[[(u32, bool); 3]], stops_after: Option<Duration>) {
    let path = folder.join("trace.jsonl");
    let trace = Some(Trace { path, recording: Recording::default() });
    let config = Config { name: "planned".into(), trace, ..Config::default() };
    let (mut writer, input) = stream(8);
    let (running, _items) = spawn(Planned, config, input).unwrap();
    for (seq, message) in (0..).zip(messages) {
        let lineage = Lineage::new("camera", seq, Instant::now()).within(300 * MS);
        writer.write_with(*message, lineage).unwrap();
        sleep(stops_after.unwrap_or(100 * MS)).await;
    }
    if stops_after.is_some() {
        running.stop();
    }
    drop(writer);
    running.join().await.unwrap();
}

/// Returns what both say: events with their instants, sources and due instants, sorted.
fn facts(trace: &str) -> Vec<String> {
    let fact = |line: &str| {
        let event: Value = serde_json::from_str(line).unwrap();
        let is_fact = ["open", "request", "result", "fail", "emit", "miss"]
            .iter()
            .any(|ev| event["ev"] == **ev);
        let keys = ["at", "ev", "t", "p", "due", "deadline", "within"];
        is_fact.then(|| keys.map(|key| format!("{key} {}", event[key])).join(" "))
    };
    let mut facts: Vec<String> = trace.lines().filter_map(fact).collect();
    facts.sort();
    facts
}

fn converted(folder: &Path) -> String {
    let (trace, spans) = (folder.join("trace.jsonl"), folder.join("spans.json"));
    let (trace, spans) = (trace.to_str().unwrap(), spans.to_str().unwrap());
    let converted = run(&["convert", "--header", trace, "--span", "message=message", spans], "");
    assert_eq!(err(&converted), "");
    out(&converted).to_owned()
}

#[test]
fn an_operators_spans_are_converted_to_what_its_trace_says() {
    let folder = tempdir().unwrap();
    let messages = [
        [(5, false), (20, false), (30, false)], // by the best cloud
        [(5, false), (20, true), (30, true)],   // both fail: local
        [(5, false), (20, false), (90, false)], // one is too late: the other
        [(5, true), (20, true), (30, true)],    // missed
        [(60, false), (70, false), (5, false)], // at once; local computes on
    ];
    play(folder.path(), &messages, None);
    let trace = fs::read_to_string(folder.path().join("trace.jsonl")).unwrap();
    let back = converted(folder.path());
    // Local's result that comes after its message's end is no longer its span's.
    let is_awaited = |fact: &String| !fact.contains(r#"at 460000000 ev "result" t 4 p 0"#);
    let own: Vec<String> = facts(&trace).into_iter().filter(is_awaited).collect();
    let mine: Vec<String> = facts(&back).into_iter().filter(is_awaited).collect();
    assert_eq!(mine, own, "{back}");
    assert_eq!(own.len(), 5 + 10 + 5 + 12, "{own:#?}");
    let check = ["check", "--observed", "--tolerance", "1ns", "--lateness", "1ms", "--ended"];
    let judged = run(&check, &back);
    assert_eq!(judged.status.code(), Some(0), "{}", out(&judged));
}

#[test]
fn a_message_that_the_run_ends_before_is_left_open() {
    let folder = tempdir().unwrap();
    play(folder.path(), &[[(60, false), (40, false), (45, false)]], Some(10 * MS));
    let back = converted(folder.path());
    let events = ["open", "request", "emit", "miss", "fail", "result"]
        .map(|ev| back.matches(&format!(r#""ev":"{ev}""#)).count());
    assert_eq!(events, [1, 2, 0, 0, 0, 0], "{back}");
}
