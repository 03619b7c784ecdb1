//! What must hold of every run, by name.

use std::collections::BTreeMap;
use std::time::Duration;

use super::facts::{Facts, MessageOutcome, value};
use super::play::StatusReport;
use super::scenario::Form;
use crate::fusion::LOCAL;
use crate::report::DiagnosticStatus;

/// One thing that must hold of every run.
pub(super) struct Check {
    /// Its name, which begins with the promise of SPEC.md that it is about.
    pub(super) name: &'static str,
    holds: fn(&Facts<'_>) -> Result<(), String>,
}

/// All of them.
pub(super) const CHECKS: &[Check] = &[
    // A run that has no end, and a trace that is not whole, have no facts.
    Check { name: "d8_everything_ends", holds: |_| Ok(()) },
    Check { name: "d10_whole_trace", holds: |_| Ok(()) },
    Check { name: "d1_one_item", holds: one_item },
    Check { name: "d2_its_own_value", holds: its_own_value },
    Check { name: "d3_the_rules_decide", holds: the_rules_decide },
    Check { name: "d8_nothing_is_left", holds: nothing_is_left },
    Check { name: "d11_one_account", holds: one_account },
    Check { name: "d13_lost_words", holds: lost_words },
    Check { name: "d14_its_own_topic", holds: its_own_topic },
    Check { name: "d15_reported", holds: reported },
    Check { name: "d16_as_set", holds: as_set },
];

/// What does not hold of a run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Finding {
    pub(super) check: &'static str,
    /// What is wrong, in words.
    pub(super) reason: String,
}

impl Facts<'_> {
    /// Everything that does not hold.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let found = |check: &Check| {
            let reason = (check.holds)(self).err()?;
            Some(Finding { check: check.name, reason })
        };
        CHECKS.iter().filter_map(found).collect()
    }
}

fn ensure(holds: bool, reason: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(reason()) }
}

/// D1, D2: each message has one status that is the last, and what is none has the key of one that is remembered.
fn one_item(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, messages, opened, .. } = facts;
    let last = played.log.statuses.iter().filter(|it| !it.status.message.ends_with("preliminary"));
    let mut reported: Vec<_> = last.filter_map(StatusReport::timestamp).collect();
    reported.sort_unstable();
    let all: Vec<_> = (0..opened.len() as u64).collect();
    ensure(reported == all, || {
        format!("of {} messages there are statuses {reported:?}", all.len())
    })?;
    ensure(messages.len() == opened.len(), || {
        let next = &opened[messages.len()];
        format!("no input came at the instant of {next:?}, the message {}", messages.len())
    })?;
    for serial in &facts.rejected {
        let (input, at) = (&facts.inputs[*serial], played.log.arrived_at[*serial]);
        let is_taken = facts.has_remembered(*serial, |ended| ended >= at);
        let is_inactive = facts.states(at).any(|state| !state.is_active);
        ensure(input.form != Form::Whole || is_taken || is_inactive, || {
            format!("input {serial} of key {} was not taken in", input.key)
        })?;
    }
    for message in messages {
        let at = played.log.arrived_at[message.serial];
        ensure(facts.states(at).any(|state| state.is_active), || {
            format!("input {} was taken in though the node was not active", message.serial)
        })?;
        // The scenarios have fewer messages than are remembered, and refused ones are not.
        ensure(!facts.has_remembered(message.serial, |_| false), || {
            format!("input {} was taken in though its key is a message's", message.serial)
        })?;
    }
    Ok(())
}

/// D2: outputs and hints are results of their messages, of their sources.
fn its_own_value(facts: &Facts<'_>) -> Result<(), String> {
    let is_of = |value: super::play::Value, t: usize, index: usize| {
        let serial = facts.messages.get(t).map(|message| message.serial);
        let key = serial.map(|serial| facts.inputs[serial].key);
        // Of two with one key at one instant, one of them may have come just before an activation.
        let is_same = serial.is_some_and(|serial| facts.is_doubled_at_once(serial));
        Some(value.key) == key
            && value.index == index
            && facts.inputs.get(value.serial).map(|input| input.key) == key
            && (is_same || Some(value.serial) == serial)
    };
    for (t, opened) in facts.opened.iter().enumerate() {
        let Some(message) = facts.messages.get(t) else { continue };
        for ((_, outcome), reported) in opened.items.iter().zip(&message.reported) {
            let (MessageOutcome::Preliminary { index }
            | MessageOutcome::Forwarded { index, .. }
            | MessageOutcome::Final { index }) = *outcome
            else {
                continue;
            };
            let output = reported.output.as_ref();
            let value = output.and_then(|output| output.value.as_ref().ok()).copied();
            ensure(value.is_some_and(|value| is_of(value, t, index)), || {
                format!("{t} was forwarded from {index} as {output:?}")
            })?;
        }
    }
    // F3: what was late, in that order, of the peers whose late results are published.
    let hints = |index: usize| facts.played.log.hints.iter().filter(move |it| it.0 == index);
    for (index, peer) in facts.scenario.peers.iter().enumerate() {
        let late: Vec<_> = facts.late.iter().filter(|it| it.0 == index && peer.hints).collect();
        let same = hints(index).count() == late.len()
            && hints(index).zip(&late).all(|((_, value), (_, t))| {
                let t = usize::try_from(*t).unwrap_or(usize::MAX);
                value.as_ref().is_ok_and(|value| is_of(*value, t, index))
            });
        ensure(same, || {
            let hints: Vec<_> = hints(index).collect();
            format!("late were {late:?} of {index}, the hints were {hints:?}")
        })?;
    }
    Ok(())
}

/// D3: the trace conforms, and what is published is what it decides, when it decides it.
fn the_rules_decide(facts: &Facts<'_>) -> Result<(), String> {
    ensure(facts.verdict.violations.is_empty(), || format!("{:?}", facts.verdict))?;
    for (t, (message, opened)) in facts.messages.iter().zip(&facts.opened).enumerate() {
        let is_last = opened.items.last().copied() == opened.ended() && !opened.items.is_empty();
        ensure(is_last && opened.items.len() == message.reported.len(), || {
            format!("{t} left as {:?}, reported was {:?}", opened.items, message.reported)
        })?;
        for (revision, (item, reported)) in opened.items.iter().zip(&message.reported).enumerate() {
            ensure(is_decided(revision, *item, reported), || {
                format!("{t} left as {item:?}, reported was {reported:?}")
            })?;
        }
    }
    ensure(facts.played.log.disobeyed.is_none(), || {
        format!("an order of the manager ended so: {:?}", facts.played.log.disobeyed)
    })
}

/// Returns `true` if a status, with its output on the right topic, is what the trace decided.
fn is_decided(
    revision: usize,
    (decided, outcome): (u64, MessageOutcome),
    reported: &StatusReport,
) -> bool {
    let (source, rule, is_revision) = match outcome {
        MessageOutcome::Preliminary { index } => (Some(name(index)), Some("F9"), Some(true)),
        MessageOutcome::Forwarded { index, rule } => (Some(name(index)), Some(rule), Some(false)),
        MessageOutcome::Final { index } => (Some(name(index)), Some("F9"), Some(false)),
        MessageOutcome::Missed | MessageOutcome::Refused(_) => (None, None, None),
    };
    let words = match outcome {
        MessageOutcome::Preliminary { index } => format!("{}, preliminary", name(index)),
        MessageOutcome::Forwarded { .. } => reported.status.message.clone(),
        MessageOutcome::Final { index } => format!("{}, final", name(index)),
        MessageOutcome::Missed => "missed".to_owned(),
        MessageOutcome::Refused(why) => format!("refused: {why}"),
    };
    reported.at == decided
        && reported.value("source").map(str::to_owned) == source
        && reported.value("rule") == rule
        && reported.value("revision") == Some(&*revision.to_string())
        && reported.output.as_ref().map(|output| output.is_revision) == is_revision
        && reported.status.message == words
}

/// D8: no message and no result is kept.
fn nothing_is_left(facts: &Facts<'_>) -> Result<(), String> {
    let held = facts.played.held;
    ensure(held == 0, || format!("{held} messages and results are still held"))
}

/// D11: the tally has the counts of the trace, and of what was sent.
fn one_account(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, opened, .. } = facts;
    let tally = &played.tally;
    let count = |is: &dyn Fn(MessageOutcome) -> bool| {
        opened.iter().filter(|it| it.ended().is_some_and(|(_, outcome)| is(outcome))).count() as u64
    };
    let refused = count(&|outcome| matches!(outcome, MessageOutcome::Refused(_)));
    let missed = count(&|outcome| outcome == MessageOutcome::Missed);
    let reported = (tally.messages, tally.missed, tally.refused.values().sum::<u64>());
    let traced = (opened.len() as u64 - refused, missed, refused);
    ensure(reported == traced, || {
        format!("messages, missed, refused: {reported:?}, traced {traced:?}")
    })?;
    for (index, source) in tally.sources.iter().enumerate() {
        let offers = opened.iter().filter_map(|message| message.offers.get(&index));
        let admitted = if index == LOCAL {
            opened.len() as u64 - refused
        } else {
            offers.clone().filter(|(_, is_refused)| !is_refused).count() as u64
        };
        let outputs = count(
            &|outcome| matches!(outcome, MessageOutcome::Forwarded { index: of, .. } if of == index),
        );
        let items = || opened.iter().flat_map(|it| &it.items).map(|(_, outcome)| *outcome);
        let preliminary = items().filter(|it| *it == MessageOutcome::Preliminary { index }).count();
        let finals = items().filter(|it| *it == MessageOutcome::Final { index }).count();
        let is_called = facts.scenario.peers[index].is_called;
        let sent = facts.requested(index).map(|requested| requested.bytes).sum::<u64>();
        let of = |counts: &BTreeMap<usize, u64>| counts.get(&index).copied().unwrap_or(0);
        let traced = [
            admitted,
            outputs,
            finals as u64,
            preliminary as u64,
            of(&facts.timers),
            of(&facts.cancelled),
            if is_called { 0 } else { sent },
        ];
        let reported = [
            source.admitted,
            source.outputs.values().sum(),
            source.finals,
            source.preliminary,
            source.timers,
            source.cancelled,
            source.sent_bytes,
        ];
        ensure(reported == traced, || {
            format!(
                "{index}: admitted, outputs, final, preliminary, timers, cancelled, bytes \
                 {reported:?}, traced {traced:?}"
            )
        })?;
    }
    Ok(())
}

/// D13: in the calm each message goes to local and to each cloud at once, and the best answers it.
fn lost_words(facts: &Facts<'_>) -> Result<(), String> {
    let calm = facts.scenario.calm();
    let best = facts.scenario.peers.len() - 1;
    let mut count = 0;
    for (t, (message, opened)) in facts.messages.iter().zip(&facts.opened).enumerate() {
        let input = &facts.inputs[message.serial];
        if input.at < calm {
            continue;
        }
        count += 1;
        let is_best = matches!(opened.ended(), Some((_, MessageOutcome::Forwarded { index, rule: "F3" })) if index == best);
        ensure(is_best, || format!("{t} of the calm left so: {:?}", opened.ended()))?;
        for index in 0..=best {
            let mut requested =
                facts.requested(index).filter(|requested| requested.serial == message.serial);
            let at: Vec<_> = requested.by_ref().map(|requested| requested.at).collect();
            ensure(at == [opened.at], || {
                format!("{index} was asked about {t} of the calm, opened at {}: {at:?}", opened.at)
            })?;
        }
    }
    let all = facts.inputs.iter().filter(|input| input.at >= calm).count();
    ensure(count == all, || format!("{count} of {all} messages of the calm were taken in"))
}

/// D14: what is no message and no result is counted as what it is.
fn its_own_topic(facts: &Facts<'_>) -> Result<(), String> {
    let Some(statuses) = facts.played.log.diagnostics.last().map(|last| &last.1) else {
        return Err("there were no diagnostics".into());
    };
    let count = |status: &DiagnosticStatus, key: &str| -> u64 {
        value(&status.values, key).and_then(|text| text.parse().ok()).unwrap_or(u64::MAX)
    };
    for (form, key) in [
        (Form::Short, "malformed short"),
        (Form::NotCdr, "malformed encoding"),
        (Form::Whole, "duplicate_stamp"),
    ] {
        // At the instant of an activation it may or may not be looked at.
        let (mut least, mut most) = (0, 0);
        for serial in facts.rejected.iter().filter(|serial| facts.inputs[**serial].form == form) {
            let at = facts.played.log.arrived_at[*serial];
            // A message whose twin was not looked at may be taken in, and no stamp occurred before.
            let mut twins = (facts.inputs.iter().zip(&facts.played.log.arrived_at))
                .filter(|(twin, _)| twin.key == facts.inputs[*serial].key);
            let is_certain = twins.all(|(_, at)| facts.states(*at).all(|state| state.is_active));
            least += u64::from(is_certain);
            most += u64::from(facts.states(at).any(|state| state.is_active));
        }
        let reported = count(&statuses[0], key);
        ensure((least..=most).contains(&reported), || {
            format!("{key} is {reported}, not {least} to {most}")
        })?;
    }
    for (unmatched, status) in facts.played.log.unmatched.iter().zip(&statuses[1..]) {
        let reported = ["unknown_stamp", "malformed"].map(|key| count(status, key));
        let wanted = [unmatched.unknown_stamp, unmatched.malformed];
        ensure(reported == wanted, || {
            format!("{}: unknown and malformed are {reported:?}, not {wanted:?}", status.name)
        })?;
    }
    Ok(())
}

/// D15: each period has the level of what happened in it; at the end all is well.
fn reported(facts: &Facts<'_>) -> Result<(), String> {
    let mut before = BTreeMap::new();
    for (at, statuses) in &facts.played.log.diagnostics {
        let status = &statuses[0];
        let mut more = |keys: &dyn Fn(&str) -> bool| -> u64 {
            let of = status.values.iter().filter(|value| keys(&value.key));
            of.map(|value| {
                let count: u64 = value.value.parse().unwrap_or(0);
                count - before.insert(value.key.clone(), count).unwrap_or(0)
            })
            .sum()
        };
        let worst = more(&|key| key == "missed" || key == "unsent");
        let bad = more(&|key| {
            key.starts_with("refused") || key.starts_with("malformed") || key == "duplicate_stamp"
        });
        let level = if worst > 0 { 2 } else { u8::from(bad > 0) };
        ensure(status.level == level, || {
            format!("at {at} the level is {} ({}), not {level}", status.level, status.message)
        })?;
    }
    let Some((_, last)) = facts.played.log.diagnostics.last() else { return Ok(()) };
    let outputs = facts.played.log.statuses.iter().filter_map(|reported| reported.output.as_ref());
    let unsent = outputs.filter(|output| !output.is_sent).count();
    let reported = value(&last[0].values, "unsent");
    ensure(reported == Some(&unsent.to_string()), || {
        format!("{unsent} unsent, reported are {reported:?}")
    })?;
    let words: Vec<_> = last.iter().map(|status| (status.level, &*status.message)).collect();
    let is_well = words[0] == (0, "each message answered")
        && words[1..].iter().all(|words| *words == (0, "in time"));
    ensure(is_well, || format!("at the end they are {words:?}"))
}

/// D16: the deadlines, and who gets a request, are as they were set when the message came. What is set at that instant, on several
/// topics perhaps, may hold or not.
fn as_set(facts: &Facts<'_>) -> Result<(), String> {
    let nanos = |duration: Duration| u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
    for (t, (message, opened)) in facts.messages.iter().zip(&facts.opened).enumerate() {
        let states: Vec<_> = facts.states(facts.played.log.arrived_at[message.serial]).collect();
        let is_refused = matches!(opened.ended(), Some((_, MessageOutcome::Refused(_))));
        let of_local = states.iter().any(|state| opened.deadline == Some(nanos(state.local)));
        let is_so = |index: usize| {
            let peers = || states.iter().map(|state| state.peers[index]);
            let Some((deadline, _)) = opened.offers.get(&index) else {
                return is_refused
                    || peers().any(|it| !it.is_enabled)
                    || peers().any(|it| !it.is_there);
            };
            let own = peers().filter_map(|it| it.deadline);
            let common = states.iter().map(|state| state.deadline);
            let common = common.filter(|_| peers().any(|it| it.deadline.is_none()));
            !is_refused
                && peers().any(|it| it.is_enabled)
                && peers().any(|it| it.is_there)
                && own.chain(common).any(|set| nanos(set) == *deadline)
        };
        ensure(of_local && (1..facts.scenario.peers.len()).all(is_so), || {
            format!("{t} was {opened:?}; in force were {states:?}")
        })?;
    }
    Ok(())
}

fn name(index: usize) -> String {
    if index == LOCAL { "local".into() } else { format!("cloud{index}") }
}
