//! Tests what an operator logs. There is only one test, because a program has one cache of which
//! subscriber wants which event.

use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::{Cloud, Commit, Engine, EngineConfig, Header, Local};

/// Every refusal, drop, failure and miss is logged with its reason (D15).
#[test]
fn logs_have_each_refusal_drop_failure_and_miss() {
    let log = Log::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt()
        .with_max_level(tracing::Level::DEBUG)
        .with_ansi(false)
        .without_time()
        .with_writer(move || writer.clone())
        .finish();
    tracing::subscriber::with_default(subscriber, || {
        let west = Cloud { p: 1, name: Some("west".into()), limit: 2, resume: 0 };
        let header = Header {
            operator: Some("tested".into()),
            window: 4,
            commit: Commit::Eager,
            clouds: vec![west],
        };
        let local = Local { waiting: Some(2), ..Local::default() };
        let mut config = EngineConfig { local, ..EngineConfig::from(&header) };
        config.clouds[0].calls = 1;
        let mut engine: Engine<&str, u64> = Engine::new(config).unwrap();
        let _ = engine.open(0, 0, None, 0, []);
        let _ = engine.open(0, 0, None, 0, []);
        engine.offer(0, 0, 1, Duration::ZERO, 0);
        engine.result(1, 0, 1, "boxes");
        engine.fail(2, 0, 0, &"out of memory");
        engine.fail(3, 0, 0, &"out of memory");
    });
    let log = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
    for words in [
        "WARN fuseline_engine::engine::apply: message refused operator=\"tested\" timestamp=0 why=order",
        "DEBUG fuseline_engine::engine::apply: request refused operator=\"tested\" timestamp=0 \
         source=\"west\" why=deadline",
        "result dropped operator=\"tested\" timestamp=0 source=\"west\" why=unsolicited",
        "WARN fuseline_engine::engine::apply: no result will come operator=\"tested\" timestamp=0 \
         source=\"local\" why=out of memory",
        "WARN fuseline_engine::engine::apply: message missed operator=\"tested\" timestamp=0",
        "failure dropped operator=\"tested\" timestamp=0 source=\"local\" why=superseded",
    ] {
        assert!(log.contains(words), "no {words:?} in\n{log}");
    }
}

#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
