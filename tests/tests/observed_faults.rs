//! Records operators with faults that no strict trace shows, at a message drawn by seed. The
//! observed judge finds each.

use std::fmt::Write as _;

use fuseline_testkit::Rng;
use fuseline_traces::observed::{Judge, Slack};
use fuseline_traces::{Events, Rule, Verdict};

const HEADER: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9}]}"#;
const SLACK: Slack = Slack { tolerance: ms(1), lateness: ms(5) };
/// In ms, as everything that is drawn here.
const PERIOD: u64 = 100;
const DEADLINE: u64 = 80;
const MESSAGES: u64 = 20;

/// The fault of an operator.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum OperatorFault {
    None,
    /// It hangs before its output and writes nothing more.
    Hangs,
    /// It does not open three messages.
    StopsOpening,
    /// It sends the result of the previous message.
    SendsAnothersValue,
    /// It sends the result of each attempt.
    SendsEachAttempt,
    /// It sends a result after the message's own deadline.
    MissesItsDeadline,
}

const fn ms(ms: u64) -> u64 {
    ms * 1_000_000
}

/// Returns a recording of an operator with a fault at one message. Its cloud returns a result, with
/// one attempt or two, or does not.
fn recording(seed: u64, fault: OperatorFault, wrong: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let mut trace = format!("{HEADER}\n");
    for t in 0..MESSAGES {
        let errs = |it| it == fault && t == wrong;
        let left_out = fault == OperatorFault::StopsOpening && (wrong..wrong + 3).contains(&t);
        let begin = ms(1000 + t * PERIOD);
        // Each message draws the same amount, whatever is wrong.
        let (answers, twice) = (rng.u32(0..4) > 0, rng.u32(0..2) > 0);
        let needs_reply = fault != OperatorFault::Hangs && t == wrong;
        let (answers, twice) = (answers || needs_reply, twice || needs_reply);
        let answer = begin + ms(rng.u64(40..70));
        if left_out {
            continue;
        }
        let within = ms(if errs(OperatorFault::MissesItsDeadline) { 30 } else { 95 });
        let of = if errs(OperatorFault::SendsAnothersValue) { t - 1 } else { t };
        let due = begin + ms(DEADLINE);
        let mut line = |text: std::fmt::Arguments<'_>| writeln!(trace, "{{{text}}}").unwrap();
        line(format_args!(r#""ev":"open","at":{begin},"t":{t},"within":{within}"#));
        line(format_args!(r#""ev":"request","at":{begin},"t":{t},"p":1,"due":{due},"try":0"#));
        let (local, again) = (begin + ms(10), begin + ms(20));
        line(format_args!(r#""ev":"result","at":{local},"t":{t},"p":0"#));
        if twice {
            line(format_args!(r#""ev":"request","at":{again},"t":{t},"p":1,"due":{due},"try":1"#));
        }
        if answers {
            line(format_args!(r#""ev":"result","at":{answer},"t":{t},"p":1,"try":0,"of":{of}"#));
        }
        if errs(OperatorFault::Hangs) {
            break;
        }
        if answers {
            line(format_args!(r#""ev":"emit","at":{answer},"t":{t},"p":1,"of":{of}"#));
            if twice {
                let at = answer + ms(3);
                line(format_args!(r#""ev":"result","at":{at},"t":{t},"p":1,"try":1,"of":{t}"#));
                if errs(OperatorFault::SendsEachAttempt) {
                    line(format_args!(r#""ev":"emit","at":{at},"t":{t},"p":1,"of":{t}"#));
                }
            }
        } else {
            line(format_args!(r#""ev":"emit","at":{due},"t":{t},"p":0"#));
        }
    }
    trace
}

fn judged(trace: &str, has_ended: bool) -> Verdict {
    let mut reader = Events::observed("a recording", trace.as_bytes()).unwrap();
    let mut judge = Judge::new("a recording", reader.header(), SLACK)
        .with_header_annotations(reader.header_annotations());
    if has_ended {
        judge = judge.with_period(ms(PERIOD));
    }
    while let Some(event) = reader.next_event().unwrap() {
        judge.annotated_line(reader.line(), &event, reader.annotations()).unwrap();
    }
    if has_ended { judge.finish_ended() } else { judge.finish() }
}

#[test]
fn what_no_strict_trace_shows_is_found_at_its_message() {
    for seed in 0..200 {
        let wrong = 3 + seed % 12;
        let honest = recording(seed, OperatorFault::None, wrong);
        let verdict = judged(&honest, false);
        assert!(
            verdict.violations.is_empty() && verdict.judged == MESSAGES,
            "{seed}: {verdict:?}\n{honest}"
        );
        for (fault, rule) in [
            (OperatorFault::StopsOpening, Some(Rule::J1)),
            (OperatorFault::SendsAnothersValue, Some(Rule::D2)),
            (OperatorFault::SendsEachAttempt, Some(Rule::P1)),
            (OperatorFault::MissesItsDeadline, Some(Rule::J2)),
            // The rule depends on what came before: prompt, best available, or local floor.
            (OperatorFault::Hangs, None),
        ] {
            let trace = recording(seed, fault, wrong);
            let has_ended = matches!(fault, OperatorFault::StopsOpening | OperatorFault::Hangs);
            let verdict = judged(&trace, has_ended);
            let first = verdict.violations.first();
            let after = if fault == OperatorFault::StopsOpening { wrong + 3 } else { wrong };
            let is_found = first
                .is_some_and(|it| it.t == Some(after) && rule.is_none_or(|rule| rule == it.rule));
            assert!(is_found, "{seed} {fault:?} at {wrong}: {verdict:?}\n{trace}");
        }
        // A judge that does not know that the run is over cannot know that the operator hangs.
        assert!(judged(&recording(seed, OperatorFault::Hangs, wrong), false).violations.is_empty());
    }
}
