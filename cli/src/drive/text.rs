//! Lines of a trace in words, for readers who do not know the rules yet.

use fuseline_traces::{Decision, Event, Input, Line, parse};

/// Describes an input or a decision.
pub(super) fn event(event: &Event) -> String {
    match event {
        Event::Input(input) => self::input(input),
        Event::Decision(decision) => format!("→ {}", self::decision(decision)),
    }
}

/// Returns a decision as a judge writes it, in words.
fn reported(line: &str) -> String {
    match parse(line.as_bytes()) {
        Ok(Line::Event(Event::Decision(decision))) => self::decision(&decision),
        // It says that there is none.
        Ok(_) | Err(_) => "there is no further decision".to_owned(),
    }
}

/// Describes what was found and expected, with instants only if nothing else differs.
pub(super) fn both(found: &str, expected: &str) -> [String; 2] {
    let texts = [found, expected].map(reported);
    if texts[0] != texts[1] {
        return texts;
    }
    let at = |line: &str| match parse(line.as_bytes()) {
        Ok(Line::Event(Event::Decision(decision))) => format!(", at instant {}", decision.at()),
        Ok(_) | Err(_) => String::new(),
    };
    let [of_found, of_expected] = [found, expected].map(at);
    let [found, expected] = texts;
    [found + &of_found, expected + &of_expected]
}

fn input(input: &Input) -> String {
    match *input {
        Input::Open { t, deadline: None, .. } => format!("message {t} comes; local works on it"),
        Input::Open { t, deadline: Some(deadline), .. } => {
            format!("message {t} comes; local works on it for {deadline} ns at most")
        }
        Input::Offer { t, p, deadline, backlog, .. } => {
            format!("{} is offered message {t}, for {deadline} ns; {backlog} in its queue", who(p))
        }
        Input::Result { t, p, .. } => format!("the result of {} for message {t} comes", who(p)),
        Input::Fail { t, p, .. } => format!("{} fails on message {t}", who(p)),
        Input::Tick { .. } => "time passes".to_owned(),
    }
}

fn decision(decision: &Decision) -> String {
    match *decision {
        Decision::Timer { t, p: 0, .. } => {
            format!("the wait for local on message {t} ends: its deadline is over")
        }
        Decision::Timer { t, p, .. } => {
            format!("the wait for cloud {p} on message {t} ends: its deadline is over")
        }
        Decision::RefuseOpen { t, why, .. } => {
            format!("message {t} is refused ({why}): {}", why.sentence())
        }
        Decision::RefuseOffer { t, p, why, .. } => {
            format!("cloud {p} is not asked about message {t} ({why}): {}", why.sentence())
        }
        Decision::Request { t, p, due, .. } => {
            format!("cloud {p} is asked about message {t}; from instant {due} on it is too late")
        }
        Decision::Hold { t, p, .. } => {
            let who = who(p);
            format!("the result of {who} for message {t} is held: a better one may still come")
        }
        Decision::Drop { t, p, why, .. } => {
            format!(
                "what came from {} for message {t} is dropped ({why}): {}",
                who(p),
                why.sentence()
            )
        }
        Decision::Emit { t, p, .. } => {
            format!("the result of {} is forwarded as the output for message {t}", who(p))
        }
        Decision::Final { t, p, .. } => {
            format!("message {t} is done: nothing better than the result of {} will come", who(p))
        }
        Decision::Miss { t, .. } => {
            format!("message {t} is missed: no result came, and none will")
        }
        Decision::Cancel { t, p, .. } => {
            format!("the call to {} for message {t} is cancelled: it is no longer needed", who(p))
        }
    }
}

fn who(p: u64) -> String {
    if p == 0 { "local".to_owned() } else { format!("cloud {p}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisions_that_differ_in_their_instant_alone_are_reported_with_it() {
        let line = |at: u64, p: u64| format!(r#"{{"ev":"hold","at":{at},"t":1,"p":{p}}}"#);
        let [found, expected] = both(&line(7, 1), &line(8, 1));
        assert!(found.ends_with(", at instant 7") && expected.ends_with(", at instant 8"));
        let [found, expected] = both(&line(7, 1), &line(8, 2));
        assert!(!found.contains("instant") && !expected.contains("instant"), "{found} {expected}");
    }
}
