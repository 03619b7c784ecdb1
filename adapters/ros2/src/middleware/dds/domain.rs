//! The domain of DDS that the node has joined: its [participants](super::participants), and what joins
//! again when the wall clock steps back or the participant has ended.

use std::sync::Arc;
use std::time::SystemTime;

use rustdds::dds::CreateResult;
use tokio::sync::Notify;
use tokio::task::JoinSet;

use super::participants::DomainHandle;
use super::rejoin;
use super::wall_clock::WallClock;

/// The domain, joined until it is left.
pub(crate) struct Domain {
    handle: DomainHandle,
    /// Watches the wall clock and joins again; ends with this.
    rejoining: JoinSet<()>,
}

impl Domain {
    /// Joins the domain.
    pub(crate) fn join(domain: u16, localhost_only: bool) -> CreateResult<Self> {
        // Before the participant is there, so that no step goes unnoticed.
        let wall_clock = WallClock::new(SystemTime::now());
        let needed = Arc::new(Notify::new());
        let handle = DomainHandle::join(domain, localhost_only, Arc::clone(&needed))?;
        let mut rejoining = JoinSet::new();
        rejoin::spawn(&mut rejoining, handle.clone(), needed, wall_clock);
        Ok(Self { handle, rejoining })
    }

    pub(crate) fn handle(&self) -> DomainHandle {
        self.handle.clone()
    }

    /// Leaves the domain: readers and writers end before their participant does.
    pub(crate) async fn leave(mut self) {
        self.rejoining.shutdown().await;
        self.handle.leave().await;
    }
}
