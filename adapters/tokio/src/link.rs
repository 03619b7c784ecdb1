//! A vehicle's link of finite width, emulated: the requests and replies of all its operators wait for each other.

use std::fmt;
use std::future;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_deadline::{LinkDirection, LinkQueue, LinkRate};
use fuseline_engine::{lock, nanos};
use futures_util::future::BoxFuture;
use tokio::time::{Instant, sleep_until};

use crate::Error;
use crate::call::Call;

/// An emulated link; clones are the same one, for all clouds and operators of a vehicle.
///
/// Each direction is a [`LinkQueue`]: a message waits for those before it and for its own bytes. What a queue has taken is
/// sent, also for a call that is given up.
///
/// ```
/// # use fuseline_tokio::{Call, EmulatedLink, Error, deadline::LinkRate};
/// # async fn detect(_: Vec<u8>, _: Call) -> Result<Vec<u8>, Error> { Ok(Vec::new()) }
/// # async fn segment(_: Vec<u8>, _: Call) -> Result<Vec<u8>, Error> { Ok(Vec::new()) }
/// // 10 Mbit/s each way; 4 MB may wait.
/// let link = EmulatedLink::new(4_000_000, |_, _| Some(LinkRate::constant(10_000_000)));
/// // Handles for `use_cloud`, of two operators: 33.3 KB and 300 KB for each request, 1 KB for each reply.
/// let detect = link.handle([33_300, 1_000], detect);
/// let segment = link.handle([300_000, 1_000], segment);
/// # let _ = (detect, segment);
/// ```
#[derive(Clone)]
pub struct EmulatedLink(Arc<EmulatedLinkState>);

struct EmulatedLinkState {
    start: Instant,
    rate: Box<LinkRateSource>,
    /// Up and down.
    queues: Mutex<[LinkQueue; 2]>,
}

type LinkRateSource = dyn Fn(LinkDirection, u64) -> Option<LinkRate> + Send + Sync;

impl EmulatedLink {
    /// A link whose time begins now, with room for so many bytes in each queue.
    ///
    /// `rate` is what a direction carries at an instant, in ns since the beginning; `None` is no limit.
    #[must_use]
    pub fn new(
        queue_bytes: u64,
        rate: impl Fn(LinkDirection, u64) -> Option<LinkRate> + Send + Sync + 'static,
    ) -> Self {
        let queues = Mutex::new([LinkQueue::new(queue_bytes); 2]);
        Self(Arc::new(EmulatedLinkState { start: Instant::now(), rate: Box::new(rate), queues }))
    }

    /// Waits until a message of so many bytes is through; whether it found room.
    pub async fn pass(&self, direction: LinkDirection, bytes: usize) -> bool {
        let Some(takes) = self.0.send(direction, bytes) else { return false };
        // Without a limit there is nothing to wait for, not even a tick of the timer.
        if !takes.is_zero() {
            match Instant::now().checked_add(takes) {
                Some(through) => sleep_until(through).await,
                None => future::pending().await,
            }
        }
        true
    }

    /// A handle behind this link, for requests and replies of so many bytes.
    ///
    /// A request that finds no room fails; a reply that finds none is lost, so that its call ends when it is due. The time in
    /// the uplink is taken from the call's deadline.
    pub fn handle<Req, Res, Fut>(
        &self,
        [request_bytes, reply_bytes]: [usize; 2],
        handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
    ) -> impl Fn(Req, Call) -> BoxFuture<'static, Result<Res, Error>> + Send + Sync + 'static
    where
        Req: Send + 'static,
        Res: Send + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let (link, handle) = (self.clone(), Arc::new(handle));
        move |request, mut call| {
            let (link, handle) = (link.clone(), Arc::clone(&handle));
            Box::pin(async move {
                let begun = Instant::now();
                if !link.pass(LinkDirection::Uplink, request_bytes).await {
                    return Err("the uplink's queue is full".into());
                }
                call.deadline = call.deadline.saturating_sub(begun.elapsed());
                let reply = handle(request, call).await?;
                if !link.pass(LinkDirection::Downlink, reply_bytes).await {
                    future::pending::<()>().await;
                }
                Ok(reply)
            })
        }
    }
}

impl EmulatedLinkState {
    /// How long a message takes that is given to a queue now; none if it finds no room.
    fn send(&self, direction: LinkDirection, bytes: usize) -> Option<Duration> {
        let mut queues = lock(&self.queues);
        let now = nanos(self.start.elapsed());
        let Some(free) = (self.rate)(direction, now) else { return Some(Duration::ZERO) };
        let rate = |at| (self.rate)(direction, at).unwrap_or(free);
        let through = queues[direction as usize].send(now, bytes as u64, rate)?;
        Some(Duration::from_nanos(through.saturating_sub(now)))
    }
}

impl fmt::Debug for EmulatedLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EmulatedLink").finish_non_exhaustive()
    }
}
