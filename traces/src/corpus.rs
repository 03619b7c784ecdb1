//! Conforming traces, one for each case of the rules.
//!
//! They are part of the crate, so that a command can play them to another implementation. Each
//! states its case in its name and in its header's `x`. The other folders have a sidecar beside
//! each trace, which states how the trace is judged and what is found:
//!
//! - `corpus/bad`: traces that break a rule.
//! - `corpus/options`: traces that conform unless the run is known to have ended or its period is
//!   known.
//! - `corpus/annotated`: traces with keys that no rule of the machine reads, some of them only in
//!   observed traces.
//! - `corpus/observed`: observed traces under the progressive rule, and of the window.
//! - `corpus/doubts`: traces that break nothing but leave a judge in doubt.

/// A conforming trace.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Example {
    /// The trace's name: the rule, then what happens.
    pub name: &'static str,
    /// The trace as JSON Lines.
    pub trace: &'static str,
}

/// Lists files of the corpus.
macro_rules! cases {
    ($($name:literal,)+) => {
        &[$(Example {
            name: $name,
            trace: include_str!(concat!("../corpus/", $name, ".jsonl")),
        }),+]
    };
}

/// All examples, by name.
pub const CASES: &[Example] = cases![
    "f0-clock-at-its-end-stays-there",
    "f0-clock-going-back-counts-as-greatest",
    "f0-due-instant-saturates",
    "f0-early-stamp-after-the-clock-passed",
    "f0-inputs-at-one-instant",
    "f0-what-is-due-comes-before-the-input",
    "f1-deadline-is-armed",
    "f1-greatest-timestamp-opens-once",
    "f1-open-refused-deadline",
    "f1-open-refused-first-reason",
    "f1-open-refused-full",
    "f1-open-refused-order",
    "f1-refused-open-changes-nothing",
    "f1-refused-open-may-come-again",
    "f1-room-made-at-the-due-instant",
    "f1-timestamps-may-skip",
    "f1-window-counts-open-timestamps",
    "f2-offer-admitted",
    "f2-offer-outranking-what-is-held",
    "f2-offer-refused-closed",
    "f2-offer-refused-deadline",
    "f2-offer-refused-duplicate",
    "f2-offer-refused-first-reason",
    "f2-offer-refused-outranked",
    "f2-offer-refused-queue",
    "f2-offer-refused-unknown",
    "f2g-each-cloud-has-its-gate",
    "f2g-gate-opens-at-resume",
    "f2g-gate-outlives-the-timestamp",
    "f2g-gate-shuts-at-limit",
    "f2g-refused-offer-does-not-ask-the-gate",
    "f2g-resume-defaults-to-limit-less-one",
    "f3-clouds-in-any-order",
    "f3-dropped-duplicate",
    "f3-dropped-first-reason",
    "f3-dropped-superseded",
    "f3-dropped-superseded-though-late",
    "f3-dropped-unknown",
    "f3-dropped-unsolicited",
    "f3-forwarded-at-once",
    "f3-held-local-disarms-its-deadline-eager",
    "f3-held-local-disarms-its-deadline-patient",
    "f3-held-result-and-its-timer-eager",
    "f3-held-result-and-its-timer-patient",
    "f3-held-while-something-outranks-it",
    "f3-highest-is-forwarded-at-once",
    "f3-last-instant-before-due",
    "f3-late-after-due",
    "f3-late-after-failure",
    "f3-late-at-due",
    "f3-late-local",
    "f4-dropped-duplicate",
    "f4-dropped-late",
    "f4-dropped-superseded",
    "f4-dropped-unknown",
    "f4-dropped-unsolicited",
    "f4-failure-disarms-its-timer",
    "f4-failure-is-no-timer",
    "f4-failure-of-local",
    "f4-failure-releases-what-is-held",
    "f4-failure-waits-for-what-outranks",
    "f5-coarse-tick-decides-what-fine-ticks-decide-eager",
    "f5-coarse-tick-decides-what-fine-ticks-decide-patient",
    "f5-due-order-then-timestamp",
    "f5-local-and-cloud-at-one-due-eager",
    "f5-local-and-cloud-at-one-due-patient",
    "f5-same-due-fires-together",
    "f5-timer-fires-at-an-open",
    "f5-timer-not-before-due",
    "f5-two-clouds-due-at-once",
    "f6-best-in-hand-goes-eager",
    "f6-best-in-hand-goes-patient",
    "f6-firing-with-nothing-in-hand-hurries-nothing",
    "f6-later-request-prolongs-the-wait-eager",
    "f6-later-request-prolongs-the-wait-patient",
    "f6-lower-timer-while-higher-pends-eager",
    "f6-lower-timer-while-higher-pends-patient",
    "f6-missed-at-the-last-timer",
    "f6-missed-when-local-is-too-late",
    "f6-timer-of-local-commits-nothing-eager",
    "f6-timer-of-local-commits-nothing-patient",
    "f6-timer-of-the-highest",
    "f6-timer-with-nothing-in-hand",
    "f7-cancelled-by-an-eager-commit-eager",
    "f7-cancelled-by-an-eager-commit-patient",
    "f7-closed-requests-are-not-cancelled",
    "f7-held-results-are-discarded",
    "f7-local-is-never-cancelled",
    "f7-outputs-as-decided",
    "f7-pending-clouds-are-cancelled",
    "f8-every-input-has-an-outcome",
    "f9-better-result-is-sent-at-once",
    "f9-final-at-the-last-failure",
    "f9-final-at-the-last-timer",
    "f9-later-request-may-improve",
    "f9-local-alone-is-final",
    "f9-missed-without-output",
    "f9-offer-outranked-by-an-output",
    "f9-output-ends-the-deadline-of-local",
    "f9-outranked-is-superseded",
    "f9-timer-together-with-local",
    "f9-timestamps-apart",
    "keys-in-any-order",
];
