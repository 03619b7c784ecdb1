//! Joining the domain again when the wall clock stepped back.
//!
//! `rustdds` stores what it receives under the time of day and reads what comes over best effort, the announcements of
//! participants with it, up to the present time of day. After a step back it would read none of that until the clock has
//! caught up with the latest sample. A new participant has no such samples. So everything is created once more in a second
//! participant, which takes over when it has met the peers that the first one knows; only then is the first one left.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::future::join_all;
use tokio::sync::Notify;
use tokio::task::{JoinSet, spawn_blocking};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};
use tracing::{error, info, warn};

use super::domain::{DomainHandle, NewEntity};
use super::wall_clock::WallClock;
use crate::error::NodeError;

/// How often the wall clock is looked at.
const CLOCK_PERIOD: Duration = Duration::from_millis(20);

/// How often it is checked whether the second participant has met the peers.
const MATCH_PERIOD: Duration = Duration::from_millis(20);

/// How long it has to meet them. Some may be gone, which the first participant does not notice.
const MATCH_TIMEOUT: Duration = Duration::from_secs(3);

/// How long both participants stay, once before the second takes over and once after: peers meet it later than it meets
/// them, and what they sent to the first is still on its way.
const OVERLAP: Duration = Duration::from_millis(500);

/// How long what was sent by the first participant may stay unacknowledged. A subscriber that was killed acknowledges
/// nothing.
const ACKNOWLEDGE_TIMEOUT: Duration = Duration::from_secs(3);

/// How long after a failure it is tried again.
const RETRY_PERIOD: Duration = Duration::from_secs(3);

/// Rejoins by `tasks` whenever the clock stepped back.
pub(super) fn spawn(tasks: &mut JoinSet<()>, domain: DomainHandle, clock: WallClock) {
    let stepped_back = Arc::new(Notify::new());
    tasks.spawn(watch(clock, Arc::clone(&stepped_back)));
    tasks.spawn(async move {
        loop {
            stepped_back.notified().await;
            warn!("the wall clock stepped back: joining the domain again");
            while let Err(error) = rejoin(&domain).await {
                error!(%error, "the domain cannot be joined again; trying once more");
                sleep(RETRY_PERIOD).await;
            }
            info!("joined the domain again");
        }
    });
}

/// Runs beside the rejoining: a step while that is under way needs another.
async fn watch(mut clock: WallClock, stepped_back: Arc<Notify>) {
    let mut period = interval(CLOCK_PERIOD);
    period.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        period.tick().await;
        if clock.stepped_back(SystemTime::now()) {
            stepped_back.notify_one();
        }
    }
}

async fn rejoin(domain: &DomainHandle) -> Result<(), NodeError> {
    let creating = domain.clone();
    // Not on this thread, which serves deadlines.
    let created = spawn_blocking(move || creating.create_again()).await;
    let (next, entities) =
        created.map_err(|error| NodeError::System(std::io::Error::other(error)))??;
    let patience = Instant::now() + MATCH_TIMEOUT;
    while Instant::now() < patience && !entities.iter().all(NewEntity::is_matched) {
        sleep(MATCH_PERIOD).await;
    }
    sleep(OVERLAP).await;
    let (previous, drains) = domain.take_over(next, entities)?;
    sleep(OVERLAP).await;
    if timeout(ACKNOWLEDGE_TIMEOUT, join_all(drains)).await.is_err() {
        warn!("left the first participant before all that it had sent was acknowledged");
    }
    previous.leave().await;
    Ok(())
}
