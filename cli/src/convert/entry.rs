//! [`Entry`]: one event of a log on its way to a line of a trace.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::hash::Hash;

use fuseline_traces::{Annotations, Event, Header, observed_line};

use crate::convert::notes::listed;
use crate::convert::row::Place;
use crate::convert::time::{self, Id};

/// An event as the log has it: instants may be negative, messages may have texts for ids, an output
/// may lack its source.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Entry {
    pub(super) place: Place,
    /// The row of the log from which it comes.
    pub(super) row: u64,
    pub(super) ev: &'static str,
    pub(super) at: i128,
    pub(super) t: Option<Id>,
    pub(super) p: Option<u64>,
    pub(super) due: Option<i128>,
    /// Further keys whose values are messages.
    pub(super) ids: Vec<(&'static str, Id)>,
    /// Further keys with their values as JSON.
    pub(super) more: Vec<(&'static str, String)>,
}

/// The sources of a log: those of the header, or, if there is no header yet, whatever the log
/// names.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    known: BTreeMap<String, u64>,
    /// The names found so far, if any name is taken.
    found: Option<Vec<String>>,
    /// The log's own name for local, and `true` if the log has that name.
    locals: BTreeMap<String, bool>,
}

/// Sources get priorities from here on until their own are known.
const PROVISIONAL: u64 = 1 << 32;

impl Entry {
    pub(super) fn new(place: &Place, row: u64, ev: &'static str, at: i128) -> Self {
        let (place, ids, more) = (place.clone(), Vec::new(), Vec::new());
        Self { place, row, ev, at, t: None, p: None, due: None, ids, more }
    }

    /// Returns the messages that it names.
    pub(super) fn messages(&self) -> impl Iterator<Item = &Id> {
        self.t.iter().chain(self.ids.iter().map(|(_, id)| id))
    }

    /// Returns the event's content, without its place.
    pub(super) fn content(&self) -> impl Hash + Eq + '_ {
        let Self { ev, at, t, p, due, ids, more, .. } = self;
        (ev, at, t, p, due, ids, more)
    }

    /// Returns its line in a trace, where instants are moved by `shift` and `number` numbers
    /// messages.
    pub(super) fn line(
        &self,
        shift: i128,
        number: &dyn Fn(&Id) -> u64,
    ) -> Result<(Event, Annotations), String> {
        let mut line = format!("{{\"ev\":\"{}\",\"at\":{}", self.ev, self.at + shift);
        let due = self.due.map(|due| (due + shift).min(u64::MAX.into()).to_string());
        let t = self.t.as_ref().map(|t| number(t).to_string());
        let own = [("t", t), ("p", self.p.map(|p| p.to_string())), ("due", due)];
        let own = own.into_iter().filter_map(|(key, value)| Some((key, value?)));
        let ids = self.ids.iter().map(|(key, id)| (*key, number(id).to_string()));
        for (key, value) in own.chain(ids).chain(self.more.iter().cloned()) {
            // To a string: it cannot fail.
            let _ = write!(line, ",\"{key}\":{value}");
        }
        line.push('}');
        observed_line(line.as_bytes()).map_err(|error| error.message)
    }
}

impl Sources {
    /// Returns the sources of a header, or any name if there is none yet; `locals` are local's
    /// names.
    pub(super) fn new(header: Option<&Header>, locals: &[String]) -> Self {
        let clouds = header.into_iter().flat_map(|header| &header.clouds);
        let named = clouds.map(|cloud| {
            let name = cloud.name.clone().unwrap_or_else(|| cloud.p.to_string());
            (name, u64::from(cloud.p))
        });
        let mut known: BTreeMap<String, u64> = named.collect();
        if header.is_some() {
            known.entry("local".to_owned()).or_insert(0);
        }
        let found = header.is_none().then(Vec::new);
        Self { known, found, locals: locals.iter().map(|name| (name.clone(), false)).collect() }
    }

    /// Returns a name of local that the log has not.
    pub(super) fn local_unseen(&self) -> Option<&str> {
        self.locals.iter().find(|(_, is_seen)| !**is_seen).map(|(name, _)| &**name)
    }

    /// Returns the sources found, in the order of their first appearance, without local; as the log
    /// calls them.
    pub(super) fn found(&self) -> &[String] {
        self.found.as_deref().unwrap_or_default()
    }

    /// Returns `true` if any name is taken.
    pub(super) const fn are_gathered(&self) -> bool {
        self.found.is_some()
    }

    /// Returns the priority of a source, which the log calls by that or by its name.
    pub(super) fn priority(&mut self, name: &str) -> Result<u64, String> {
        let name = name.trim();
        let number = time::number(name).ok();
        if let Some(is_seen) = self.locals.get_mut(name) {
            *is_seen = true;
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
        Err(format!(
            "not a known source; the header has {known}; if it is local, give --local {name}"
        ))
    }

    /// Returns `true` if the header has a source of this priority, if there is a header.
    pub(super) fn is_registered(&self, p: u64) -> bool {
        self.are_gathered() || self.known.values().any(|known| *known == p)
    }

    /// Returns the names of sources that the header or the log had so far.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let all = self.known.keys().chain(self.found()).chain(self.locals.keys());
        all.map(String::as_str).chain(["local"])
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.names().any(|known| known == name)
    }

    /// Returns a source's name.
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
