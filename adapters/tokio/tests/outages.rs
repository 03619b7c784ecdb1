//! Tests what is logged about clouds that are gone. There is only one test, because a program has
//! one cache of which subscriber listens to which event.

#[expect(dead_code, reason = "it is of the other tests too")]
mod support;

use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_tokio::{Call, Commit, Config, Error, Local, Setup, spawn, stream};
use support::ClosureOperator;
use tokio::time::sleep;

const MS: Duration = Duration::from_millis(1);

/// A cloud that is gone for a minute, or 600 frames of a camera, is logged at first, every ten
/// seconds, and when it is back (D15).
#[tokio::test(start_paused = true)]
async fn a_cloud_that_is_gone_is_logged_at_first_every_ten_seconds_and_once_it_is_back() {
    let log = LogLines::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt()
        .with_ansi(false)
        .without_time()
        .with_writer(move || writer.clone())
        .finish();
    let _default = tracing::subscriber::set_default(subscriber);
    let operator = ClosureOperator(|setup: &mut Setup<u64, String>| {
        let refuses = |t: u64, _: Call| async move {
            sleep(10 * MS).await;
            if (5..605).contains(&t) { Err("refused".into()) } else { Ok(format!("of {t}")) }
        };
        let hangs = |t: u64, _: Call| async move {
            sleep(if (5..605).contains(&t) { 10_000 * MS } else { 20 * MS }).await;
            Ok::<_, Error>(format!("of {t}"))
        };
        let send = |t: &u64, _| Some((*t, 80 * MS));
        setup.use_cloud(refuses, send, Ok, 1).name = "refuses".into();
        setup.use_cloud(hangs, send, Ok, 2).name = "hangs".into();
        Local::future(|_, _| async { Ok("local's".to_owned()) })
    });
    let (mut camera, frames) = stream(8);
    let config = Config { commit: Commit::Patient, ..Config::default() };
    let (_running, mut items) = spawn(operator, config, frames).unwrap();
    for t in 0..620 {
        camera.write(t).unwrap();
        sleep(100 * MS).await;
        items.read().await.unwrap();
    }
    let log = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
    let of = |source: &str| {
        let source = format!("source=\"{source}\"");
        log.lines().filter(|line| line.contains(&source)).collect::<Vec<_>>()
    };
    let refuses = of("refuses");
    assert_eq!(refuses.len(), 7, "{log}");
    assert!(refuses[0].contains("WARN") && refuses[0].contains("no result will come"), "{log}");
    assert!(
        refuses[1].contains("requests still fail") && refuses[1].contains("requests=101"),
        "{log}"
    );
    assert!(refuses[6].contains("INFO") && refuses[6].contains("results arrive again"), "{log}");
    assert!(refuses[6].contains("requests=600 seconds=60"), "{log}");
    let hangs = of("hangs");
    assert_eq!(hangs.len(), 7, "{log}");
    assert!(
        hangs[0].contains("no request got its result before it was due")
            && hangs[0].contains("requests=16"),
        "{log}"
    );
    assert!(hangs[6].contains("results arrive again"), "{log}");
}

#[derive(Clone, Default)]
struct LogLines(Arc<Mutex<Vec<u8>>>);

impl Write for LogLines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
