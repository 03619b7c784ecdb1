//! The seeds that ever failed.

use serde::Deserialize;

/// A seed that failed once.
#[derive(Clone, PartialEq, Eq, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedSeed {
    /// The seed.
    pub seed: u64,
    /// A description of what was wrong, and of what was done about it.
    pub because: String,
}

/// Returns all of them, in the order in which they were found.
///
/// # Panics
/// Panics if `seeds.toml` is not a list of seeds with reasons; a test reads it.
#[must_use]
pub fn saved_seeds() -> Vec<SavedSeed> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        #[serde(default)]
        seed: Vec<SavedSeed>,
    }
    let file: Result<File, _> = toml::from_str(include_str!("../../simulate/seeds.toml"));
    file.map(|file| file.seed).expect("seeds.toml is a list of seeds with reasons")
}
