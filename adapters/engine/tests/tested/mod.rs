//! The engine that tests drive by hand.

use fuseline_engine::{Cloud, Commit, Engine, Header};

pub(crate) type Tested = Engine<&'static str, u64>;

/// Clouds 1 and 2, each with one call at a time and a gate that shuts at 2.
pub(crate) fn header(commit: Commit) -> Header {
    let cloud = |p, name: &str| Cloud { p, name: Some(name.into()), limit: 2, resume: 0 };
    let clouds = vec![cloud(2, "east"), cloud(1, "west")];
    Header { operator: Some("tested".into()), window: 4, commit, clouds }
}
