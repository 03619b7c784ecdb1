//! The configurations that are checked: operator, environment, and how many states they have.

use fuseline_testkit::OperatorConfig;
use fuseline_traces::{Cloud, Commit, Header};

use crate::sighting::Sighting;

mod table;

pub use table::WORLDS;

/// An operator and its environment.
#[derive(Clone, Copy, Debug)]
pub struct World {
    /// Its name on the command line.
    pub name: &'static str,
    /// When it is checked.
    pub size: Size,
    /// The commit rule.
    pub commit: Commit,
    /// How many timestamps may be open.
    pub window: u16,
    /// The clouds.
    pub clouds: &'static [Cloud],
    /// The timestamps that inputs are about, in ascending order.
    pub timestamps: &'static [u64],
    /// The readings of the clock, in ascending order.
    pub clock: &'static [u64],
    /// Which of them inputs other than ticks come with.
    pub readings: Readings,
    /// The deadlines of local that an open may bring.
    pub local_deadlines: &'static [Option<u64>],
    /// The deadlines that an offer may bring.
    pub deadlines: &'static [u64],
    /// The backlogs that an offer may bring.
    pub backlogs: &'static [u64],
    /// What such an environment cannot show.
    pub absent: &'static [&'static [Sighting]],
    /// How many unique states there are. Another number says that the machine or the environment
    /// changed.
    pub states: usize,
}

/// Which readings of the clock inputs come with. Ticks come with any.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Readings {
    /// The present one: all else is a tick before.
    Now,
    /// The present one and the next.
    Next,
    /// The one before, the present one and all later ones.
    Any,
}

/// When a configuration is checked.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Size {
    /// Always; in a second or so.
    Quick,
    /// Always, unless haste is requested.
    Standard,
    /// If requested.
    Large,
}

impl World {
    /// The configuration with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        WORLDS.iter().find(|config| config.name == name)
    }

    /// What a ledger knows of its operator.
    pub(crate) fn terms(&self) -> OperatorConfig<'static> {
        OperatorConfig { window: self.window.into(), commit: self.commit, clouds: self.clouds }
    }

    /// The registered cloud with this priority.
    #[must_use]
    pub fn cloud(&self, p: u64) -> Option<&'static Cloud> {
        self.clouds.iter().find(|cloud| u64::from(cloud.p) == p)
    }

    /// What its environment shows.
    pub fn sightings(&self) -> impl Iterator<Item = Sighting> {
        let is_absent =
            |sighting: &Sighting| self.absent.iter().any(|some| some.contains(sighting));
        Sighting::ALL.iter().copied().filter(move |sighting| !is_absent(sighting))
    }

    /// The header of its traces.
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
