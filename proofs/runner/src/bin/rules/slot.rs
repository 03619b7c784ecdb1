//! The pure step of one timestamp.

use fuseline_core::{Cause, Commit, Decision, OfferRefusal, Slot, Source, Sources};

use crate::{Refusal, number};

/// The commit rule of this name.
pub(crate) fn commit(word: &str) -> Result<Commit, Refusal> {
    match word {
        "eager" => Ok(Commit::Eager),
        "patient" => Ok(Commit::Patient),
        "progressive" => Ok(Commit::Progressive),
        _ => Err(format!("{word} is no commit rule").into()),
    }
}

/// What the core says of four sets, or of a step from there.
pub(crate) fn answer(words: &[&str]) -> Result<String, Refusal> {
    let [rule, requested, pending, armed, cached, rest @ ..] = words else {
        return Err("a slot has a commit rule and four sets".into());
    };
    let commit = commit(rule)?;
    let set = |word: &str| number(word).map(Sources::from_bits);
    let slot = Slot::from_sets(commit, set(requested)?, set(pending)?, set(armed)?, set(cached)?);
    let [kind, operand] = rest else {
        return Ok(if slot.is_ok() { "valid" } else { "invalid" }.to_owned());
    };
    let slot = slot?;
    let source = || Source::new(number(operand)?).ok_or_else(|| Refusal::from("no such source"));
    let cause = match *kind {
        "result" => Cause::Result(source()?),
        "failure" => Cause::Failure(source()?),
        "timers" => Cause::Timers(set(operand)?),
        "offer" => return Ok(offered(slot, source()?)),
        _ => return Err(format!("{kind} is no cause").into()),
    };
    let (after, decision) = slot.step(commit, cause);
    let decision = match decision {
        Decision::Dropped(reason) => format!("dropped {reason:?}").to_lowercase(),
        Decision::Held => "held".to_owned(),
        Decision::Waiting => "waiting".to_owned(),
        Decision::Forwarded { by, cancelled } => {
            format!("forwarded {} {}", by.index(), cancelled.bits())
        }
        Decision::Preliminary { by, cancelled } => {
            format!("sent {} {}", by.index(), cancelled.bits())
        }
        Decision::Final { by } => format!("final {}", by.index()),
        Decision::Missed => "missed".to_owned(),
    };
    Ok(format!("{} {decision}", sets(after)))
}

fn offered(slot: Slot, source: Source) -> String {
    let (after, refusal): (Slot, Option<OfferRefusal>) = slot.offer(source);
    match refusal {
        Some(reason) => format!("{} refused {}", sets(after), format!("{reason:?}").to_lowercase()),
        None => format!("{} admitted", sets(after)),
    }
}

/// The four sets as numbers.
pub(crate) fn sets(slot: Slot) -> String {
    let sets = [slot.requested(), slot.pending(), slot.armed(), slot.cached()];
    sets.map(|set| set.bits().to_string()).join(" ")
}
