//! The link of a run: one uplink and one downlink, each with a queue, that all of its requests and
//! replies share.

use std::future;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::lock;
use fuseline_evaluation::link::{LinkWidth, RecordedLink};
use fuseline_testkit::networks::Drive;
use fuseline_tokio::deadline::{LinkDirection, LinkQueue};
use fuseline_tokio::{Call, Error};
use fuseline_traces::nanos;
use tokio::time::{Instant, sleep_until};

/// The link of a run from now on; clones are the same one.
#[derive(Clone)]
pub(crate) struct EmulatedLink(Arc<EmulatedLinkState>);

struct EmulatedLinkState {
    width: LinkWidth,
    drive: Option<(Drive, Duration)>,
    start: Instant,
    queues: Mutex<[LinkQueue; 2]>,
}

impl EmulatedLink {
    /// Returns a link with the rates of `drive`, from an instant in it, where it has them.
    pub(crate) fn new(width: LinkWidth, drive: Option<(Drive, Duration)>) -> Self {
        let queues = Mutex::new([LinkQueue::new(width.queue_bytes); 2]);
        Self(Arc::new(EmulatedLinkState { width, drive, start: Instant::now(), queues }))
    }

    /// Makes a call over this link, for a request and a reply of this many bytes.
    ///
    /// A request that finds no room fails; a reply that finds none is lost, so that its call ends
    /// when it is due. The time in the uplink is taken from the call's deadline.
    pub(crate) async fn carry<Res>(
        &self,
        [request_bytes, reply_bytes]: [usize; 2],
        mut call: Call,
        send: impl AsyncFnOnce(Call) -> Result<Res, Error>,
    ) -> Result<Res, Error> {
        let begun = Instant::now();
        if !self.pass(LinkDirection::Uplink, request_bytes).await {
            return Err("the uplink's queue is full".into());
        }
        call.deadline = call.deadline.saturating_sub(begun.elapsed());
        let reply = send(call).await?;
        if !self.pass(LinkDirection::Downlink, reply_bytes).await {
            future::pending::<()>().await;
        }
        Ok(reply)
    }

    /// Waits until a message of this many bytes is through; `false` if it finds no room.
    ///
    /// A message that a queue has taken is sent, also if its call is given up.
    async fn pass(&self, direction: LinkDirection, bytes: usize) -> bool {
        let Some(takes) = self.0.send(direction, bytes as u64) else { return false };
        // Without a limit it waits for nothing, not even a tick of the timer.
        if !takes.is_zero() {
            match Instant::now().checked_add(takes) {
                Some(through) => sleep_until(through).await,
                None => future::pending().await,
            }
        }
        true
    }
}

impl EmulatedLinkState {
    /// Returns how long a message takes that is given to the queue now, or `None` if it finds no
    /// room.
    fn send(&self, direction: LinkDirection, bytes: u64) -> Option<Duration> {
        let drive = self.drive.as_ref().map(|(drive, start)| (drive, *start));
        let link = RecordedLink { width: self.width, drive };
        let mut queues = lock(&self.queues);
        let now = nanos(self.start.elapsed());
        let through = link.send(direction, &mut queues[direction as usize], now, bytes)?;
        Some(Duration::from_nanos(through.saturating_sub(now)))
    }
}

#[cfg(test)]
mod tests {
    use fuseline_tokio::{Config, Local, Operator, Setup, spawn, stream};
    use tokio::time::{sleep, timeout};

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// 8 Mbit/s each way, which is a byte in a microsecond.
    fn link(queue_bytes: u64) -> EmulatedLink {
        let rate = Some(8_000_000);
        EmulatedLink::new(LinkWidth { uplink: rate, downlink: rate, queue_bytes }, None)
    }

    #[tokio::test(start_paused = true)]
    async fn link_has_a_queue_for_each_way() {
        let (link, start) = (link(10_000), Instant::now());
        let (up, down) = (LinkDirection::Uplink, LinkDirection::Downlink);
        let sent = tokio::join!(
            link.pass(up, 5_000),
            link.pass(up, 5_000),
            link.pass(down, 9_000),
            link.pass(up, 1_000)
        );
        assert_eq!(sent, (true, true, true, false), "10 KB may wait");
        assert_eq!(start.elapsed(), 10 * MS);
    }

    #[tokio::test(start_paused = true)]
    async fn queue_sends_what_was_given_up() {
        let link = link(400_000);
        assert!(timeout(MS, link.pass(LinkDirection::Uplink, 50_000)).await.is_err());
        let start = Instant::now();
        assert!(link.pass(LinkDirection::Uplink, 1_000).await);
        assert_eq!(start.elapsed(), 50 * MS);
    }

    /// An operator whose cloud takes 10 ms behind a link.
    struct Linked(EmulatedLink);

    impl Operator for Linked {
        type Input = ();
        type Output = Option<Duration>;

        fn setup(self, setup: &mut Setup<(), Option<Duration>>) -> Local<(), Option<Duration>> {
            let handle = move |(), call: Call| {
                let link = self.0.clone();
                async move {
                    let send = async |call: Call| {
                        sleep(10 * MS).await;
                        Ok(Some(call.deadline))
                    };
                    link.carry([30_000, 1_000], call, send).await
                }
            };
            setup.use_cloud(handle, |(), _| Some(((), 90 * MS)), Ok, 1);
            Local::future(|_, _| async { Ok(None) })
        }
    }

    /// The first reply finds a full downlink; the uplink takes 30 ms of the second's 90.
    #[tokio::test(start_paused = true)]
    async fn reply_without_room_is_lost() {
        let link = link(50_000);
        let (mut writer, input) = stream(8);
        let (_running, mut items) = spawn(Linked(link.clone()), Config::default(), input).unwrap();
        for (bytes, left, took) in [(140_000, None, 90 * MS), (0, Some(60 * MS), 41 * MS)] {
            let other = link.clone();
            tokio::spawn(async move { other.pass(LinkDirection::Downlink, bytes).await });
            writer.write(()).unwrap();
            let item = items.read().await.unwrap();
            assert_eq!((item.value(), item.latency()), (Some(&left), took));
            sleep(200 * MS).await;
        }
    }
}
