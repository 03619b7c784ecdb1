//! The machine around it.

use fuseline_core::{
    Admission, Cloud, Deadline, Firing, Fusion, Instant, Opening, Outcome, Priorities, Priority,
    Timestamp,
};

use crate::slot::{commit, sets};
use crate::{Refusal, number};

/// As many clouds as there may be.
const CLOUDS: usize = 15;
/// More timestamps than the comparison opens at once.
const WINDOW: usize = 16;

pub(crate) type Machine = Fusion<CLOUDS, WINDOW>;

/// A machine as its line says.
pub(crate) fn make(words: &[&str]) -> Result<Machine, Refusal> {
    let [rule, window, clouds @ ..] = words else {
        return Err("a machine has a commit rule and a window".into());
    };
    let mut registered = Vec::new();
    for cloud in clouds.chunks(3) {
        let [priority, limit, resume] = cloud else {
            return Err("a cloud has a priority, a limit and a resume".into());
        };
        registered.push(Cloud {
            priority: Priority::new(number(priority)?),
            limit: number(limit)?,
            resume: number(resume)?,
        });
    }
    Ok(Fusion::new(number(window)?, commit(rule)?, &registered)?)
}

/// What comes of one input: what fired, the answer, and how the machine is left; parted by `;`.
pub(crate) fn answer(machine: &mut Machine, words: &[&str]) -> Result<String, Refusal> {
    let [now, input @ ..] = words else { return Err("an input has an instant".into()) };
    let mut parts = Vec::new();
    let mut ready =
        machine.ready(Instant::from_nanos(number(now)?), |firing| parts.push(fired(&firing)));
    let timestamp = |word: &str| number(word).map(Timestamp::new);
    let priority = |word: &str| number(word).map(Priority::new);
    let deadline = |word: &str| number(word).map(Deadline::from_nanos);
    match input {
        [] => {}
        ["open", t] => parts.push(opened(ready.open(timestamp(t)?, None))),
        ["open", t, limit] => {
            parts.push(opened(ready.open(timestamp(t)?, Some(deadline(limit)?))));
        }
        ["offer", t, p, limit, backlog] => {
            let (t, p) = (timestamp(t)?, priority(p)?);
            parts.push(offered(ready.offer(t, p, deadline(limit)?, number(backlog)?)));
        }
        ["result", t, p] => parts.push(outcome(ready.result(timestamp(t)?, priority(p)?))),
        ["fail", t, p] => parts.push(outcome(ready.fail(timestamp(t)?, priority(p)?))),
        _ => return Err("it is no input".into()),
    }
    parts.push(left(machine));
    Ok(parts.join("; "))
}

fn fired(firing: &Firing<CLOUDS>) -> String {
    let Firing { timestamp, due, timers, outcome: came } = firing;
    let (timestamp, due, timers) = (timestamp.as_u64(), due.as_nanos(), listed(timers));
    format!("fired {timestamp} at {due} [{timers}] {}", outcome(*came))
}

fn opened(opening: Opening) -> String {
    match opening {
        Opening::Accepted => "accepted".to_owned(),
        Opening::Refused(reason) => format!("refused {reason:?}").to_lowercase(),
    }
}

fn offered(admission: Admission) -> String {
    match admission {
        Admission::Admitted { due } => format!("admitted {}", due.as_nanos()),
        Admission::Refused(reason) => format!("refused {reason:?}").to_lowercase(),
    }
}

fn outcome(outcome: Outcome<CLOUDS>) -> String {
    match outcome {
        Outcome::Dropped(reason) => format!("dropped {reason:?}").to_lowercase(),
        Outcome::Held => "held".to_owned(),
        Outcome::Waiting => "waiting".to_owned(),
        Outcome::Forwarded { by, cancelled } => {
            format!("forwarded {} [{}]", by.as_u16(), listed(&cancelled))
        }
        Outcome::Preliminary { by, cancelled } => {
            format!("sent {} [{}]", by.as_u16(), listed(&cancelled))
        }
        Outcome::Final { by } => format!("final {}", by.as_u16()),
        Outcome::Missed => "missed".to_owned(),
    }
}

fn listed(priorities: &Priorities<CLOUDS>) -> String {
    let numbers: Vec<String> = priorities.iter().map(|p| p.as_u16().to_string()).collect();
    numbers.join(" ")
}

/// The clock, the greatest timestamp, the shut gates, and of each open timestamp its sets and due instants.
fn left(machine: &Machine) -> String {
    let clouds: Vec<Priority> =
        machine.clouds().iter().map(|source| machine.priority(source)).collect();
    let newest = machine.newest().map_or("none".to_owned(), |newest| newest.as_u64().to_string());
    let is_shut = |cloud: &&Priority| machine.gate(**cloud).is_some_and(|gate| gate.is_shut());
    let shut = clouds.iter().filter(is_shut).map(|cloud| format!(" {}", cloud.as_u16()));
    let shut: String = shut.collect();
    let mut parts = vec![format!("clock {} newest {newest} shut{shut}", machine.now().as_nanos())];
    for (timestamp, slot) in machine.open() {
        let due = |source: &Priority| {
            let due = machine.due(timestamp, *source)?;
            Some(format!(" {}@{}", source.as_u16(), due.as_nanos()))
        };
        let dues: String = [Priority::LOCAL].iter().chain(&clouds).filter_map(due).collect();
        parts.push(format!("{} {}{dues}", timestamp.as_u64(), sets(slot)));
    }
    parts.join(" | ")
}
