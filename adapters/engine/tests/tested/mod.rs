//! The engine that tests drive by hand.

use std::iter;

use fuseline_engine::{Cloud, Commit, Engine, EngineConfig, Header, Local};

pub(crate) type Tested = Engine<&'static str, u64>;

/// Returns a header with the clouds 1 and 2, each with one call at a time and a gate that shuts at
/// 2.
pub(crate) fn header(commit: Commit) -> Header {
    let cloud = |p, name: &str| Cloud { p, name: Some(name.into()), limit: 2, resume: 0 };
    let clouds = vec![cloud(2, "east"), cloud(1, "west")];
    Header { operator: Some("tested".into()), window: 4, commit, clouds }
}

/// Returns the configuration for a header. `calls` bounds each cloud's calls at once, which default
/// to 1.
pub(crate) fn config(header: &Header, calls: &[usize], local: Local) -> EngineConfig {
    let mut config = EngineConfig { local, ..EngineConfig::from(header) };
    let calls = calls.iter().chain(iter::repeat(&1));
    config.clouds.iter_mut().zip(calls).for_each(|(cloud, calls)| cloud.calls = *calls);
    config
}
