//! The spans of an operator on tokio through `tracing-opentelemetry` and the OTLP JSON of
//! OpenTelemetry's own types: `convert` makes of them what the operator's trace says, and it is
//! judged.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{err, out, run};
use fuseline_tokio::{
    Call, Config, Error, Local, Operator, Recording, Setup, Trace, spawn, stream,
};
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_proto::tonic::collector::trace::v1::ExportTraceServiceRequest;
use opentelemetry_proto::transform::trace::tonic::group_spans_by_resource_and_scope;
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::OTelSdkResult;
use opentelemetry_sdk::trace::{SdkTracerProvider, SpanData, SpanExporter};
use serde_json::Value;
use tempfile::tempdir;
use tracing_subscriber::layer::SubscriberExt;

/// Tells a source what to do with a message. Nothing here depends on how quick the host is: what
/// answers or fails does so at once, and has a minute; only what never answers is due soon.
#[derive(Clone, Copy, Debug)]
enum SourcePlan {
    Answers,
    Fails,
    Never,
}

use SourcePlan::{Answers, Fails, Never};

/// Keeps what it is given.
#[derive(Clone, Default, Debug)]
struct MemoryExporter(Arc<Mutex<Vec<SpanData>>>);

impl SpanExporter for MemoryExporter {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        self.0.lock().unwrap().extend(batch);
        Ok(())
    }
}

/// Local and the clouds 1 and 7.
struct PlannedSources;

impl Operator for PlannedSources {
    type Input = [SourcePlan; 3];
    type Output = ();

    fn setup(self, setup: &mut Setup<Self::Input, ()>) -> Local<Self::Input, ()> {
        for (priority, index) in [(1, 1), (7, 2)] {
            let message_handler = move |message: &Self::Input, _| {
                let due_soon = matches!(message[index], Never);
                let deadline = Duration::from_millis(if due_soon { 20 } else { 60_000 });
                Some((message[index], deadline))
            };
            setup.use_cloud(|plan, _: Call| act(plan), message_handler, Ok, priority);
        }
        Local::futures(4, |message: Arc<Self::Input>, _| act(message[0]))
    }
}

async fn act(plan: SourcePlan) -> Result<(), Error> {
    match plan {
        Answers => Ok(()),
        Fails => Err("as planned".into()),
        Never => std::future::pending().await,
    }
}

/// Runs the operator with these messages, with a trace and its spans as OTLP JSON in this folder.
fn record(folder: &Path, messages: Vec<[SourcePlan; 3]>) {
    let exporter = MemoryExporter::default();
    let provider = SdkTracerProvider::builder().with_simple_exporter(exporter.clone()).build();
    let layer = tracing_opentelemetry::layer().with_tracer(provider.tracer("fuseline"));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), || {
        runtime.block_on(async {
            let path = folder.join("trace.jsonl");
            let trace = Some(Trace { path, recording: Recording::default() });
            let config = Config { trace, ..Config::default() };
            let (mut writer, input) = stream(8);
            let (running, mut items) = spawn(PlannedSources, config, input).unwrap();
            for message in messages {
                writer.write(message).unwrap();
                items.read().await.unwrap();
            }
            drop(writer);
            running.join().await.unwrap();
        });
        drop(runtime);
    });
    provider.shutdown().unwrap();
    let spans = exporter.0.lock().unwrap().clone();
    let resource = (&Resource::builder().build()).into();
    let resource_spans = group_spans_by_resource_and_scope(spans, &resource);
    let export = serde_json::to_string(&ExportTraceServiceRequest { resource_spans }).unwrap();
    fs::write(folder.join("spans.json"), export).unwrap();
}

/// Returns what happened to each message, but for local's results: one that comes after its
/// message's end is no longer its span's.
fn facts(trace: &str) -> BTreeSet<String> {
    let fact = |line: &str| {
        let event: Value = serde_json::from_str(line).unwrap();
        let ev = event["ev"].as_str()?;
        let is_fact = ["open", "request", "result", "fail", "emit", "miss"].contains(&ev);
        let is_locals = ev == "result" && event["p"] == 0;
        (is_fact && !is_locals).then(|| format!("{} {ev} {}", event["t"], event["p"]))
    };
    trace.lines().filter_map(fact).collect()
}

#[test]
fn spans_of_tracing_opentelemetry_are_converted_to_what_the_trace_says() {
    let folder = tempdir().unwrap();
    let messages = vec![
        [Answers, Never, Answers], // by the best cloud
        [Answers, Fails, Fails],   // by local
        [Answers, Answers, Never], // by the other cloud, when the best one's timer fires
        [Fails, Fails, Fails],     // missed
    ];
    record(folder.path(), messages);
    let [trace, spans] = ["trace.jsonl", "spans.json"].map(|name| folder.path().join(name));
    let given = ["--header", trace.to_str().unwrap(), "--span", "message=message"];
    let converted = run(&[&["convert"][..], &given, &[spans.to_str().unwrap()]].concat(), "");
    assert_eq!(err(&converted), "");
    let own = facts(&fs::read_to_string(trace).unwrap());
    assert_eq!(facts(out(&converted)), own, "{}", out(&converted));
    assert_eq!(own.len(), 5 + 6 + 5 + 7, "{own:#?}");
    let check = ["check", "--observed", "--tolerance", "1s", "--lateness", "60s", "--ended"];
    let judged = run(&check, out(&converted));
    assert!(out(&judged).contains(": no violation found, 4 timestamps"), "{}", out(&judged));
}
