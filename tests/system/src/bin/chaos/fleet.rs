//! Operators side by side. Each has a camera, a trace, and a reader that checks the items as they
//! come.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fuseline_tokio::{
    Config, Error, Item, Items, Recording, Running, Tally, Trace, Writer, spawn, stream,
};
use fuseline_traces::judge;
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout_at};

use crate::field::Testbed;
use crate::gauges::Overruns;
use crate::vehicle::{ChaosVehicle, DEADLINE, ResultOrigin, name};

/// The time that operators may take to end after all cameras have ended.
const ENDS: Duration = Duration::from_secs(30);

/// The number of wrong items that are reported for each operator.
const SHOWN: usize = 3;

/// Something that ended after its deadline.
pub(crate) struct LateItem {
    pub(crate) outputs: Arc<Overruns>,
    pub(crate) calls: Arc<Overruns>,
}

pub(crate) struct Fleet {
    vessels: Vec<OperatorUnderTest>,
    /// The number of items that were read.
    read: Arc<AtomicU64>,
    messages: u64,
    /// The messages per second of all operators.
    rate: u32,
}

/// One operator with everything around it.
struct OperatorUnderTest {
    number: u64,
    /// The two clouds, with the lower one first.
    clouds: [usize; 2],
    running: Running,
    trace: PathBuf,
    camera: JoinHandle<()>,
    reader: JoinHandle<ReaderLog>,
}

/// The observations of a reader.
#[derive(Default)]
pub(crate) struct ReaderLog {
    /// The number of messages that have the right value, by the source of the value.
    pub(crate) answers: BTreeMap<String, u64>,
    /// The number of wrong items and descriptions of the first ones. An item is wrong if it is
    /// missed, refused, a duplicate, or of another message.
    pub(crate) wrong: (u64, Vec<String>),
    pub(crate) longest: Duration,
}

/// The outcome of one operator.
pub(crate) struct OperatorOutcome {
    pub(crate) number: u64,
    pub(crate) log: ReaderLog,
    pub(crate) tally: Tally,
    /// The number of messages that the judge found in the trace.
    pub(crate) judged: u64,
    /// The judge's first finding.
    pub(crate) finding: Option<String>,
}

impl Fleet {
    /// Starts operators that each get a number of messages at a rate. Their traces go to this
    /// folder.
    pub(crate) fn launch(
        field: &Testbed,
        operators: u32,
        each: u64,
        rate: u32,
        folder: &Path,
        late: &LateItem,
    ) -> Result<Self, Error> {
        let read = Arc::default();
        let every = Duration::from_secs(1) / rate;
        let mut vessels = Vec::new();
        for number in 0..operators {
            let lower = number as usize % field.len();
            let clouds = [lower, (lower + 1) % field.len()];
            let connected =
                [field.remote(clouds[0])?.connect()?, field.remote(clouds[1])?.connect()?];
            let vehicle = ChaosVehicle {
                number: number.into(),
                clouds: std::array::from_fn(|index| (clouds[index], connected[index].clone())),
                outlived: Arc::clone(&late.calls),
            };
            let trace = folder.join(format!("{number}.jsonl"));
            let recorded = Trace { path: trace.clone(), recording: Recording::default() };
            let (writer, frames) = stream(8);
            let config = Config { trace: Some(recorded), ..Config::default() };
            let (running, output) = spawn(vehicle, config, frames)?;
            let camera = tokio::spawn(film(writer, each, every, every * number / operators));
            let reader =
                see(output, number.into(), each, Arc::clone(&read), Arc::clone(&late.outputs));
            let reader = tokio::spawn(reader);
            let number = number.into();
            vessels.push(OperatorUnderTest { number, clouds, running, trace, camera, reader });
        }
        Ok(Self { vessels, read, messages: each * u64::from(operators), rate: rate * operators })
    }

    /// Returns the number of all messages.
    pub(crate) const fn messages(&self) -> u64 {
        self.messages
    }

    /// Returns the number of messages that have an output.
    pub(crate) fn answered(&self) -> u64 {
        self.read.load(Ordering::Relaxed)
    }

    /// Returns the least time for which the cameras continue.
    pub(crate) fn remains(&self) -> Duration {
        let remaining = self.messages.saturating_sub(self.answered());
        Duration::from_secs(remaining / u64::from(self.rate))
    }

    /// Returns the operators' counts so far.
    pub(crate) fn tallies(&self) -> Vec<Tally> {
        self.vessels.iter().map(|subject| subject.running.tally()).collect()
    }

    /// Returns the clouds of each operator that had no output since then.
    pub(crate) fn unanswered(&self, since: &[Tally]) -> Vec<String> {
        let mut unanswered = Vec::new();
        for ((subject, before), now) in self.vessels.iter().zip(since).zip(self.tallies()) {
            for cloud in subject.clouds {
                let name = name(Some(cloud));
                if outputs(&now, &name) == outputs(before, &name) {
                    unanswered.push(format!("operator {} of {name}", subject.number));
                }
            }
        }
        unanswered
    }

    /// Waits for all operators to end, and judges the traces. If an operator does not end, its
    /// place has a description of what it left behind.
    pub(crate) async fn land(mut self) -> Result<Vec<Result<OperatorOutcome, String>>, Error> {
        for subject in &mut self.vessels {
            (&mut subject.camera).await?;
        }
        let (mut fates, until) = (Vec::new(), Instant::now() + ENDS);
        for subject in self.vessels {
            let (number, tally) = (subject.number, subject.running.tally());
            let ended =
                async { Ok::<_, Error>((subject.reader.await?, subject.running.join().await?)) };
            let Ok(ended) = timeout_at(until, ended).await else {
                fates.push(Err(format!("operator {number} does not end: {tally:?}")));
                continue;
            };
            let (log, tally) = match ended {
                Ok(ended) => ended,
                Err(error) => {
                    fates.push(Err(format!("operator {number}: {error}")));
                    continue;
                }
            };
            let trace = subject.trace;
            let judged = move || {
                let verdict = judge("trace", BufReader::new(File::open(&trace)?))?;
                std::fs::remove_file(&trace)?;
                Ok::<_, Error>(verdict)
            };
            let verdict = tokio::task::spawn_blocking(judged).await??;
            let finding = verdict.violations.first().map(|finding| format!("{finding:?}"));
            fates.push(Ok(OperatorOutcome {
                number,
                log,
                tally,
                judged: verdict.judged,
                finding: finding
                    .or_else(|| (!verdict.violations.is_empty()).then(|| "cut off".to_owned())),
            }));
        }
        Ok(fates)
    }
}

/// Returns the number of messages whose output came from the source of this name.
pub(crate) fn outputs(tally: &Tally, name: &str) -> u64 {
    let source = tally.sources.iter().find(|source| &*source.source.name == name);
    source.map_or(0, fuseline_tokio::SourceTally::forwarded)
}

/// Writes messages at a pace. A message that finds no room is written in the next turn.
async fn film(mut writer: Writer<u64>, messages: u64, every: Duration, offset: Duration) {
    sleep(offset).await;
    let mut turns = interval(every);
    turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut written = 0;
    while written < messages {
        turns.tick().await;
        written += u64::from(writer.write(written).is_ok());
    }
}

async fn see(
    mut output: Items<ResultOrigin>,
    number: u64,
    messages: u64,
    read: Arc<AtomicU64>,
    late_outputs: Arc<Overruns>,
) -> ReaderLog {
    let mut log = ReaderLog::default();
    let mut times = vec![0_u8; usize::try_from(messages).unwrap_or(0)];
    while let Some(item) = output.read().await {
        read.fetch_add(1, Ordering::Relaxed);
        let index = usize::try_from(item.timestamp).unwrap_or(usize::MAX);
        let is_first = times.get_mut(index).is_some_and(|times| {
            *times = times.saturating_add(1);
            *times == 1
        });
        match item.forwarded().map(|forwarded| forwarded.value) {
            Some(ResultOrigin { operator, message, cloud })
                if is_first && (operator, message) == (number, item.timestamp) =>
            {
                *log.answers.entry(name(cloud)).or_default() += 1;
            }
            Some(_) | None => log.wrong(number, &item),
        }
        let took = item.latency();
        log.longest = log.longest.max(took);
        let late = took.checked_sub(DEADLINE).filter(|late| !late.is_zero());
        if let Some(by) = late {
            late_outputs.note(by);
        }
    }
    log
}

impl ReaderLog {
    fn wrong(&mut self, operator: u64, item: &Item<ResultOrigin>) {
        self.wrong.0 += 1;
        if self.wrong.1.len() < SHOWN {
            let Item { timestamp, ending, .. } = item;
            self.wrong.1.push(format!("operator {operator}, message {timestamp}: {ending:?}"));
        }
    }
}
