//! Plays scenarios on a paused clock and prints the outcomes: `scenarios FOLDER < scenarios`.
//!
//! The Python operator's tests (`adapters/python/tests/test_same.py`) draw the scenarios, play them
//! too, and compare the outcomes. The traces are written to the folder as `NUMBER.jsonl`.

use std::collections::BTreeMap;
use std::error::Error;
use std::future::pending;
use std::io::stdin;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::deadline::Constant;
use fuseline_tokio::{
    Call, Commit, Config, Ending, Item, Latency, Lineage, Local, Operator, Origin, Recording,
    Running, Setup, StampedValue, Trace, spawn, stream,
};
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep, sleep_until};

/// An action of a source on a message, after this many milliseconds. An answer may state the
/// message that it is of.
#[derive(Clone, Copy)]
enum PlayedAction {
    Answers(u64, Option<u64>),
    Fails(u64),
    Hangs,
}

/// A cloud's bounds.
struct PlayedCloud {
    priority: u16,
    calls: usize,
    limit: u64,
    linger: Duration,
    policy: Option<Duration>,
    max_age: u64,
}

/// The bounds of side requests. A side request has a `number` in place of a priority.
struct PlayedSide {
    number: u16,
    calls: usize,
    limit: u64,
    resume: u64,
}

/// One message of a scenario: its instant, its lineage, and local's action. `asked` has the
/// deadline and the action for each cloud and side request. Those without a deadline get no
/// request.
#[derive(Clone)]
struct PlayedMessage {
    at: u64,
    lineage: Option<PlayedLineage>,
    local: PlayedAction,
    asked: BTreeMap<u16, (Option<Duration>, PlayedAction)>,
}

/// A message's number at its sensor, its age when it comes, its end-to-end deadline, and the name
/// of a missing input.
#[derive(Clone)]
struct PlayedLineage {
    seq: u64,
    age: Option<Duration>,
    within: Option<Duration>,
    missing: Option<String>,
}

/// A line `scenario COMMIT WINDOW AT_ONCE DEADLINE WAITING SKIPS RESERVE SUBSTITUTES`, and the
/// lines that follow it.
struct PlayedScenario {
    commit: Commit,
    window: u16,
    at_once: usize,
    deadline: Option<Duration>,
    waiting: Option<usize>,
    skips: bool,
    reserve: Option<Duration>,
    substitutes: bool,
    clouds: Vec<PlayedCloud>,
    sides: Vec<PlayedSide>,
    messages: Vec<PlayedMessage>,
}

type PlayError = Box<dyn Error>;

fn main() -> Result<(), PlayError> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("scenarios FOLDER")?);
    let mut scenarios: Vec<PlayedScenario> = Vec::new();
    for line in stdin().lines() {
        let line = line?;
        let mut words = line.split(' ');
        match (words.next(), scenarios.last_mut()) {
            (Some("scenario"), _) => scenarios.push(PlayedScenario::read(words)?),
            (Some("cloud"), Some(scenario)) => scenario.clouds.push(PlayedCloud::read(words)?),
            (Some("side"), Some(scenario)) => scenario.sides.push(PlayedSide::read(words)?),
            (Some("message"), Some(scenario)) => {
                scenario.messages.push(PlayedMessage::read(words)?);
            }
            _ => return Err(format!("no scenario: {line}").into()),
        }
    }
    for (number, scenario) in scenarios.into_iter().enumerate() {
        let runtime = Builder::new_current_thread().enable_all().start_paused(true).build()?;
        println!("scenario {number}");
        runtime.block_on(play(scenario, &folder.join(format!("{number}.jsonl"))))?;
    }
    Ok(())
}

async fn play(scenario: PlayedScenario, path: &Path) -> Result<(), PlayError> {
    let config = Config {
        window: scenario.window,
        commit: scenario.commit,
        output_len: 1024,
        reserve: scenario.reserve.map(Latency::stated).into_iter().collect(),
        trace: Some(Trace { path: path.to_owned(), recording: Recording::default() }),
        ..Config::default()
    };
    let messages = scenario.messages.clone();
    let (mut writer, input) = stream(1024);
    let start = Instant::now();
    let (running, mut output) = spawn(scenario, config, input)?;
    tokio::spawn(async move {
        for message in messages {
            sleep_until(start + Duration::from_millis(message.at)).await;
            let lineage = message.lineage.as_ref().map(|it| Arc::new(it.at(Instant::now())));
            if writer.write_with(message, lineage).is_err() {
                return;
            }
        }
    });
    while let Some(item) = output.read().await {
        println!("{}", item_line(&item));
    }
    for ((of, what, outcome), count) in counts(running).await? {
        println!("count|{of}|{what}|{outcome}|{count}");
    }
    Ok(())
}

impl Operator for PlayedScenario {
    type Input = PlayedMessage;
    type Output = String;

    fn setup(self, setup: &mut Setup<PlayedMessage, String>) -> Local<PlayedMessage, String> {
        for PlayedCloud { priority, calls, limit, linger, policy, max_age } in self.clouds {
            let handle = move |action: PlayedAction, call: Call| {
                let age = call.lineage.as_ref().and_then(|it| it.age(Instant::now()));
                let age = or_dash(age.map(|age| age.as_nanos()));
                action.play(format!("of {priority} in {} at {age}", call.deadline.as_nanos()))
            };
            let message_handler = move |message: &PlayedMessage, _| message.request(priority);
            let registered = setup.use_stamped_cloud(handle, message_handler, Ok, priority);
            (registered.calls, registered.limit) = (calls, Some(limit));
            (registered.linger, registered.max_age) = (linger, max_age);
            registered.policy = policy.map(|deadline| Box::new(Constant(deadline)) as Box<_>);
        }
        for PlayedSide { number, calls, limit, resume } in self.sides {
            let handle = move |action: PlayedAction, _| action.play(String::new());
            let message_handler = move |message: &PlayedMessage, _| message.request(number);
            let side = setup.use_side_request(handle, message_handler, |_| Ok(()));
            (side.calls, side.limit, side.resume) = (calls, limit, resume);
        }
        if self.substitutes {
            // Every third message has no substitute.
            setup.use_substitute(|item| {
                (!item.timestamp.is_multiple_of(3)).then(|| "stop".to_owned())
            });
        }
        let compute = |message: Arc<PlayedMessage>, _| async move {
            message.local.play("of 0".into()).await.map(|stamped| stamped.value)
        };
        let mut local = Local::futures(self.at_once, compute);
        (local.deadline, local.waiting) = (self.deadline, self.waiting);
        local.skip_answered = self.skips;
        local
    }
}

impl PlayedAction {
    async fn play(self, value: String) -> Result<StampedValue<String>, fuseline_tokio::Error> {
        match self {
            Self::Answers(ms, of) => {
                sleep(Duration::from_millis(ms)).await;
                Ok(StampedValue { value, of, meant_for: None })
            }
            Self::Fails(ms) => {
                sleep(Duration::from_millis(ms)).await;
                Err(format!("broke {}", ms % 97).into())
            }
            Self::Hangs => pending().await,
        }
    }

    fn read<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Self, PlayError> {
        let kind = words.next();
        let (ms, of) = (number(words.next())?, optional(words.next())?);
        match kind {
            Some("answers") => Ok(Self::Answers(ms, of)),
            Some("fails") => Ok(Self::Fails(ms)),
            Some("hangs") => Ok(Self::Hangs),
            _ => Err(format!("no action: {kind:?}").into()),
        }
    }
}

impl PlayedScenario {
    fn read<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Self, PlayError> {
        let commit = words.next();
        let commit = Commit::ALL.into_iter().find(|rule| Some(rule.as_str()) == commit);
        Ok(Self {
            commit: commit.ok_or("no commit rule")?,
            window: number(words.next())?,
            at_once: number(words.next())?,
            deadline: millis(words.next())?,
            waiting: optional(words.next())?,
            skips: words.next() == Some("skips"),
            reserve: millis(words.next())?,
            substitutes: words.next() == Some("substitutes"),
            clouds: Vec::new(),
            sides: Vec::new(),
            messages: Vec::new(),
        })
    }
}

impl PlayedCloud {
    /// Reads `PRIORITY CALLS LIMIT LINGER POLICY MAX_AGE`.
    fn read<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Self, PlayError> {
        Ok(Self {
            priority: number(words.next())?,
            calls: number(words.next())?,
            limit: number(words.next())?,
            linger: millis(words.next())?.unwrap_or_default(),
            policy: millis(words.next())?,
            max_age: number(words.next())?,
        })
    }
}

impl PlayedSide {
    /// Reads `NUMBER CALLS LIMIT RESUME`.
    fn read<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Self, PlayError> {
        Ok(Self {
            number: number(words.next())?,
            calls: number(words.next())?,
            limit: number(words.next())?,
            resume: number(words.next())?,
        })
    }
}

impl PlayedMessage {
    /// Reads `AT SEQ AGE WITHIN MISSING ACTION MS OF`, and for each cloud and side request
    /// `PRIORITY DEADLINE ACTION MS OF`.
    fn read<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Self, PlayError> {
        let at = number(words.next())?;
        let (seq, age, within) =
            (optional(words.next())?, millis(words.next())?, millis(words.next())?);
        let missing = optional(words.next())?;
        let lineage = seq.map(|seq| PlayedLineage { seq, age, within, missing });
        let local = PlayedAction::read(&mut words)?;
        let mut asked = BTreeMap::new();
        while let Some(priority) = words.next() {
            let deadline = millis(words.next())?;
            asked.insert(priority.parse()?, (deadline, PlayedAction::read(&mut words)?));
        }
        Ok(Self { at, lineage, local, asked })
    }

    /// Returns the request to this cloud and its deadline, if there is one.
    fn request(&self, priority: u16) -> Option<(PlayedAction, Duration)> {
        let (deadline, action) = self.asked.get(&priority)?;
        Some((*action, (*deadline)?))
    }
}

impl PlayedLineage {
    fn at(&self, now: Instant) -> Lineage {
        Lineage {
            origin: Some(Origin { stream: "camera".into(), seq: Some(self.seq) }),
            captured: self.age.map(|age| (now - age).into()),
            within: self.within,
            missing: self.missing.iter().map(|name| name.as_str().into()).collect(),
        }
    }
}

fn number<N: FromStr>(word: Option<&str>) -> Result<N, PlayError>
where
    N::Err: Error + 'static,
{
    Ok(word.ok_or("a number is missing")?.parse()?)
}

/// Reads a value, or `None` from `-`.
fn optional<N: FromStr>(word: Option<&str>) -> Result<Option<N>, PlayError>
where
    N::Err: Error + 'static,
{
    if word == Some("-") { Ok(None) } else { number(word).map(Some) }
}

fn millis(word: Option<&str>) -> Result<Option<Duration>, PlayError> {
    Ok(optional(word)?.map(Duration::from_millis))
}

/// Writes an item as one line, in the same form as the Python test.
fn item_line(item: &Item<String>) -> String {
    let (ending, sent, source, arrived, trigger) = match &item.ending {
        Ending::Preliminary(sent) | Ending::Forwarded(sent) => (
            if item.is_last() { "forwarded" } else { "preliminary" },
            sent.value.as_str(),
            Some(&sent.source),
            sent.arrived.as_nanos().to_string(),
            sent.trigger.as_str(),
        ),
        Ending::Final(source) => ("final", "", Some(source), String::new(), ""),
        Ending::Missed => ("missed", "", None, String::new(), ""),
        Ending::Refused(why) => ("refused", why.as_str(), None, String::new(), ""),
    };
    let of = item.forwarded().and_then(|sent| sent.of);
    let origin = item.lineage.as_ref().and_then(|it| it.origin.as_ref()?.seq);
    let age = item.age.map(|age| age.as_nanos());
    let substitute = item.substitute.as_deref().unwrap_or("-");
    let source = source.map_or("", |source| &*source.name);
    let failures: Vec<String> =
        item.failures.iter().map(|it| format!("{}: {}", it.source.name, it.why)).collect();
    let (opened, decided) = (item.opened.as_nanos(), item.decided.as_nanos());
    format!(
        "item|{}|{opened}|{decided}|{ending}|{sent}|{source}|{arrived}|{trigger}|{}|{}|{}|{}|{}|{substitute}",
        item.timestamp,
        item.revision,
        failures.join(", "),
        or_dash(of),
        or_dash(origin),
        or_dash(age),
    )
}

fn or_dash<N: ToString>(number: Option<N>) -> String {
    number.map_or_else(|| "-".into(), |number| number.to_string())
}

type PlayedCountKey = (String, &'static str, String);

/// Returns the counts under the names that they have in Python, without those that are 0.
async fn counts(running: Running) -> Result<BTreeMap<PlayedCountKey, u64>, PlayError> {
    let mut counts = BTreeMap::new();
    let sides = running.sides();
    let tally = running.join().await?;
    let mut put = |of: &str, what, outcome: &str, count: u64| {
        counts.insert((of.to_owned(), what, outcome.to_owned()), count);
    };
    put("operator", "message", "accepted", tally.messages);
    put("operator", "message", "missed", tally.missed);
    for (why, count) in &tally.refused {
        put("operator", "message", &format!("refused {}", why.as_str()), *count);
    }
    put("operator", "handler", "failed", tally.handler_failures);
    put("operator", "timer", "late", tally.late_timers);
    for side in sides {
        let one = [
            ("requested", side.requested),
            ("refused", side.refused),
            ("answered", side.answered),
            ("failed", side.failed),
            ("expired", side.expired),
            ("handler failed", side.handler_failed),
        ];
        for (outcome, count) in one {
            put(&side.name, "side request", outcome, count);
        }
    }
    for source in &tally.sources {
        let name = &*source.source.name;
        let one = [
            ("request", "admitted", source.admitted),
            ("request", "cancelled", source.cancelled),
            ("request", "lost", source.lost),
            ("handler", "failed", source.handler_failures),
            ("handler", "held up the loop", source.held_up),
            ("policy", "failed", source.policy_failures),
            ("result", "held", source.held),
            ("result", "preliminary", source.preliminary),
            ("failure", "accepted", source.failed),
            ("timer", "fired", source.timers),
            ("output", "final", source.finals),
        ];
        for (what, outcome, count) in one {
            put(name, what, outcome, count);
        }
        for (why, count) in &source.refused {
            put(name, "request", &format!("refused {}", why.as_str()), *count);
        }
        for (why, count) in &source.dropped {
            put(name, "result", &format!("dropped {}", why.as_str()), *count);
        }
        for (why, count) in &source.failures_dropped {
            put(name, "failure", &format!("dropped {}", why.as_str()), *count);
        }
        for (trigger, count) in &source.outputs {
            put(name, "output", trigger.as_str(), *count);
            if trigger.as_str() == "arrival" {
                put(name, "result", "forwarded", *count);
            }
        }
        for (why, count) in source.reasons.iter() {
            put(name, "failed because", why, count);
        }
        put(name, "failed because", "other reasons", source.reasons.others());
    }
    counts.retain(|_, count| *count > 0);
    Ok(counts)
}
