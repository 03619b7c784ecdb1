//! Plays runs that are drawn from seeds, checks them, and makes those that fail smaller.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;
use std::{fmt, fs, io, thread};

use tempfile::TempDir;

use crate::judge::{BrokenChecks, Finding};

/// The greatest number of runs that are tried to make one smaller.
const TRIES: usize = 3000;

/// A run that takes longer than this hangs: none takes more than a second on an idle host.
const HANGS: Duration = Duration::from_secs(20);

/// The check that a run without end breaks.
const ENDS: &str = "d8_everything_ends";

/// A run as plain data. It is drawn from its seed, and can be made smaller.
pub trait Drawn: Clone + Send + 'static {
    /// The option of `fuseline-simulate` that plays one seed.
    const OPTION: &str;

    /// The check that a run breaks if a panic comes through.
    const PANICS: &str = Self::OPTION;

    /// Draws the run of this seed. The run stays the same as long as the drawing does not change.
    fn draw(seed: u64) -> Self;

    /// Plays the run in virtual time, and checks it. Its files go to the empty `folder`.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be used.
    fn play(&self, folder: &Path) -> io::Result<Simulated>;

    /// Returns the smallest run that is found for which the function returns `true`.
    ///
    /// # Errors
    /// Returns the first error of the function.
    fn smallest(&self, _: impl FnMut(&Self) -> io::Result<bool>) -> io::Result<Self> {
        Ok(self.clone())
    }

    /// Describes the run.
    fn text(&self) -> String {
        String::new()
    }
}

/// Plays runs, one after the other, with files in its own folder, which is in memory if possible.
pub struct Simulator {
    folder: TempDir,
}

/// The outcome of one run.
#[derive(Default)]
pub struct Simulated {
    /// The checks that do not hold.
    pub findings: Vec<Finding>,
    /// The kinds of endings that the run of a node came to.
    pub kinds: BTreeSet<&'static str>,
    /// The number of messages that were written.
    pub messages: u64,
    /// Its length in virtual time, until the operator was stopped or the last item was read.
    pub life: Duration,
    /// The operator's trace.
    pub trace: Vec<u8>,
    /// `true` if it takes too long. It continues in its thread.
    pub hangs: bool,
    /// The observations outside of the trace; `None` if a panic came through.
    pub(crate) external_log: Option<Box<dyn fmt::Debug + Send>>,
}

/// The sums over the runs of some seeds.
#[derive(Default)]
pub struct SeedResults {
    /// The checks that are broken.
    pub broken: BrokenChecks,
    /// The number of runs that came to each kind of ending.
    pub kinds: BTreeMap<&'static str, usize>,
}

impl Simulator {
    /// Creates a simulator.
    ///
    /// # Errors
    /// Returns an error if there is no place for its files.
    pub fn new() -> io::Result<Self> {
        let memory = Path::new("/dev/shm");
        let folder =
            if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        Ok(Self { folder: folder? })
    }

    /// Plays a run and checks it.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn simulate<D: Drawn>(&self, run: &D) -> io::Result<Simulated> {
        let (run, folder): (D, PathBuf) = (run.clone(), self.folder.path().to_owned());
        for entry in fs::read_dir(&folder)? {
            fs::remove_file(entry?.path())?;
        }
        let (sender, ended) = mpsc::channel();
        // No virtual time passes in a loop that never sleeps, so real time decides.
        let playing = thread::spawn(move || {
            // If the run took too long, nobody listens.
            let _ = sender.send(run.play(&folder));
        });
        match ended.recv_timeout(HANGS) {
            Ok(simulated) => simulated,
            Err(RecvTimeoutError::Timeout) => {
                let reason = format!("it did not end within {HANGS:?}");
                Ok(Simulated { hangs: true, ..Simulated::broken(ENDS, reason) })
            }
            // The tasks of the run must handle a panic; this one came through.
            Err(RecvTimeoutError::Disconnected) => {
                let panic = playing.join().err();
                let reason = panic.as_deref().and_then(words).unwrap_or("no words");
                Ok(Simulated::broken(D::PANICS, reason.to_owned()))
            }
        }
    }

    /// Returns the smallest run that can be found for which this check does not hold either.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn smallest<D: Drawn>(&self, run: &D, check: &str) -> io::Result<D> {
        let mut tries = 0;
        run.smallest(|smaller| {
            if tries >= TRIES {
                return Ok(false);
            }
            let simulated = self.simulate(smaller)?;
            tries = if simulated.hangs { TRIES } else { tries + 1 };
            Ok(!simulated.hangs && simulated.breaks(check).is_some())
        })
    }
}

impl Simulated {
    pub(crate) fn broken(check: &'static str, reason: String) -> Self {
        Self { findings: vec![Finding { check, reason }], ..Self::default() }
    }

    /// Returns the outcome of a run with one check.
    pub(crate) fn of(check: &'static str, wrong: &[String]) -> Self {
        if wrong.is_empty() { Self::default() } else { Self::broken(check, wrong.join("; ")) }
    }

    /// Returns the finding of this check, if it does not hold.
    #[must_use]
    pub fn breaks(&self, check: &str) -> Option<&Finding> {
        self.findings.iter().find(|finding| finding.check == check)
    }

    /// Describes everything that was seen outside of the trace. The same seed gives the same text.
    #[must_use]
    pub fn external_log(&self) -> String {
        format!("{:#?}", self.external_log)
    }
}

impl SeedResults {
    /// Plays the runs of these seeds, on two threads. A run that hangs is the last one.
    ///
    /// # Panics
    /// Panics if there is no place for the files.
    #[must_use]
    pub fn of<D: Drawn>(seeds: &[u64]) -> Self {
        let half = |first| {
            let simulator = Simulator::new().expect("a folder for traces");
            let mut results = Self::default();
            for seed in seeds.iter().skip(first).step_by(2) {
                let run = simulator.simulate(&D::draw(*seed)).expect("a folder for traces");
                results.broken.add(*seed, run.findings);
                for kind in run.kinds {
                    *results.kinds.entry(kind).or_default() += 1;
                }
                if run.hangs {
                    break;
                }
            }
            results
        };
        let [mut results, others] = thread::scope(|scope| {
            let others = scope.spawn(|| half(1));
            [half(0), others.join().expect("no panic")]
        });
        results.broken.extend(others.broken);
        for (kind, count) in others.kinds {
            *results.kinds.entry(kind).or_default() += count;
        }
        results
    }
}

/// Returns the words of a panic.
fn words(panic: &(dyn Any + Send)) -> Option<&str> {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
}
