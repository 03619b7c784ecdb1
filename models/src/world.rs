//! The configurations that are checked: the operator, its environment, and the number of states.

use fuseline_testkit::OperatorConfig;
use fuseline_traces::{Cloud, Commit, Header};

use crate::sighting::Sighting;

mod table;

pub use table::WORLDS;

/// An operator and its environment.
#[derive(Clone, Copy, Debug)]
pub struct World {
    /// The name on the command line.
    pub name: &'static str,
    /// States in which runs the configuration is checked.
    pub size: Size,
    /// The commit rule.
    pub commit: Commit,
    /// The greatest number of timestamps that may be open.
    pub window: u16,
    /// The clouds.
    pub clouds: &'static [Cloud],
    /// The timestamps of inputs, in ascending order.
    pub timestamps: &'static [u64],
    /// The readings of the clock, in ascending order.
    pub clock: &'static [u64],
    /// The readings that come with inputs other than ticks.
    pub readings: Readings,
    /// The deadlines for local that an open may have.
    pub local_deadlines: &'static [Option<u64>],
    /// The deadlines that an offer may have.
    pub deadlines: &'static [u64],
    /// The backlogs that an offer may have.
    pub backlogs: &'static [u64],
    /// The sightings that this environment cannot show.
    pub absent: &'static [&'static [Sighting]],
    /// The number of unique states. Another number means that the machine or the environment
    /// changed.
    pub states: usize,
}

/// The readings of the clock that inputs may come with. Ticks may come with any reading.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Readings {
    /// The present reading. A tick moves the clock to another reading first.
    Now,
    /// The present reading and the next one.
    Next,
    /// The previous reading, the present one and all later ones.
    Any,
}

/// States in which runs a configuration is checked.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Size {
    /// In every run. It takes about a second.
    Quick,
    /// In every run, unless only quick configurations are requested.
    Standard,
    /// Only on request.
    Large,
}

impl World {
    /// Returns the configuration with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        WORLDS.iter().find(|config| config.name == name)
    }

    /// Returns the part of the configuration that a ledger needs.
    pub(crate) fn terms(&self) -> OperatorConfig<'static> {
        OperatorConfig { window: self.window.into(), commit: self.commit, clouds: self.clouds }
    }

    /// Returns the registered cloud with this priority.
    #[must_use]
    pub fn cloud(&self, p: u64) -> Option<&'static Cloud> {
        self.clouds.iter().find(|cloud| u64::from(cloud.p) == p)
    }

    /// Returns the sightings that the environment shows.
    pub fn sightings(&self) -> impl Iterator<Item = Sighting> {
        let is_absent =
            |sighting: &Sighting| self.absent.iter().any(|some| some.contains(sighting));
        Sighting::ALL.iter().copied().filter(move |sighting| !is_absent(sighting))
    }

    /// Returns the header of its traces.
    #[must_use]
    pub fn header(&self) -> Header {
        Header {
            operator: Some(self.name.to_owned()),
            window: self.window,
            commit: self.commit,
            clouds: self.clouds.to_vec(),
        }
    }
}
