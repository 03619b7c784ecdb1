//! A run as bytes, in a form that suits a fuzzer: any bytes are a run, and small changes of them
//! make a similar run.

use fuseline_testkit::Run;
use fuseline_traces::{Cloud, Commit, Header, Input};

/// Eight bytes follow, the least first.
const LONG: u8 = u8::MAX;
/// Means the same as [`LONG`] in a byte that is a signed difference.
const FAR: i8 = i8::MIN;
/// Set in a run's first byte under patient.
const PATIENT: u8 = 16;
/// Set in a run's first byte under progressive, whatever the bit of patient.
const PROGRESSIVE: u8 = 32;
/// The bits of a run's first byte that count the clouds.
const CLOUDS: u8 = 15;
/// The greatest window.
const WINDOW: u16 = 1024;

/// Bytes that are read from the front. Zeros follow their end.
pub(super) struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Reads a run to the end of the bytes.
    pub(super) fn run(mut self) -> Run {
        let header = self.header();
        let (mut at, mut newest) = (0, 0);
        let mut inputs = Vec::new();
        while !self.0.is_empty() {
            let input = self.input(at, newest, &header.clouds);
            at = input.at();
            if let Input::Open { t, .. } = input {
                newest = t;
            }
            inputs.push(input);
        }
        Run { header, inputs }
    }

    fn header(&mut self) -> Header {
        let first = self.byte();
        let commit = match first & (PATIENT | PROGRESSIVE) {
            0 => Commit::Eager,
            PATIENT => Commit::Patient,
            _ => Commit::Progressive,
        };
        let window = self.short() % WINDOW + 1;
        let mut clouds: Vec<Cloud> = Vec::new();
        for _ in 0..first & CLOUDS {
            let mut p = self.short();
            // A second cloud of the same priority would be refused, so the next free priority is
            // used (A10).
            while p == 0 || clouds.iter().any(|cloud| cloud.p == p) {
                p = p.wrapping_add(1);
            }
            let limit = self.number().max(1);
            let resume = self.number().min(limit - 1);
            clouds.push(Cloud { p, name: None, limit, resume });
        }
        Header { operator: None, window, commit, clouds }
    }

    /// Reads an input, which is encoded relative to the previous one and to the timestamp of the
    /// last open.
    fn input(&mut self, at: u64, newest: u64, clouds: &[Cloud]) -> Input {
        let kind = self.byte() % 6;
        let at = self.near(at);
        if kind == 5 {
            return Input::Tick { at };
        }
        let t = self.near(newest);
        match kind {
            0 => Input::Open { at, t, deadline: None },
            1 => Input::Open { at, t, deadline: Some(self.number()) },
            2 => Input::Result { at, t, p: self.source(clouds) },
            3 => Input::Fail { at, t, p: self.source(clouds) },
            _ => {
                let p = self.source(clouds);
                Input::Offer { at, t, p, deadline: self.number(), backlog: self.number() }
            }
        }
    }

    /// Reads a source: 0 is local, then the clouds follow in their order, then other priorities.
    fn source(&mut self, clouds: &[Cloud]) -> u64 {
        match self.byte() {
            0 => 0,
            LONG => self.long(),
            index => {
                let cloud = clouds.get(usize::from(index) - 1);
                cloud.map_or_else(|| index.into(), |cloud| cloud.p.into())
            }
        }
    }

    /// Reads a small number, or any number.
    pub(super) fn number(&mut self) -> u64 {
        match self.byte() {
            LONG => self.long(),
            small => small.into(),
        }
    }

    /// Reads a number close to another, or any number.
    pub(super) fn near(&mut self, base: u64) -> u64 {
        match self.byte().cast_signed() {
            FAR => self.long(),
            difference => base.saturating_add_signed(difference.into()),
        }
    }

    pub(super) fn short(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    fn long(&mut self) -> u64 {
        u64::from_le_bytes(std::array::from_fn(|_| self.byte()))
    }

    pub(super) fn byte(&mut self) -> u8 {
        let Some((byte, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *byte
    }
}

/// Appends the bytes that [`Bytes::run`] reads as this run.
pub(super) fn write(run: &Run, out: &mut Vec<u8>) {
    let Header { window, commit, clouds, .. } = &run.header;
    let rule = match commit {
        Commit::Eager => 0,
        Commit::Patient => PATIENT,
        Commit::Progressive => PROGRESSIVE,
    };
    // A header has up to 15 clouds.
    out.push(rule | u8::try_from(clouds.len()).unwrap_or(CLOUDS));
    out.extend(window.saturating_sub(1).to_le_bytes());
    for cloud in clouds {
        out.extend(cloud.p.to_le_bytes());
        number(cloud.limit, out);
        number(cloud.resume, out);
    }
    let (mut at, mut newest) = (0, 0);
    for input in &run.inputs {
        out.push(kind(input));
        near(input.at(), at, out);
        at = input.at();
        if let Some(t) = input.t() {
            near(t, newest, out);
        }
        match *input {
            Input::Open { t, deadline, .. } => {
                newest = t;
                if let Some(deadline) = deadline {
                    number(deadline, out);
                }
            }
            Input::Result { p, .. } | Input::Fail { p, .. } => source(p, clouds, out),
            Input::Offer { p, deadline, backlog, .. } => {
                source(p, clouds, out);
                number(deadline, out);
                number(backlog, out);
            }
            Input::Tick { .. } => {}
        }
    }
}

const fn kind(input: &Input) -> u8 {
    match input {
        Input::Open { deadline: None, .. } => 0,
        Input::Open { deadline: Some(_), .. } => 1,
        Input::Result { .. } => 2,
        Input::Fail { .. } => 3,
        Input::Offer { .. } => 4,
        Input::Tick { .. } => 5,
    }
}

fn source(p: u64, clouds: &[Cloud], out: &mut Vec<u8>) {
    let index = (1..).zip(clouds).find(|(_, cloud)| u64::from(cloud.p) == p);
    match index {
        Some((index, _)) => out.push(index),
        None if p == 0 => out.push(0),
        None => long(p, out),
    }
}

fn number(value: u64, out: &mut Vec<u8>) {
    match u8::try_from(value) {
        Ok(small) if small < LONG => out.push(small),
        _ => long(value, out),
    }
}

pub(super) fn near(value: u64, base: u64, out: &mut Vec<u8>) {
    let difference = value.wrapping_sub(base).cast_signed();
    match i8::try_from(difference) {
        Ok(small) if small > FAR && base.checked_add_signed(difference) == Some(value) => {
            out.push(small.cast_unsigned());
        }
        _ => {
            out.push(FAR.cast_unsigned());
            out.extend(value.to_le_bytes());
        }
    }
}

fn long(value: u64, out: &mut Vec<u8>) {
    out.push(LONG);
    out.extend(value.to_le_bytes());
}
