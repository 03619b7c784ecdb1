//! The strict parser of one line. An unknown or missing key, or a number out of range, is an error
//! with its column.
//!
//! [`Events`](crate::Events) checks the order of lines.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::Arc;

use crate::annotations::{Annotations, HeaderAnnotations, Origin};
use crate::canonical::{self, CanonicalLine, StampBefore};
use crate::event::{Cloud, Commit, Decision, Event, Header, Input, Line, VERSION};
use crate::reason::{DropReason, OfferRefusal, OpenRefusal};
use crate::scan::Scan;
use crate::word::{Key, Keys, LineKind};

/// The greatest number of clouds in a header.
const CLOUDS: usize = 15;
/// The greatest window of a header.
const WINDOW: u64 = 1024;

/// The most frequent keys, with everything that the writer puts around them.
const USUAL: [(&[u8], Key); 4] =
    [(b"\"at\":", Key::At), (b"\"t\":", Key::T), (b"\"p\":", Key::P), (b"\"ev\":", Key::Ev)];

/// The form of a trace.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Form {
    Strict,
    /// An observed trace. A request has exactly one of `due` and `deadline`, which counts from its
    /// own `at`. Attempts have numbers.
    Observed,
    /// An observed trace of an operator without local.
    WithoutLocal,
}

/// The keys of a line that the machine's rules do not read.
#[derive(Default, Debug)]
pub(crate) struct LineAnnotations {
    pub(crate) event: Annotations,
    pub(crate) header: HeaderAnnotations,
}

/// The keys that become an event's [`Annotations`].
const ANNOTATIONS: Keys = Keys::of(&[
    Key::Of,
    Key::For,
    Key::Try,
    Key::Within,
    Key::Age,
    Key::Origin,
    Key::Seq,
    Key::Missing,
]);

/// A fault in a line, with its place.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("column {column}: {message}")]
pub struct ParseError {
    /// The byte of the line, counted from 1, at which the fault is.
    pub column: u64,
    /// A description of the fault and of what would be right, without a full stop.
    pub message: String,
}

/// Reads one line of a trace, given without its `\n`.
///
/// This function accepts lines that a whole file may not contain, such as a second header;
/// [`Events`](crate::Events) refuses those.
///
/// # Errors
/// Returns a [`ParseError`] with its column for whatever the format does not allow.
pub fn parse(line: &[u8]) -> Result<Line, ParseError> {
    Ok(parse_annotated(line)?.0)
}

/// Parses a line like [`parse`], and returns its further keys too.
///
/// # Errors
/// Returns a [`ParseError`] with its column for whatever the format does not allow.
pub fn parse_annotated(line: &[u8]) -> Result<(Line, Annotations), ParseError> {
    let mut annotations = LineAnnotations::default();
    let read = match parse_canonical(line, Form::Strict, &mut StampBefore::default()) {
        Some(read) => Line::Event(annotations.take(&read)),
        None => parse_as(line, Form::Strict, &mut annotations)?,
    };
    Ok((read, annotations.event))
}

/// Reads one event of an observed trace, given without its `\n`, with its further keys.
///
/// A request may have a deadline instead of its due instant; the event then has the due instant.
///
/// # Errors
/// Returns a [`ParseError`] with its column for whatever the format does not allow.
pub fn observed_line(line: &[u8]) -> Result<(Event, Annotations), ParseError> {
    let mut annotations = LineAnnotations::default();
    match parse_as(line, Form::Observed, &mut annotations)? {
        Line::Event(event) => Ok((event, annotations.event)),
        Line::Header(_) => {
            Err(ParseError::at(0, "this line is a header, but an event is expected"))
        }
    }
}

/// Reads one event in one pass if it is canonical. Returns `None` for any other line.
pub(crate) fn parse_canonical(
    line: &[u8],
    form: Form,
    before: &mut StampBefore,
) -> Option<CanonicalLine> {
    canonical::event(line, form, before).filter(|read| read.len == line.len())
}

impl LineAnnotations {
    /// Stores the keys of a canonical line and returns its event.
    #[inline]
    pub(crate) fn take(&mut self, line: &CanonicalLine) -> Event {
        if !self.event.is_empty() {
            self.event = Annotations::NONE;
        }
        self.event.of = line.of;
        line.event
    }
}

/// Reads one line in a form of the trace, and stores its further keys in `annotations`.
pub(crate) fn parse_as(
    line: &[u8],
    form: Form,
    annotations: &mut LineAnnotations,
) -> Result<Line, ParseError> {
    if !annotations.event.is_empty() {
        annotations.event = Annotations::NONE;
    }
    let text = str::from_utf8(line).map_err(|error| {
        ParseError::at(error.valid_up_to(), "invalid UTF-8; a trace is UTF-8 text")
    })?;
    if text.starts_with('\u{feff}') {
        return Err(ParseError::at(0, "the line begins with a byte-order mark; remove it"));
    }
    if text.ends_with('\r') {
        return Err(ParseError::at(text.len() - 1, "the line ends in CR LF; end it in LF alone"));
    }
    let mut scan = Scan::new(text);
    if scan.peek().is_none() {
        return Err(ParseError::at(0, "the line is blank; remove it"));
    }
    let mut fields = Fields::default();
    fields.read(&mut scan)?;
    let end = scan.offset().saturating_sub(1);
    scan.end()?;
    if form != Form::Strict {
        fields.date_request();
    }
    let kind = fields.kind(end, form)?;
    if kind == LineKind::Header {
        annotations.header = fields.header_annotations();
    } else if !fields.seen.within(ANNOTATIONS).is_empty() {
        annotations.event = fields.annotations()?;
    }
    fields.line(kind)
}

impl ParseError {
    /// Creates an error at a byte counted from 0.
    pub(crate) fn at(offset: usize, message: impl Into<String>) -> Self {
        Self { column: offset as u64 + 1, message: message.into() }
    }
}

/// The contents of a line's object, before the kind of the line is known.
#[derive(Default)]
struct Fields<'a> {
    seen: Keys,
    /// The place of each key. A line is short enough for 32 bits.
    offsets: [u32; Key::COUNT],
    numbers: [u64; Key::COUNT],
    kind: Option<LineKind>,
    why: Cow<'a, str>,
    commit: Commit,
    operator: Option<String>,
    clouds: Vec<Cloud>,
    max_ages: BTreeMap<u64, u64>,
    origin: Option<Cow<'a, str>>,
    missing: Vec<Arc<str>>,
    /// The first key that no line may have.
    stranger: Option<(usize, Cow<'a, str>)>,
}

impl<'a> Fields<'a> {
    fn read(&mut self, scan: &mut Scan<'a>) -> Result<(), ParseError> {
        scan.expect(b'{', "at the start of a line")?;
        let mut first = true;
        while scan.more(first, b'}')? {
            first = false;
            scan.peek();
            let offset = scan.offset();
            let usual = USUAL.iter().find(|(token, _)| scan.take_all(token));
            let key = if let Some((_, key)) = usual {
                *key
            } else {
                let (offset, name) = scan.key()?;
                let Some(key) = Key::named(&name) else {
                    scan.skip()?;
                    self.stranger.get_or_insert((offset, name));
                    continue;
                };
                key
            };
            if !self.seen.insert(key) {
                return Err(twice(offset, key.name()));
            }
            self.offsets[key as usize] = u32::try_from(offset).unwrap_or(u32::MAX);
            self.value(key, scan)?;
        }
        Ok(())
    }

    fn value(&mut self, key: Key, scan: &mut Scan<'a>) -> Result<(), ParseError> {
        match key {
            Key::At
            | Key::T
            | Key::P
            | Key::Deadline
            | Key::Backlog
            | Key::Due
            | Key::Of
            | Key::For
            | Key::Within
            | Key::Age
            | Key::Seq => {
                self.numbers[key as usize] = scan.number()?;
            }
            Key::Try => self.numbers[key as usize] = within(scan, "try", 0..=u8::MAX.into())?,
            Key::Origin => self.origin = Some(scan.string("a name")?),
            Key::Missing => self.missing = names(scan)?,
            Key::Local => {
                let named = |word: &str| (word == "none").then_some(());
                choice(
                    scan,
                    "local",
                    named,
                    "none; leave the key out if the operator has a local",
                )?;
            }
            Key::Ev => self.kind = Some(choice(scan, "ev", LineKind::named, LineKind::EVENTS)?),
            Key::Why => self.why = scan.string("a reason")?,
            Key::Fuseline => {
                within(scan, "fuseline, the format's version,", VERSION..=VERSION)?;
            }
            Key::Window => {
                self.numbers[key as usize] = within(scan, "window", 1..=WINDOW)?;
            }
            Key::Operator => self.operator = Some(scan.string("a name")?.into_owned()),
            Key::Commit => {
                let named = |word: &str| Commit::ALL.into_iter().find(|rule| rule.as_str() == word);
                self.commit = choice(scan, "commit", named, "eager or patient")?;
            }
            Key::Clouds => (self.clouds, self.max_ages) = clouds(scan)?,
            Key::X => scan.skip()?,
        }
        Ok(())
    }

    /// Replaces the deadline of a request by its due instant.
    fn date_request(&mut self) {
        let has = |key| self.seen.contains(key);
        if self.kind == Some(LineKind::Request) && has(Key::Deadline) && !has(Key::Due) {
            let [at, deadline] = [Key::At, Key::Deadline].map(|key| self.numbers[key as usize]);
            // The sum saturates (F2).
            self.numbers[Key::Due as usize] = at.saturating_add(deadline);
            self.seen = self.seen.without(Keys::of(&[Key::Deadline]));
            self.seen.insert(Key::Due);
        }
    }

    /// Returns the kind of the line. Returns an error if that kind may not have the line's keys.
    /// `end` is where its object ends.
    fn kind(&self, end: usize, form: Form) -> Result<LineKind, ParseError> {
        let header = self.seen.contains(Key::Fuseline);
        let kind = if header { Some(LineKind::Header) } else { self.kind };
        if let Some((offset, name)) = &self.stranger {
            let place = kind.map_or_else(String::new, |kind| format!(" in {}", kind.takes(form)));
            return Err(ParseError::at(*offset, format!("unknown key \"{}\"{place}", brief(name))));
        }
        let Some(kind) = kind else {
            let message = "key \"ev\" is missing; an event has it, a header has \"fuseline\"";
            return Err(ParseError::at(end, message));
        };
        if let Some(key) = self.seen.without(kind.keys(form)).first() {
            let name = key.name();
            let message = if kind.keys_of_observed().contains(key) {
                format!("key \"{name}\" is allowed only in traces that are judged as observed")
            } else {
                format!("key \"{name}\" is not allowed in {}", kind.takes(form))
            };
            return Err(self.fault(key, message));
        }
        if let Some(key) = kind.required().without(self.seen).first() {
            let message = format!("key \"{}\" is missing in {}", key.name(), kind.takes(form));
            return Err(ParseError::at(end, message));
        }
        let has = |key| self.seen.contains(key);
        if form == Form::WithoutLocal && kind == LineKind::Open && has(Key::Deadline) {
            let message = "key \"deadline\" is local's deadline, but the header says that there is \
                           no local; the message's own deadline is \"within\"";
            return Err(self.fault(Key::Deadline, message));
        }
        Ok(kind)
    }

    /// Returns an error at the place of a key.
    fn fault(&self, key: Key, message: impl Into<String>) -> ParseError {
        ParseError::at(self.offsets[key as usize] as usize, message)
    }

    fn header_annotations(&mut self) -> HeaderAnnotations {
        let without_local = self.seen.contains(Key::Local);
        HeaderAnnotations { without_local, max_ages: std::mem::take(&mut self.max_ages) }
    }

    /// Returns the further keys of an event, whose keys have been checked.
    fn annotations(&mut self) -> Result<Annotations, ParseError> {
        let given = |key: Key| self.seen.contains(key).then(|| self.numbers[key as usize]);
        let (seq, attempt) = (given(Key::Seq), given(Key::Try));
        if attempt.is_some() && given(Key::P) == Some(0) {
            let message =
                "key \"try\" is in a line of p 0; local gets no requests, so it has no attempts";
            return Err(self.fault(Key::Try, message));
        }
        if seq.is_some() && self.origin.is_none() {
            let message =
                "key \"seq\" is given without key \"origin\"; name the stream that it counts in";
            return Err(self.fault(Key::Seq, message));
        }
        Ok(Annotations {
            of: given(Key::Of),
            meant_for: given(Key::For),
            attempt: attempt.map(|attempt| u8::try_from(attempt).unwrap_or(u8::MAX)),
            within: given(Key::Within),
            age: given(Key::Age),
            origin: self.origin.take().map(|stream| Origin { stream: stream.as_ref().into(), seq }),
            missing: std::mem::take(&mut self.missing),
        })
    }

    /// Returns the line, whose kind has all the keys it needs.
    fn line(self, kind: LineKind) -> Result<Line, ParseError> {
        let number = |key: Key| self.numbers[key as usize];
        let given = |key: Key| self.seen.contains(key).then(|| number(key));
        let (at, t, p) = (number(Key::At), number(Key::T), number(Key::P));
        let decision = match kind {
            LineKind::Header => {
                return Ok(Line::Header(Header {
                    operator: self.operator,
                    window: u16::try_from(self.numbers[Key::Window as usize]).unwrap_or(u16::MAX),
                    commit: self.commit,
                    clouds: self.clouds,
                }));
            }
            LineKind::Open => {
                return Ok(input(Input::Open { at, t, deadline: given(Key::Deadline) }));
            }
            LineKind::Offer => {
                let (deadline, backlog) = (number(Key::Deadline), number(Key::Backlog));
                return Ok(input(Input::Offer { at, t, p, deadline, backlog }));
            }
            LineKind::Result => return Ok(input(Input::Result { at, t, p })),
            LineKind::Fail => return Ok(input(Input::Fail { at, t, p })),
            LineKind::Tick => return Ok(input(Input::Tick { at })),
            LineKind::Timer => Decision::Timer { at, t, p },
            LineKind::Refuse => {
                if self.seen.contains(Key::P) {
                    let why = self.reason(
                        "in a refuse line with p, of an offer",
                        &OfferRefusal::ALL,
                        OfferRefusal::as_str,
                    )?;
                    Decision::RefuseOffer { at, t, p, why }
                } else {
                    let why = self.reason(
                        "in a refuse line without p, of an open",
                        &OpenRefusal::ALL,
                        OpenRefusal::as_str,
                    )?;
                    Decision::RefuseOpen { at, t, why }
                }
            }
            LineKind::Request => Decision::Request { at, t, p, due: number(Key::Due) },
            LineKind::Hold => Decision::Hold { at, t, p },
            LineKind::Drop => {
                let why = self.reason("in a drop line", &DropReason::ALL, DropReason::as_str)?;
                Decision::Drop { at, t, p, why }
            }
            LineKind::Emit => Decision::Emit { at, t, p },
            LineKind::Final => Decision::Final { at, t, p },
            LineKind::Miss => Decision::Miss { at, t },
            LineKind::Cancel => Decision::Cancel { at, t, p },
        };
        Ok(Line::Event(Event::Decision(decision)))
    }

    /// Returns the reason that the line gives, one of `all`.
    fn reason<T: Copy>(
        &self,
        place: &str,
        all: &[T],
        name: fn(T) -> &'static str,
    ) -> Result<T, ParseError> {
        all.iter().copied().find(|why| name(*why) == self.why).ok_or_else(|| {
            let known: Vec<_> = all.iter().map(|why| name(*why)).collect();
            let (why, known) = (brief(&self.why), known.join(", "));
            let message = format!("unknown why \"{why}\" {place}; it is one of {known}");
            self.fault(Key::Why, message)
        })
    }
}

const fn input(input: Input) -> Line {
    Line::Event(Event::Input(input))
}

/// Reads a list of names.
fn names(scan: &mut Scan<'_>) -> Result<Vec<Arc<str>>, ParseError> {
    let mut names = Vec::new();
    scan.expect(b'[', "at the start of missing")?;
    while scan.more(names.is_empty(), b']')? {
        names.push(scan.string("a name")?.into());
    }
    Ok(names)
}

/// Reads the list of a header's clouds, with the greatest age of their values.
fn clouds(scan: &mut Scan<'_>) -> Result<(Vec<Cloud>, BTreeMap<u64, u64>), ParseError> {
    let (mut clouds, mut max_ages) = (Vec::<Cloud>::new(), BTreeMap::new());
    scan.expect(b'[', "at the start of clouds")?;
    let mut first = true;
    while scan.more(first, b']')? {
        first = false;
        scan.peek();
        let offset = scan.offset();
        let (cloud, max_age) = cloud(scan)?;
        if clouds.len() == CLOUDS {
            return Err(ParseError::at(
                offset,
                "the header lists a sixteenth cloud; it may list up to 15",
            ));
        }
        // Equal priorities are refused (A10).
        if clouds.iter().any(|other| other.p == cloud.p) {
            let message = format!("a second cloud with p {}; give each its own", cloud.p);
            return Err(ParseError::at(offset, message));
        }
        max_ages.extend(max_age.map(|max_age| (cloud.p.into(), max_age)));
        clouds.push(cloud);
    }
    Ok((clouds, max_ages))
}

/// Reads one cloud of a header, with the greatest age of its values.
fn cloud(scan: &mut Scan<'_>) -> Result<(Cloud, Option<u64>), ParseError> {
    const TAKES: &str = "a cloud's entry; it takes p, name, limit, resume, max_age, x";
    let (mut p, mut limit, mut resume, mut name, mut x) = (None, None, None, None, None);
    let mut max_age = None;
    let start = scan.offset();
    scan.expect(b'{', "at the start of a cloud's entry")?;
    let mut first = true;
    while scan.more(first, b'}')? {
        first = false;
        let (offset, key) = scan.key()?;
        let again = match &*key {
            "p" => p.replace(within(scan, "p of a cloud", 1..=u16::MAX.into())?).is_some(),
            "limit" => limit.replace(within(scan, "limit of a cloud", 1..=u64::MAX)?).is_some(),
            "resume" => resume.replace(scan.number()?).is_some(),
            "max_age" => max_age.replace(scan.number()?).is_some(),
            "name" => name.replace(scan.string("a name")?.into_owned()).is_some(),
            "x" => x.replace(scan.skip()?).is_some(),
            _ => {
                let message = format!("unknown key \"{}\" in {TAKES}", brief(&key));
                return Err(ParseError::at(offset, message));
            }
        };
        if again {
            return Err(twice(offset, &key));
        }
    }
    let missing = |key| ParseError::at(start, format!("key \"{key}\" is missing in {TAKES}"));
    let p = p.ok_or_else(|| missing("p"))?;
    let limit = limit.ok_or_else(|| missing("limit"))?;
    // `resume` is `limit − 1` unless the header says otherwise (F2g).
    let resume = resume.unwrap_or(limit - 1);
    if resume >= limit {
        let message = format!("resume {resume} is not below limit {limit}; give a lower resume");
        return Err(ParseError::at(start, message));
    }
    Ok((Cloud { p: u16::try_from(p).unwrap_or(u16::MAX), name, limit, resume }, max_age))
}

/// Reads a number within a range.
fn within(scan: &mut Scan<'_>, what: &str, range: RangeInclusive<u64>) -> Result<u64, ParseError> {
    scan.peek();
    let offset = scan.offset();
    let value = scan.number()?;
    if range.contains(&value) {
        return Ok(value);
    }
    let (least, most) = range.into_inner();
    let message = match most {
        u64::MAX => format!("{what} is {value}; it must be at least {least}"),
        most if least == most => format!("{what} is {value}; this version reads {most}"),
        most => format!("{what} is {value}; it must be from {least} to {most}"),
    };
    Err(ParseError::at(offset, message))
}

/// Reads one of a few words.
fn choice<T>(
    scan: &mut Scan<'_>,
    key: &str,
    named: impl Fn(&str) -> Option<T>,
    known: &str,
) -> Result<T, ParseError> {
    scan.peek();
    let offset = scan.offset();
    let word = scan.string("a word")?;
    named(&word).ok_or_else(|| {
        ParseError::at(offset, format!("unknown {key} \"{}\"; it is one of {known}", brief(&word)))
    })
}

fn twice(offset: usize, key: &str) -> ParseError {
    ParseError::at(offset, format!("key \"{key}\" is given twice; give it once"))
}

/// Returns the start of a text that may be long, safe to show on a terminal.
pub(crate) fn brief(text: &str) -> String {
    const SHOWN: usize = 24;
    let mut shown = String::new();
    for c in text.chars().take(SHOWN) {
        if c.is_control() {
            shown.extend(c.escape_debug());
        } else {
            shown.push(c);
        }
    }
    if text.chars().nth(SHOWN).is_some() {
        shown.push('…');
    }
    shown
}
