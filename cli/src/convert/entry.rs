//! [`Entry`]: one event of a log on its way to a line of a trace.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use fuseline_traces::{Annotations, Event, observed_line};

use crate::convert::row::Place;
use crate::convert::value::{Id, listed};

/// An event as the log has it: instants may be negative, messages may have texts for ids, an output may lack its source.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Entry {
    pub(super) place: Place,
    /// Which row of the log it is of.
    pub(super) row: u64,
    pub(super) ev: &'static str,
    pub(super) at: i128,
    pub(super) t: Option<Id>,
    pub(super) p: Option<u64>,
    pub(super) due: Option<i128>,
    pub(super) of: Option<Id>,
    /// Further keys with their values as JSON.
    pub(super) more: Vec<(&'static str, String)>,
}

/// The sources of a log: those of the header, or, if there is no header yet, whatever the log names.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    known: BTreeMap<String, u64>,
    /// The names found so far, if any name is taken.
    found: Option<Vec<String>>,
    /// What the log calls local, beside local.
    locals: Vec<String>,
    /// Those of them that the log has.
    locals_seen: BTreeSet<String>,
}

/// Where the priorities begin that names have for now.
const PROVISIONAL: u64 = 1 << 32;

impl Entry {
    /// What it says, without where it stands.
    pub(super) fn content(&self) -> String {
        let Self { ev, at, t, p, due, of, more, .. } = self;
        format!("{ev} {at} {t:?} {p:?} {due:?} {of:?} {more:?}")
    }

    /// Its line in a trace, where instants are moved by `shift` and `number` numbers messages.
    ///
    /// # Errors
    /// If it is no event of a trace.
    pub(super) fn line(
        &self,
        shift: i128,
        number: &dyn Fn(&Id) -> u64,
    ) -> Result<(Event, Annotations), String> {
        let mut line = format!("{{\"ev\":\"{}\",\"at\":{}", self.ev, self.at + shift);
        let mut put = |key: &str, value: &str| {
            // To a string: it cannot fail.
            let _ = write!(line, ",\"{key}\":{value}");
        };
        if let Some(t) = &self.t {
            put("t", &number(t).to_string());
        }
        if let Some(p) = self.p {
            put("p", &p.to_string());
        }
        if let Some(due) = self.due {
            put("due", &(due + shift).min(u64::MAX.into()).to_string());
        }
        if let Some(of) = &self.of {
            put("of", &number(of).to_string());
        }
        for (key, value) in &self.more {
            put(key, value);
        }
        line.push('}');
        observed_line(line.as_bytes()).map_err(|error| error.message)
    }
}

impl Sources {
    /// The sources of a header.
    pub(super) const fn known(known: BTreeMap<String, u64>) -> Self {
        Self { known, found: None, locals: Vec::new(), locals_seen: BTreeSet::new() }
    }

    /// Takes any name.
    pub(super) fn gathering() -> Self {
        Self { found: Some(Vec::new()), ..Self::known(BTreeMap::new()) }
    }

    /// The same, where these names are local's.
    pub(super) fn with_locals(mut self, locals: &[String]) -> Self {
        self.locals = locals.to_vec();
        self
    }

    /// A name of local that the log has not.
    pub(super) fn local_unseen(&self) -> Option<&str> {
        let unseen = self.locals.iter().find(|name| !self.locals_seen.contains(*name));
        unseen.map(|name| &**name)
    }

    /// The sources found, in the order of their first appearance, without local; as the log calls them.
    pub(super) fn found(&self) -> &[String] {
        self.found.as_deref().unwrap_or_default()
    }

    /// Whether any name is taken.
    pub(super) const fn are_gathered(&self) -> bool {
        self.found.is_some()
    }

    /// The priority of a source, which the log calls by that or by its name.
    pub(super) fn priority(&mut self, name: &str) -> Result<u64, String> {
        let name = name.trim();
        let number = super::value::number(name).ok();
        if self.locals.iter().any(|local| local == name) {
            self.locals_seen.insert(name.to_owned());
            return Ok(0);
        }
        if let Some(found) = &mut self.found {
            if name == "local" || number == Some(0) {
                return Ok(0);
            }
            let shown = number.map_or_else(|| name.to_owned(), |number| number.to_string());
            let index = found.iter().position(|known| *known == shown);
            let index = index.unwrap_or_else(|| {
                found.push(shown);
                found.len() - 1
            });
            return Ok(number.unwrap_or(PROVISIONAL + index as u64));
        }
        if let Some(p) = number.or_else(|| self.known.get(name).copied()) {
            return Ok(p);
        }
        let known = listed(name, self.known.keys().map(String::as_str));
        Err(format!("no source; the header has {known}; if it is local, give --local {name}"))
    }

    /// Whether the header has a source of this priority, if there is a header.
    pub(super) fn is_registered(&self, p: u64) -> bool {
        self.are_gathered() || self.known.values().any(|known| *known == p)
    }

    /// Whether a name is a source's that the header or the log had so far.
    pub(super) fn has(&self, name: &str) -> bool {
        let is_found = || self.found().iter().any(|known| known == name);
        name == "local"
            || self.locals.iter().any(|local| local == name)
            || self.known.contains_key(name)
            || is_found()
    }

    /// What a source is called.
    pub(super) fn name(&self, p: u64) -> String {
        if p == 0 {
            return "local".to_owned();
        }
        let known = self.known.iter().find(|(_, known)| **known == p).map(|(name, _)| name);
        let index = p.checked_sub(PROVISIONAL).and_then(|index| usize::try_from(index).ok());
        let name = known.or_else(|| self.found().get(index?));
        name.cloned().unwrap_or_else(|| p.to_string())
    }
}
