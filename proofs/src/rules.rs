//! The rules for one timestamp (F3 to F9), over four sets of sources as bits. Harnesses compare
//! `core/src/slot.rs` with them. They are written from section 3 of `SPEC.md` and share only types with the
//! core.

use crate::DropReason;
use crate::slot::{Commit, Decision, Slot};
use crate::source::{Source, Sources};

/// Four sets as bits: requested, pending, armed, cached.
pub(crate) type Bits = [u16; 4];

pub(crate) fn bits(slot: Slot) -> Bits {
    [slot.requested(), slot.pending(), slot.armed(), slot.cached()].map(Sources::bits)
}

pub(crate) fn bit(source: Source) -> u16 {
    1 << source.index()
}

/// Returns `true` if a member of the set outranks the source.
pub(crate) fn outranks(set: u16, source: Source) -> bool {
    set >> source.index() >> 1 != 0
}

/// Returns local and all clouds up to the source.
pub(crate) fn up_to(source: Source) -> u16 {
    bit(source) | (bit(source) - 1)
}

/// Returns the source whose result is sent downstream, if one is.
pub(crate) fn output(decision: Decision) -> Option<Source> {
    match decision {
        Decision::Preliminary { by, .. } | Decision::Forwarded { by, .. } => Some(by),
        Decision::Dropped(_)
        | Decision::Held
        | Decision::Waiting
        | Decision::Final { .. }
        | Decision::Missed => None,
    }
}

/// Returns the source of the result that is last when the timestamp is retired, if there is one. It
/// is sent now, or was sent before.
pub(crate) fn last_output(decision: Decision) -> Option<Source> {
    match decision {
        Decision::Final { by } | Decision::Forwarded { by, .. } => Some(by),
        Decision::Dropped(_)
        | Decision::Held
        | Decision::Waiting
        | Decision::Preliminary { .. }
        | Decision::Missed => None,
    }
}

/// Returns the reason to drop a result or a failure, if one holds (F3, F4, F9).
pub(crate) fn reason_to_drop(commit: Commit, sets: Bits, source: Source) -> Option<DropReason> {
    let ([requested, pending, _, cached], of) = (sets, bit(source));
    if commit == Commit::Progressive && outranks(cached, source) {
        Some(DropReason::Superseded)
    } else if requested & of == 0 {
        Some(DropReason::Unsolicited)
    } else if cached & of != 0 {
        Some(DropReason::Duplicate)
    } else if pending & of == 0 {
        Some(DropReason::Late)
    } else {
        None
    }
}

/// Returns the sets and the decision of a forwarding (F7).
pub(crate) fn forwarded(by: Source, pending: u16) -> (Bits, Decision) {
    ([0; 4], Decision::Forwarded { by, cancelled: Sources::from_bits(pending & !1) })
}

/// Returns the sets and the decision of an accepted result under progressive: the first row of F3 that
/// differs (F9).
pub(crate) fn sent([requested, pending, armed, _]: Bits, by: Source) -> (Bits, Decision) {
    let cancelled = Sources::from_bits(pending & up_to(by) & !bit(by) & !1);
    match pending & !up_to(by) {
        0 => ([0; 4], Decision::Forwarded { by, cancelled }),
        better => (
            [requested, better, armed & !up_to(by), bit(by)],
            Decision::Preliminary { by, cancelled },
        ),
    }
}

/// Settles, line by line as in F6, and as in F9 for progressive.
pub(crate) fn settled(commit: Commit, sets: Bits, timer: bool) -> (Bits, Decision) {
    let [_, pending, _, cached] = sets;
    let Some(best) = Sources::from_bits(cached).greatest() else {
        return if pending == 0 { ([0; 4], Decision::Missed) } else { (sets, Decision::Waiting) };
    };
    match commit {
        Commit::Progressive if pending == 0 => ([0; 4], Decision::Final { by: best }),
        Commit::Eager if timer => forwarded(best, pending),
        Commit::Eager | Commit::Patient if !outranks(pending, best) => forwarded(best, pending),
        Commit::Eager | Commit::Patient | Commit::Progressive => (sets, Decision::Waiting),
    }
}

/// Returns the sets of progressive after the inputs that lead patient to these: pending sources outrank the
/// last output, which is the best available result.
pub(crate) fn as_progressive([requested, pending, armed, cached]: Bits) -> Bits {
    match Sources::from_bits(cached).greatest() {
        Some(last) => [requested, pending & !up_to(last), armed & !up_to(last), bit(last)],
        None => [requested, pending, armed, 0],
    }
}
