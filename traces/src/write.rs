//! Writes lines: keys in one order, without white space.

use std::fmt;

use crate::annotations::{Annotations, HeaderAnnotations, Origin};
use crate::event::{Cloud, Decision, Event, Header, Input, Line, VERSION};

impl Line {
    /// Appends the line, without its `\n`.
    pub fn write(&self, out: &mut Vec<u8>) {
        match self {
            Self::Header(header) => header.write(out),
            Self::Event(event) => event.write(out),
        }
    }
}

impl Event {
    /// Appends the line, without its `\n`.
    pub fn write(&self, out: &mut Vec<u8>) {
        match self {
            Self::Input(input) => input.write(out),
            Self::Decision(decision) => decision.write(out),
        }
    }

    /// Appends the line with further keys, without its `\n`. It writes any keys, even those that a
    /// reader refuses for this event.
    pub fn write_annotated(&self, annotations: &Annotations, out: &mut Vec<u8>) {
        self.write(out);
        if annotations.is_empty() {
            return;
        }
        // Removes the brace that closes the line.
        out.pop();
        let Annotations { of, meant_for, attempt, within, age, origin, missing } = annotations;
        let attempt = attempt.map(u64::from);
        let numbers = [("of", *of), ("for", *meant_for), ("try", attempt)];
        for (key, value) in numbers.into_iter().chain([("within", *within), ("age", *age)]) {
            further(out, key, value);
        }
        if let Some(Origin { stream, seq }) = origin {
            text(out, ",\"origin\":", stream);
            further(out, "seq", *seq);
        }
        for (index, input) in missing.iter().enumerate() {
            text(out, if index == 0 { ",\"missing\":[" } else { "," }, input);
        }
        if !missing.is_empty() {
            out.push(b']');
        }
        out.push(b'}');
    }

    /// Returns the line with further keys, as it is written.
    #[must_use]
    pub fn annotated(&self, annotations: &Annotations) -> String {
        let mut out = Vec::with_capacity(96);
        self.write_annotated(annotations, &mut out);
        String::from_utf8_lossy(&out).into_owned()
    }
}

impl Header {
    /// Appends the line, without its `\n`. `resume` is written only if it is not `limit − 1`.
    pub fn write(&self, out: &mut Vec<u8>) {
        self.write_annotated(&HeaderAnnotations::default(), out);
    }

    /// Appends the line with further keys, without its `\n`.
    pub fn write_annotated(&self, annotations: &HeaderAnnotations, out: &mut Vec<u8>) {
        out.extend_from_slice(b"{");
        number(out, "fuseline", VERSION);
        if let Some(operator) = &self.operator {
            text(out, ",\"operator\":", operator);
        }
        out.push(b',');
        number(out, "window", self.window.into());
        text(out, ",\"commit\":", self.commit.as_str());
        if annotations.without_local {
            text(out, ",\"local\":", "none");
        }
        out.extend_from_slice(b",\"clouds\":[");
        for (place, cloud) in self.clouds.iter().enumerate() {
            if place > 0 {
                out.push(b',');
            }
            let max_age = annotations.max_ages.get(&cloud.p.into());
            cloud.write(max_age.copied(), out);
        }
        out.extend_from_slice(b"]}");
    }
}

impl Cloud {
    fn write(&self, max_age: Option<u64>, out: &mut Vec<u8>) {
        out.push(b'{');
        number(out, "p", self.p.into());
        if let Some(name) = &self.name {
            text(out, ",\"name\":", name);
        }
        out.push(b',');
        number(out, "limit", self.limit);
        if self.limit.checked_sub(1) != Some(self.resume) {
            out.push(b',');
            number(out, "resume", self.resume);
        }
        further(out, "max_age", max_age);
        out.push(b'}');
    }
}

impl Input {
    /// Appends the line, without its `\n`.
    pub fn write(&self, out: &mut Vec<u8>) {
        match *self {
            Self::Open { at, t, deadline: None } => event(out, "open", at, &[("t", t)]),
            Self::Open { at, t, deadline: Some(deadline) } => {
                event(out, "open", at, &[("t", t), ("deadline", deadline)]);
            }
            Self::Offer { at, t, p, deadline, backlog } => {
                let more = [("t", t), ("p", p), ("deadline", deadline), ("backlog", backlog)];
                event(out, "offer", at, &more);
            }
            Self::Result { at, t, p } => event(out, "result", at, &[("t", t), ("p", p)]),
            Self::Fail { at, t, p } => event(out, "fail", at, &[("t", t), ("p", p)]),
            Self::Tick { at } => event(out, "tick", at, &[]),
        }
        out.push(b'}');
    }
}

impl Decision {
    /// Appends the line, without its `\n`.
    pub fn write(&self, out: &mut Vec<u8>) {
        match *self {
            Self::Timer { at, t, p } => event(out, "timer", at, &[("t", t), ("p", p)]),
            Self::RefuseOpen { at, t, why } => {
                event(out, "refuse", at, &[("t", t)]);
                text(out, ",\"why\":", why.as_str());
            }
            Self::RefuseOffer { at, t, p, why } => {
                event(out, "refuse", at, &[("t", t), ("p", p)]);
                text(out, ",\"why\":", why.as_str());
            }
            Self::Request { at, t, p, due } => {
                event(out, "request", at, &[("t", t), ("p", p), ("due", due)]);
            }
            Self::Hold { at, t, p } => event(out, "hold", at, &[("t", t), ("p", p)]),
            Self::Drop { at, t, p, why } => {
                event(out, "drop", at, &[("t", t), ("p", p)]);
                text(out, ",\"why\":", why.as_str());
            }
            Self::Emit { at, t, p } => event(out, "emit", at, &[("t", t), ("p", p)]),
            Self::Final { at, t, p } => event(out, "final", at, &[("t", t), ("p", p)]),
            Self::Miss { at, t } => event(out, "miss", at, &[("t", t)]),
            Self::Cancel { at, t, p } => event(out, "cancel", at, &[("t", t), ("p", p)]),
        }
        out.push(b'}');
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, |out| self.write(out))
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, |out| self.write(out))
    }
}

impl fmt::Display for Header {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, |out| self.write(out))
    }
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, |out| self.write(out))
    }
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show(f, |out| self.write(out))
    }
}

/// Writes an event up to its last number, without the closing brace.
fn event(out: &mut Vec<u8>, name: &str, at: u64, more: &[(&str, u64)]) {
    out.extend_from_slice(b"{\"ev\":\"");
    out.extend_from_slice(name.as_bytes());
    out.extend_from_slice(b"\",");
    number(out, "at", at);
    for (key, value) in more {
        out.push(b',');
        number(out, key, *value);
    }
}

fn number(out: &mut Vec<u8>, key: &str, value: u64) {
    out.push(b'"');
    out.extend_from_slice(key.as_bytes());
    out.extend_from_slice(b"\":");
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

/// Writes one more number, if there is one.
fn further(out: &mut Vec<u8>, key: &str, value: Option<u64>) {
    if let Some(value) = value {
        out.push(b',');
        number(out, key, value);
    }
}

/// Writes a string after `lead`, which is its key with everything around it.
fn text(out: &mut Vec<u8>, lead: &str, value: &str) {
    out.extend_from_slice(lead.as_bytes());
    // Writing a string to memory cannot fail.
    let _ = serde_json::to_writer(&mut *out, value);
}

/// Shows a line as it is written.
fn show(f: &mut fmt::Formatter<'_>, write: impl FnOnce(&mut Vec<u8>)) -> fmt::Result {
    let mut out = Vec::with_capacity(96);
    write(&mut out);
    f.write_str(&String::from_utf8_lossy(&out))
}
