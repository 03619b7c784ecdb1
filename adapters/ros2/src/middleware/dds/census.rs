//! Finds out who else publishes on the topics of this node, and whether discovery goes on.
//!
//! DDS matches a writer with readers alone. Only discovery knows who else writes what the node
//! writes, such as a second node of its name or a model whose output was not remapped.

use std::collections::{BTreeSet, VecDeque};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use fuseline_engine::lock;
use rustdds::discovery::DiscoveredWriterData;
use rustdds::{DomainParticipant, RTPSEntity};
use tracing::warn;

use super::rejoin::Loss;
use crate::middleware::end::{Endpoint, Gid};

/// The time from one count to the next.
const PERIOD: Duration = Duration::from_secs(1);

/// The prefix of the identifiers of a participant's endpoints.
const PREFIX: usize = 12;

/// The last participants of this process: during a rejoin there are two, and peers forget the
/// former one later.
static OWN: Mutex<VecDeque<Gid>> = Mutex::new(VecDeque::new());
const OWN_MOST: usize = 64;

/// Counts the publishers of a participant's topics that are not this process's own, in a thread of
/// its own.
pub(crate) struct Census {
    publishers: Arc<Mutex<Vec<Arc<Endpoint>>>>,
    stop: Option<mpsc::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Census {
    pub(super) fn begin(participant: DomainParticipant, loss: Arc<Loss>) -> Self {
        let mut own = lock(&OWN);
        own.push_back(participant.guid().to_bytes());
        if own.len() > OWN_MOST {
            own.pop_front();
        }
        drop(own);
        let publishers = Arc::<Mutex<Vec<Arc<Endpoint>>>>::default();
        let (stop, stopped) = mpsc::channel();
        let counted = Arc::clone(&publishers);
        let count = move || {
            while stopped.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                // The thread of discovery gets this, if it is there.
                if participant.assert_liveliness().is_err() {
                    loss.report();
                }
                let writers = participant.discovered_writers();
                for end in lock(&counted).iter() {
                    end.set_rivals(rivals(&writers, &end.topic));
                }
            }
        };
        let thread = thread::Builder::new().name("census".into()).spawn(count);
        let thread = thread.inspect_err(
            |error| warn!(%error, "other publishers of the node's topics will not be reported"),
        );
        Self { publishers, stop: Some(stop), thread: thread.ok() }
    }

    /// Counts the other publishers of this end's topic from now on.
    pub(super) fn add(&self, publisher: Arc<Endpoint>) {
        lock(&self.publishers).push(publisher);
    }
}

/// The thread has a part in the participant, which is to be left by who drops this.
impl Drop for Census {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

/// Returns the other publishers of a topic.
fn rivals(writers: &[DiscoveredWriterData], topic: &str) -> BTreeSet<Gid> {
    let own = lock(&OWN);
    let of_topic = writers
        .iter()
        .map(|writer| &writer.publication_topic_data)
        .filter(|data| data.topic_name.strip_prefix("rt").is_some_and(|name| name == topic));
    let is_ours = |gid: &Gid| own.iter().any(|own| own[..PREFIX] == gid[..PREFIX]);
    of_topic.map(|data| data.key.to_bytes()).filter(|gid| !is_ours(gid)).collect()
}
