//! The parts that the harnesses share: the scenario, the facts, and a server that answers as late
//! as it says.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

/// The source whose result it is, and of which message.
pub type AttemptDone = (u8, usize);

/// One run of an operator, by the arguments `MODE FOLDER SCENARIO`.
pub struct DrivenRun {
    pub mode: String,
    folder: String,
    text: String,
    scenario: Value,
    file: Mutex<File>,
    attempts: Vec<AtomicUsize>,
}

impl DrivenRun {
    pub fn new() -> Arc<Self> {
        let mut args = std::env::args().skip(1);
        let [mode, folder, text] =
            std::array::from_fn(|_| args.next().expect("MODE FOLDER SCENARIO"));
        let scenario: Value = serde_json::from_str(&text).expect("a scenario");
        let messages = scenario["delays"].as_array().expect("delays").len();
        let file = Mutex::new(File::create(format!("{folder}/robot.facts")).expect("a folder"));
        let attempts = (0..messages).map(|_| AtomicUsize::new(0)).collect();
        Arc::new(Self { mode, folder, text, scenario, file, attempts })
    }

    /// A time of the scenario.
    pub fn time(&self, key: &str, otherwise: u64) -> Duration {
        Duration::from_millis(self.scenario[key].as_u64().unwrap_or(otherwise))
    }

    pub fn deadline(&self) -> Duration {
        self.time("deadline", 100)
    }

    pub fn delays(&self) -> &[Value] {
        self.scenario["delays"].as_array().expect("delays")
    }

    /// Returns `true` if something happens at this message.
    pub fn is_at(&self, key: &str, t: usize) -> bool {
        self.scenario[key].as_u64() == Some(t as u64)
    }

    /// Records a fact of a message; `keys` are further ones, such as `,"p":1`.
    pub fn record(&self, ev: &str, t: usize, keys: &str) {
        let line = format!(r#"{{"ev":"{ev}","at":{},"t":{t}{keys}}}"#, now());
        writeln!(self.file.lock().unwrap(), "{line}").expect("room for the facts");
    }

    pub fn record_request(&self, t: usize, attempt: usize) {
        let deadline = self.deadline().as_nanos();
        self.record("request", t, &format!(r#","p":1,"try":{attempt},"deadline":{deadline}"#));
    }

    /// Returns `true` if calls wait for one another.
    pub fn has_queue(&self) -> bool {
        self.mode == "tower-queue"
    }

    pub fn end(&self) {
        let line = format!(r#"{{"ev":"tick","at":{}}}"#, now());
        writeln!(self.file.lock().unwrap(), "{line}").expect("room for the facts");
    }

    /// Starts the server, in a process that no executor can block.
    pub fn serve(&self) -> (u16, Child) {
        let server = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/server.py");
        let mut command = Command::new("python3");
        let args = command.args([server, "lines", &self.folder, &self.text]);
        let mut child = args.stdout(Stdio::piped()).spawn().expect("python3");
        let mut line = String::new();
        let stdout = child.stdout.as_mut().expect("a pipe");
        BufReader::new(stdout).read_line(&mut line).expect("the server's port");
        (line.trim().parse().expect("a port"), child)
    }

    /// One attempt of a message's request.
    pub async fn call(self: Arc<Self>, port: u16, t: usize) -> Result<AttemptDone, String> {
        let attempt = self.attempts[t].fetch_add(1, Ordering::Relaxed);
        if !self.has_queue() {
            self.record_request(t, attempt);
        }
        let reply = exchange(port, t, attempt).await;
        if reply.is_err() {
            self.record("fail", t, &format!(r#","p":1,"try":{attempt}"#));
        }
        reply
    }
}

async fn exchange(port: u16, t: usize, attempt: usize) -> Result<AttemptDone, String> {
    let stream =
        TcpStream::connect(("127.0.0.1", port)).await.map_err(|error| error.to_string())?;
    let mut stream = tokio::io::BufReader::new(stream);
    let request = format!("{t} {attempt}\n");
    stream.write_all(request.as_bytes()).await.map_err(|error| error.to_string())?;
    let mut line = String::new();
    stream.read_line(&mut line).await.map_err(|error| error.to_string())?;
    let of = line.split(' ').next().and_then(|of| of.parse().ok()).ok_or("closed")?;
    Ok((1, of))
}

fn now() -> u128 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32).as_nanos()
}
