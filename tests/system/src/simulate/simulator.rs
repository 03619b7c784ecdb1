//! Plays runs that are drawn from seeds, checks them, and makes those that fail smaller.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;
use std::{fmt, fs, io, mem, thread};

use rustix::time::{ClockId, clock_gettime};
use tempfile::TempDir;

use crate::judge::{BrokenChecks, Finding};
use crate::simulate::saved_seeds::{SavedSeed, saved_seeds};

/// The greatest number of runs that are tried to make one smaller.
const TRIES: usize = 3000;

/// A run hangs if the process uses more processor time than this before the run ends. Two runs play
/// at once, and none needs more than a second. Wall time would depend on the load of the host. The
/// fault campaign gives a witness at least 30 s of wall time, so a hang must be found sooner.
const BUSY: Duration = Duration::from_secs(10);

/// A run also hangs if the process stands still for this many seconds in a row. The virtual clock
/// advances when everything waits, so a run that can still end is busy.
const IDLE_SECONDS: u32 = 20;

/// A process that uses less processor time than this in a second stands still.
const STANDS_STILL: Duration = Duration::from_millis(1);

/// The check that a run without end breaks.
const ENDS: &str = "d8_everything_ends";

/// A run as plain data. It is drawn from its seed, and can be made smaller.
pub trait Drawn: Clone + Send + 'static {
    /// The option of `fuseline-simulate` that plays one seed.
    const OPTION: &str;

    /// The check that a run breaks if it panics outside of the tasks that handle panics.
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
    /// The folders of the runs that hang.
    kept_folders: Vec<TempDir>,
}

/// The outcome of one run.
#[derive(Default)]
pub struct Simulated {
    /// The checks that do not hold.
    pub findings: Vec<Finding>,
    /// The kinds of endings that a node's run had.
    pub kinds: BTreeSet<&'static str>,
    /// The number of messages that were written.
    pub messages: u64,
    /// Its length in virtual time, until the operator was stopped or the last item was read.
    pub life: Duration,
    /// The operator's trace.
    pub trace: Vec<u8>,
    /// `true` if the run did not end in time. Its thread may still be running.
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
        Ok(Self { folder: folder()?, kept_folders: Vec::new() })
    }

    /// Plays a run and checks it.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn simulate<D: Drawn>(&mut self, run: &D) -> io::Result<Simulated> {
        let (run, folder): (D, PathBuf) = (run.clone(), self.folder.path().to_owned());
        for entry in fs::read_dir(&folder)? {
            fs::remove_file(entry?.path())?;
        }
        let (sender, ended) = mpsc::channel();
        let begin = processor_time();
        let playing = thread::Builder::new().name(D::OPTION.into()).spawn(move || {
            // If the run hung, nobody listens.
            let _ = sender.send(run.play(&folder));
        })?;
        match wait(&ended, begin) {
            Ok(simulated) => simulated,
            Err(RecvTimeoutError::Timeout) => {
                // The run still writes to its folder.
                self.kept_folders.push(mem::replace(&mut self.folder, self::folder()?));
                let used = processor_time().saturating_sub(begin);
                let reason = format!("it did not end, and used {used:.1?} of processor time");
                Ok(Simulated { hangs: true, ..Simulated::broken(ENDS, reason) })
            }
            // The tasks of the run must handle a panic; this one came through.
            Err(RecvTimeoutError::Disconnected) => {
                let panic = playing.join().err();
                let reason = panic.as_deref().and_then(panic_message);
                let reason = reason.unwrap_or("a panic without a message");
                Ok(Simulated::broken(D::PANICS, reason.to_owned()))
            }
        }
    }

    /// Returns the smallest run that can be found that breaks this check too.
    ///
    /// # Errors
    /// Returns an error if its files cannot be used.
    pub fn smallest<D: Drawn>(&mut self, run: &D, check: &str) -> io::Result<D> {
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
    /// Plays the saved seeds and the seeds below `end`, on two threads. Each thread stops after a run
    /// that hangs.
    ///
    /// # Panics
    /// Panics if there is no place for the files.
    #[must_use]
    pub fn below<D: Drawn>(end: u64) -> Self {
        let saved = saved_seeds().into_iter().map(|SavedSeed { seed, .. }| seed);
        let seeds: Vec<_> = saved.chain(0..end).collect();
        let half = |first| {
            let mut simulator = Simulator::new().expect("a folder for traces");
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

/// Creates a folder for the files of runs.
fn folder() -> io::Result<TempDir> {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }
}

/// Waits for the end of a run that began at this processor time. Returns `Timeout` if the run
/// hangs. No virtual time passes in a loop that never sleeps, so the virtual clock cannot decide.
fn wait<T>(ended: &Receiver<T>, begin: Duration) -> Result<T, RecvTimeoutError> {
    let (mut before, mut idle) = (begin, 0);
    loop {
        let received = ended.recv_timeout(Duration::from_secs(1));
        let now = processor_time();
        let is_idle = now.saturating_sub(before) < STANDS_STILL;
        (before, idle) = (now, if is_idle { idle + 1 } else { 0 });
        let hangs = now.saturating_sub(begin) > BUSY || idle == IDLE_SECONDS;
        if hangs || !matches!(received, Err(RecvTimeoutError::Timeout)) {
            return received;
        }
    }
}

/// Returns the processor time that this process has used.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.try_into().expect("processor time is positive")
}

/// Returns the message of a panic.
fn panic_message(panic: &(dyn Any + Send)) -> Option<&str> {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
}
