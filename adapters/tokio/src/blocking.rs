//! [`BlockingOperator`]: an operator for programs without a runtime, such as scripts and control loops of their own.
//!
//! It has a runtime of its own. Programs on tokio [`spawn`] instead.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use fuseline_engine::{Item, Lineage, Tally, lock};
use tokio::runtime::{Builder, Handle, Runtime};
use tokio::time::error::Elapsed;
use tokio::time::timeout;

use crate::items::Items;
use crate::operator::{Config, JoinError, Operator, Running, SpawnError, spawn};
use crate::stream::{WriteError, Writer, stream};

/// Runs an operator on threads of its own; all methods may be called from several threads.
///
/// Handlers and an async local run on those threads. Dropping it stops the operator at once and waits for nothing; [`finish`]
/// waits until all is answered.
///
/// ```
/// use fuseline_tokio::{BlockingOperator, Config, Local, Operator, Setup};
/// use std::time::Duration;
/// struct Doubler;
/// impl Operator for Doubler {
///     type Input = u32;
///     type Output = u32;
///     fn setup(self, _: &mut Setup<u32, u32>) -> Local<u32, u32> {
///         Local::blocking(|n, _| Ok(2 * n))
///     }
/// }
/// # fn main() -> Result<(), fuseline_tokio::Error> {
/// let operator = BlockingOperator::start(Doubler, Config::default())?;
/// operator.write(21)?;
/// while let Some(item) = operator.read_within(Duration::from_secs(5))? {
///     println!("{:?}", item.forwarded().map(|it| it.value));
///     operator.close();
/// }
/// let (_unread, tally) = operator.finish()?;
/// # assert_eq!(tally.messages, 1);
/// # Ok(()) }
/// ```
///
/// [`finish`]: Self::finish
#[derive(Debug)]
pub struct BlockingOperator<I, O> {
    runtime: OwnedRuntime,
    /// None once it is closed.
    writer: Mutex<Option<Writer<I>>>,
    output: Mutex<Items<O>>,
    running: Running,
}

/// Items that nobody read before the end.
pub type UnreadItems<O> = Vec<Arc<Item<O>>>;

/// A runtime whose end waits for nothing, so that a thread that hangs keeps no program from its end.
#[derive(Debug)]
struct OwnedRuntime(Option<Runtime>);

impl<I, O> BlockingOperator<I, O>
where
    I: Send + Sync + 'static,
    O: Send + Sync + 'static,
{
    /// Starts an operator. As many messages as [`Config::window`] may wait to be taken in.
    ///
    /// # Errors
    /// As of [`spawn`]; [`SpawnError::WithinRuntime`] within a runtime, whose thread it would block.
    pub fn start<P>(operator: P, config: Config) -> Result<Self, SpawnError>
    where
        P: Operator<Input = I, Output = O>,
    {
        if Handle::try_current().is_ok() {
            return Err(SpawnError::WithinRuntime);
        }
        let runtime =
            Builder::new_multi_thread().thread_name("fuseline-operator").enable_all().build();
        let runtime = OwnedRuntime(Some(runtime.map_err(SpawnError::Runtime)?));
        let (writer, input) = stream(usize::from(config.window).max(1));
        let (running, output) = {
            let _entered = runtime.get().enter();
            spawn(operator, config, input)?
        };
        let (writer, output) = (Mutex::new(Some(writer)), Mutex::new(output));
        Ok(Self { runtime, writer, output, running })
    }

    /// Writes a message; returns its timestamp. It never waits.
    ///
    /// # Errors
    /// [`WriteError::Full`] if the operator holds back messages, since items wait to be read; [`WriteError::Closed`] after
    /// [`close`](Self::close) or the operator's end. The message comes back.
    pub fn write(&self, message: I) -> Result<u64, WriteError<I>> {
        self.write_with(message, None)
    }

    /// The same with the message's lineage, as [`Writer::write_with`] takes it.
    ///
    /// # Errors
    /// As of [`write`](Self::write).
    pub fn write_with(
        &self,
        message: I,
        lineage: impl Into<Option<Arc<Lineage>>>,
    ) -> Result<u64, WriteError<I>> {
        match &mut *lock(&self.writer) {
            Some(writer) => writer.write_with(message, lineage),
            None => Err(WriteError::Closed(message)),
        }
    }

    /// Waits for the next item; none once the operator has ended and all are read.
    ///
    /// # Panics
    /// Within a runtime, such as in a handler: it would block the thread that others need. `read_within` too.
    pub fn read(&self) -> Option<Arc<Item<O>>> {
        let mut output = lock(&self.output);
        self.runtime.get().block_on(output.read())
    }

    /// The same for at most so long.
    ///
    /// # Errors
    /// If no item came within that time; none is lost.
    pub fn read_within(&self, limit: Duration) -> Result<Option<Arc<Item<O>>>, Elapsed> {
        let mut output = lock(&self.output);
        self.runtime.get().block_on(async { timeout(limit, output.read()).await })
    }

    /// Takes no more messages; the operator ends once all are answered and the items are read.
    pub fn close(&self) {
        drop(lock(&self.writer).take());
    }

    /// Ends the operator at once, as [`Running::stop`] does.
    pub fn stop(&self) {
        self.running.stop();
    }

    /// Its counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.running.tally()
    }

    /// Closes it, waits until every message is answered and the trace is written; returns the items that were not read, and
    /// the counts.
    ///
    /// # Errors
    /// As of [`Running::join`].
    ///
    /// # Panics
    /// As of [`read`](Self::read).
    pub fn finish(self) -> Result<(UnreadItems<O>, Tally), JoinError> {
        self.close();
        let Self { runtime, output, running, .. } = self;
        let mut output = output.into_inner().unwrap_or_else(PoisonError::into_inner);
        runtime.get().block_on(async {
            let mut unread = Vec::new();
            while let Some(item) = output.read().await {
                unread.push(item);
            }
            Ok((unread, running.join().await?))
        })
    }
}

impl OwnedRuntime {
    /// It is there until it is dropped.
    fn get(&self) -> &Runtime {
        self.0.as_ref().expect("a runtime until the drop")
    }
}

impl Drop for OwnedRuntime {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}
