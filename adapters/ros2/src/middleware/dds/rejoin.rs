//! Works around two faults of `rustdds` 0.15.1. Once a release has the patches beside this file,
//! this module goes, and [`Domain`] is one participant.
//!
//! - **A step back of the wall clock** (`0002-best-effort-after-a-step-back.patch`). It reads what
//!   comes over best effort, the announcements of participants with it, up to the present time of
//!   day, and would read nothing until the clock has caught up with the latest sample.
//! - **A stop and continue of the process** (`0001-interrupted-waits.patch`). Its threads end when
//!   their waits are interrupted.
//!
//! A new participant has no such samples and its own threads. So everything is created once more in
//! a second participant. It takes over when it has met the peers that the first one knows, and they
//! have met its publishers. The first one is left when they have met its subscriptions
//! ([`handover`]).
//!
//! The work-arounds for other faults of `rustdds` stay beside what they protect:
//!
//! - `REPAIRS` in `dds.rs`: publishers offer a short deadline, so that lost datagrams of an image
//!   do not hold up its topic for ten seconds.
//! - `LOOK` in `dds.rs`: each wait for a publisher's status is short, because the end of the event
//!   loop wakes nobody.
//! - `Endpoint::follows` in `end.rs`: a new subscription takes over only once it keeps up, because
//!   `rustdds` assembles at most 128 fragmented messages at a time.
//! - `REMEMBERED` in `node.rs`: the node remembers more requests than a service's depth, because
//!   `rustdds` may keep more.
//! - `until_met` in `handover.rs`: it leaves out transient-local topics, because `rustdds` would
//!   let later subscribers wait for its sample.
//! - `log` in `main.rs`: the filters hide errors that `rustdds` logs about harmless events.

mod handover;
mod participants;
mod recent;
mod wall_clock;

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::future::join_all;
use rustdds::dds::CreateResult;
use tokio::sync::Notify;
use tokio::task::{JoinSet, spawn_blocking};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout_at};
use tracing::{error, info, warn};

pub(super) use self::handover::{OpenSubscription, until_met};
use self::participants::FormerParticipant;
pub(super) use self::participants::{DomainHandle, InUse, JoinedParticipant, Loss, NewEntity};
pub(super) use self::recent::RecentIds;
use self::wall_clock::WallClock;
use crate::error::NodeError;

/// The time from one look at the wall clock to the next.
const CLOCK_PERIOD: Duration = Duration::from_millis(20);

/// The time from one check for the second participant's peers to the next.
const MATCH_PERIOD: Duration = Duration::from_millis(20);

/// The time that peers have to meet the second participant, once before it takes over and once
/// after. `rustdds` announces a participant every ten seconds; what a peer then knows of it is
/// complete a second or so later.
pub(super) const PATIENCE: Duration = Duration::from_secs(15);

/// The same if the first participant is lost: nothing is sent until the second one has taken over.
const LOST_PATIENCE: Duration = Duration::from_secs(3);

/// Both participants stay at least this long, once before the second takes over and once after:
/// peers that acknowledge nothing meet it later than it meets them, and what they sent to the first
/// is still on its way.
const OVERLAP: Duration = Duration::from_millis(1500);

/// The pause after a failure.
const RETRY_PERIOD: Duration = Duration::from_secs(3);

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
        spawn(&mut rejoining, handle.clone(), needed, wall_clock);
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

/// Rejoins by `tasks` whenever that is `needed`, as when the clock stepped back.
fn spawn(tasks: &mut JoinSet<()>, domain: DomainHandle, needed: Arc<Notify>, clock: WallClock) {
    tasks.spawn(watch(clock, Arc::clone(&needed)));
    tasks.spawn(async move {
        // Beside the next rejoining, which a step may need at once.
        let mut leaving = JoinSet::new();
        loop {
            needed.notified().await;
            let former = loop {
                match rejoin(&domain, &needed).await {
                    Ok(Attempt::Joined(former)) => break former,
                    Ok(Attempt::Outdated(next)) => {
                        leaving.spawn(next.leave());
                    }
                    Err(error) => {
                        error!(%error, "the domain cannot be joined again; trying once more");
                        sleep(RETRY_PERIOD).await;
                    }
                }
            };
            info!("joined the domain again");
            leaving.spawn(former.leave(OVERLAP));
            while leaving.try_join_next().is_some() {}
        }
    });
}

/// Runs beside the rejoining: a step while that is under way needs another.
async fn watch(mut clock: WallClock, needed: Arc<Notify>) {
    let mut period = interval(CLOCK_PERIOD);
    period.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        period.tick().await;
        if clock.stepped_back(SystemTime::now()) {
            warn!("the wall clock stepped back: joining the domain again");
            needed.notify_one();
        }
    }
}

/// The end of an attempt to join the domain again.
enum Attempt {
    /// The second participant has taken over from this one.
    Joined(FormerParticipant),
    /// The second participant is of no use, because the clock stepped back before it had met all
    /// peers. It may never read their announcements.
    Outdated(JoinedParticipant),
}

/// Lets a second participant take over from the first one, unless another is `needed` first.
async fn rejoin(domain: &DomainHandle, needed: &Notify) -> Result<Attempt, NodeError> {
    let creating = domain.clone();
    // Not on this thread, which serves deadlines.
    let created = spawn_blocking(move || creating.create_again()).await;
    let (next, entities) =
        created.map_err(|error| NodeError::System(std::io::Error::other(error)))??;
    let end = Instant::now() + if domain.is_lost() { LOST_PATIENCE } else { PATIENCE };
    while Instant::now() < end && !entities.iter().all(NewEntity::is_matched) {
        tokio::select! {
            () = needed.notified() => return Ok(Attempt::Outdated(next)),
            () = sleep(MATCH_PERIOD) => {}
        }
    }
    // What follows is reliable, so a step no longer matters to it.
    let met = join_all(entities.iter().map(NewEntity::met));
    let (_, ()) = tokio::join!(timeout_at(end, met), sleep(OVERLAP));
    domain.take_over(next, entities).map(Attempt::Joined)
}

#[cfg(test)]
mod tests {
    use std::future::ready;

    use tokio::sync::{mpsc, watch};
    use tokio::time::timeout;

    use super::*;
    use crate::middleware::Publish;
    use crate::raw::Payload;
    use crate::settings::Qos;

    const DOMAIN: u16 = 80;
    const TYPE: &str = "tests/msg/Number";
    const RELIABLE: Qos = Qos { reliable: true, transient_local: false, depth: 1000 };

    /// Joins a domain, and rejoins it whenever that is needed. A participant has met its peers if
    /// `meets` returns `true` for its number. Returns the count of participants that were created,
    /// and the numbers of those that took over.
    fn rejoining(
        meets: fn(u32) -> bool,
    ) -> (Domain, Arc<Notify>, watch::Receiver<u32>, mpsc::UnboundedReceiver<u32>) {
        let needed = Arc::new(Notify::new());
        let handle = DomainHandle::join(DOMAIN + 1, true, Arc::clone(&needed)).unwrap();
        let (sender, taken_over) = mpsc::unbounded_channel();
        let (last, created) = watch::channel(0);
        handle
            .create(move |_| {
                let sender = sender.clone();
                let number = *last.borrow();
                last.send_replace(number + 1);
                let entity = NewEntity::new(move || sender.send(number).unwrap());
                Ok(entity.once(move || meets(number)))
            })
            .unwrap();
        let (mut rejoining, clock) = (JoinSet::new(), WallClock::new(SystemTime::now()));
        spawn(&mut rejoining, handle.clone(), Arc::clone(&needed), clock);
        (Domain { handle, rejoining }, needed, created, taken_over)
    }

    /// D13.
    #[tokio::test(start_paused = true)]
    async fn step_before_peers_are_met_joins_once_more() {
        // After a second step, the participant with number 1 reads no announcements.
        let (domain, needed, mut created, mut taken_over) = rejoining(|number| number != 1);
        assert_eq!(taken_over.recv().await, Some(0));
        needed.notify_one();
        created.wait_for(|count| *count == 2).await.unwrap();
        sleep(10 * MATCH_PERIOD).await;
        needed.notify_one();
        assert_eq!(taken_over.recv().await, Some(2));
        domain.leave().await;
    }

    /// D13.
    #[tokio::test(start_paused = true)]
    async fn step_after_peers_are_met_joins_afterwards() {
        let (domain, needed, mut created, mut taken_over) = rejoining(|_| true);
        assert_eq!(taken_over.recv().await, Some(0));
        needed.notify_one();
        created.wait_for(|count| *count == 2).await.unwrap();
        sleep(10 * MATCH_PERIOD).await;
        needed.notify_one();
        assert_eq!(taken_over.recv().await, Some(1));
        assert_eq!(taken_over.recv().await, Some(2));
        domain.leave().await;
    }

    /// A message of this many bytes that has a number.
    fn number(number: u32, bytes: usize) -> Payload {
        let mut body = number.to_be_bytes().to_vec();
        body.resize(bytes, 0);
        Payload { big_endian: true, body: body.into() }
    }

    /// D13.
    #[tokio::test]
    async fn what_is_sent_over_a_reliable_topic_while_either_side_rejoins_comes_once() {
        each_comes_once_while_either_side_rejoins("numbers", 4).await;
    }

    /// D13.
    #[tokio::test]
    async fn fragmented_messages_come_once_while_rejoining() {
        each_comes_once_while_either_side_rejoins("fragments", 10_000).await;
    }

    async fn each_comes_once_while_either_side_rejoins(name: &str, bytes: usize) {
        let topic = format!("/{name}_of_{}", std::process::id());
        let [sending, receiving] = [(); 2].map(|()| Domain::join(DOMAIN, true).unwrap());
        let (sender, mut received) = mpsc::unbounded_channel();
        let end = receiving.handle().subscribe(&topic, TYPE, RELIABLE, move |sample| {
            sender.send(sample.unwrap()).unwrap();
            ready(())
        });
        let (end, publisher) =
            (end.unwrap(), sending.handle().publisher(&topic, TYPE, RELIABLE).unwrap());
        while end.matched() == 0 || publisher.matched() == 0 {
            sleep(MATCH_PERIOD).await;
        }
        // A sample right after discovery may come before the writer's first heartbeat.
        sleep(OVERLAP).await;
        let domains = [receiving.handle(), sending.handle()];
        let rejoins = async move {
            for domain in &domains {
                let joined = rejoin(domain, &Notify::new()).await.unwrap();
                let Attempt::Joined(former) = joined else { panic!("nothing stepped") };
                former.leave(OVERLAP).await;
            }
        };
        tokio::pin!(rejoins);
        let mut sent = 0;
        let mut is_rejoining = true;
        while is_rejoining {
            assert!(publisher.publish(number(sent, bytes)), "the number {sent} is not sent");
            sent += 1;
            tokio::select! {
                () = &mut rejoins => is_rejoining = false,
                () = sleep(Duration::from_millis(5)) => {}
            }
        }
        let mut payloads = Vec::new();
        while let Ok(payload) = timeout(2 * OVERLAP, received.recv()).await {
            payloads.push(payload.unwrap().body);
        }
        payloads.sort_unstable();
        let expected: Vec<_> = (0..sent).map(|sent| number(sent, bytes).body).collect();
        assert!(payloads == expected, "{} of {sent} came", payloads.len());
        assert_eq!((end.matched(), publisher.matched()), (1, 1));
        sending.leave().await;
        receiving.leave().await;
    }
}
