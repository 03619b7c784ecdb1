//! The checks that must hold for every run, by name.

use std::collections::BTreeMap;

use fuseline_engine::Trigger;
use fuseline_ros2::in_process::DiagnosticStatus;
use fuseline_traces::nanos;

use crate::judge::account;
use crate::judge::replay::{DecidedItem, Departure};
use crate::judge::{self, Check, Finding, ensure};

use crate::simulate::nodes::facts::{Facts, value};
use crate::simulate::nodes::play::StatusReport;
use crate::simulate::nodes::scenario::{Form, name};
use crate::simulate::value::ValueLabel;

type HoldsFor = fn(&Facts<'_>) -> Result<(), String>;

/// All checks.
pub const CHECKS: &[Check<HoldsFor>] = &[
    // There are no facts about a run without end, nor about a trace that is not whole.
    Check { name: "d8_everything_ends", holds: |_| Ok(()) },
    Check { name: "d10_whole_trace", holds: |_| Ok(()) },
    Check { name: "d1_one_item", holds: one_item },
    Check { name: "d2_its_own_value", holds: its_own_value },
    Check { name: "d3_the_rules_decide", holds: the_rules_decide },
    Check { name: "d4_true_backlog", holds: true_backlog },
    Check { name: "d8_nothing_is_left", holds: nothing_is_left },
    Check { name: "d11_one_account", holds: one_account },
    Check { name: "d13_lost_words", holds: lost_words },
    Check { name: "d14_its_own_topic", holds: its_own_topic },
    Check { name: "d15_reported", holds: reported },
    Check { name: "d16_as_set", holds: as_set },
];

impl Facts<'_> {
    /// Returns the checks that do not hold.
    pub(crate) fn findings(&self) -> Vec<Finding> {
        judge::findings(CHECKS, |holds| holds(self))
    }
}

/// Checks that each message has exactly one last status. An input that is not a message must have
/// the key of a remembered message (D1, D2).
fn one_item(facts: &Facts<'_>) -> Result<(), String> {
    let Facts { played, messages, replay, .. } = facts;
    let opened = &replay.opened;
    let last = played.log.statuses.iter().filter(|it| !it.status.message.ends_with("preliminary"));
    let mut reported: Vec<_> = last.filter_map(StatusReport::timestamp).collect();
    reported.sort_unstable();
    let all: Vec<_> = (0..opened.len() as u64).collect();
    ensure(reported == all, || {
        format!("of {} messages there are statuses {reported:?}", all.len())
    })?;
    ensure(messages.len() == opened.len(), || {
        let (t, at) = (messages.len(), opened[messages.len()].at);
        format!("no input came at the instant {at} of the message {t}")
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
        // The scenarios have fewer messages than the node remembers, but the node does not remember
        // refused messages.
        ensure(!facts.has_remembered(message.serial, |_| false), || {
            format!("input {} was taken in though its key is a message's", message.serial)
        })?;
    }
    Ok(())
}

/// Checks that outputs and hints are results of their own messages and sources (D2).
fn its_own_value(facts: &Facts<'_>) -> Result<(), String> {
    let is_of = |value: ValueLabel, t: usize, index: usize| {
        let serial = facts.messages.get(t).map(|message| message.serial);
        let key = serial.map(|serial| facts.inputs[serial].key);
        // If two inputs have the same key at the same instant, one of them may have come just
        // before an activation.
        let is_same = serial.is_some_and(|serial| facts.is_doubled_at_once(serial));
        Some(value.t) == key
            && usize::from(value.p) == index
            && facts.inputs.get(value.serial).map(|input| input.key) == key
            && (is_same || Some(value.serial) == serial)
    };
    for (message, opened) in facts.pairs() {
        let t = usize::try_from(opened.t).unwrap_or(usize::MAX);
        for (item, reported) in facts.items(opened).zip(&message.reported) {
            let (Departure::Preliminary(p) | Departure::Forwarded(p, _) | Departure::Final(p)) =
                item.departure
            else {
                continue;
            };
            let output = reported.output.as_ref();
            let value = output.and_then(|output| output.value.as_ref().ok()).copied();
            ensure(value.is_some_and(|value| is_of(value, t, p.into())), || {
                format!("{t} was forwarded from {p} as {output:?}")
            })?;
        }
    }
    // Late results are published in their order, for the peers that have a topic for them (F3).
    let hints = |index: usize| facts.played.log.hints.iter().filter(move |it| it.0 == index);
    for (index, peer) in facts.scenario.peers.iter().enumerate() {
        let late: Vec<_> = facts.late(index).filter(|_| peer.hints).map(|it| it.t).collect();
        let same = hints(index).count() == late.len()
            && hints(index).zip(&late).all(|((_, value), t)| {
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

/// Checks that the trace conforms, and that the node publishes the trace's decisions when they are
/// made (D3).
fn the_rules_decide(facts: &Facts<'_>) -> Result<(), String> {
    if let Some(verdict) = &facts.replay.verdict {
        ensure(verdict.violations.is_empty(), || verdict.to_string())?;
    }
    for (message, opened) in facts.pairs() {
        let items: Vec<_> = facts.items(opened).collect();
        let is_last = items.last().is_some_and(|item| Some(item.departure) == opened.end);
        ensure(is_last && items.len() == message.reported.len(), || {
            format!("{} left as {items:?}, reported was {:?}", opened.t, message.reported)
        })?;
        for (revision, (item, reported)) in items.iter().zip(&message.reported).enumerate() {
            ensure(is_decided(revision, item, reported), || {
                format!("{} left as {item:?}, reported was {reported:?}", opened.t)
            })?;
        }
    }
    ensure(!facts.played.log.is_disobedient, || "an order of the manager failed".to_owned())
}

/// Returns `true` if a status, with its output on the right topic, is what the trace decided.
fn is_decided(revision: usize, item: &DecidedItem, reported: &StatusReport) -> bool {
    let (source, rule, is_revision) = match item.departure {
        Departure::Preliminary(p) => (Some(name(p.into())), Some("F9"), Some(true)),
        Departure::Forwarded(p, trigger) => {
            let rule = match trigger {
                Trigger::Arrival => "F3",
                Trigger::Failure => "F4",
                Trigger::Timer => "F5",
            };
            (Some(name(p.into())), Some(rule), Some(false))
        }
        Departure::Final(p) => (Some(name(p.into())), Some("F9"), Some(false)),
        Departure::Missed | Departure::Refused(_) => (None, None, None),
    };
    let words = match item.departure {
        Departure::Preliminary(p) => format!("{}, preliminary", name(p.into())),
        Departure::Forwarded(..) => reported.status.message.clone(),
        Departure::Final(p) => format!("{}, final", name(p.into())),
        Departure::Missed => "missed".to_owned(),
        Departure::Refused(why) => format!("refused: {why}"),
    };
    reported.at == item.at
        && reported.value("source").map(str::to_owned) == source
        && reported.value("rule") == rule
        && reported.value("revision") == Some(&*revision.to_string())
        && reported.output.as_ref().map(|output| output.is_revision) == is_revision
        && reported.status.message == words
}

/// Checks that the backlog of an offer is the number of requests that wait for its cloud (D4).
fn true_backlog(facts: &Facts<'_>) -> Result<(), String> {
    facts.replay.wrong_backlogs.first().map_or(Ok(()), |wrong| Err(wrong.clone()))
}

/// Checks that no message and no result is kept (D8).
fn nothing_is_left(facts: &Facts<'_>) -> Result<(), String> {
    let held = facts.played.held;
    ensure(held == 0, || format!("{held} messages and results are still held"))
}

/// Checks that the tally has the counts of the trace, and the bytes that were sent (D11).
fn one_account(facts: &Facts<'_>) -> Result<(), String> {
    account::agrees(&facts.replay, &facts.played.tally, |p| {
        let index = usize::from(p);
        let is_called = facts.scenario.peers[index].is_called;
        let sent = facts.requested(index).filter(|_| !is_called);
        sent.map(|requested| requested.bytes).sum()
    })
}

/// Checks that nothing is sent to a peer that is seen to be gone. In the calm, each message must go
/// to local and to each cloud at once, and the best source must answer it (D13).
fn lost_words(facts: &Facts<'_>) -> Result<(), String> {
    let calm = facts.scenario.calm();
    let best = facts.scenario.peers.len() - 1;
    for index in 0..=best {
        let is_there = |at| facts.states(at).any(|state| state.peers[index].is_there);
        let astray = facts.requested(index).find(|requested| !is_there(requested.at));
        ensure(astray.is_none(), || format!("{index} was gone and got {astray:?}"))?;
    }
    let mut count = 0;
    for (message, opened) in facts.pairs() {
        let (t, input) = (opened.t, &facts.inputs[message.serial]);
        if input.at < calm {
            continue;
        }
        count += 1;
        let is_best = matches!(opened.end, Some(Departure::Forwarded(p, Trigger::Arrival)) if usize::from(p) == best);
        ensure(is_best, || format!("{t} of the calm left so: {:?}", opened.end))?;
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

/// Checks that a sample that is neither a message nor a result is counted under its own kind (D14).
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
        // The node may or may not look at an input that comes at the instant of an activation.
        let (mut least, mut most) = (0, 0);
        for serial in facts.rejected.iter().filter(|serial| facts.inputs[**serial].form == form) {
            let at = facts.played.log.arrived_at[*serial];
            // If the node did not look at a message's twin, it may accept the message, because the
            // stamp is new to it.
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

/// Checks that each period has the level of the events in it, and that all is well at the end
/// (D15).
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
    let is_well = words[0] == (0, "each message has its output")
        && words[1..].iter().all(|words| *words == (0, "in time"));
    ensure(is_well, || format!("at the end they are {words:?}"))
}

/// Checks that the deadlines and the recipients of requests are as they were set when the message
/// came. A setting of the same instant may or may not apply, because it may come on another topic
/// (D16).
fn as_set(facts: &Facts<'_>) -> Result<(), String> {
    for (message, opened) in facts.pairs() {
        let states: Vec<_> = facts.states(facts.played.log.arrived_at[message.serial]).collect();
        let is_refused = matches!(opened.end, Some(Departure::Refused(_)));
        let of_local = states.iter().any(|state| opened.deadline == Some(nanos(state.local)));
        let is_so = |index: usize| {
            let peers = || states.iter().map(|state| state.peers[index]);
            let Some(offer) = facts.offer(opened, index) else {
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
                && own.chain(common).any(|set| nanos(set) == offer.deadline)
        };
        ensure(of_local && (1..facts.scenario.peers.len()).all(is_so), || {
            format!("{} does not have what was in force: {states:?}", opened.t)
        })?;
    }
    Ok(())
}
