//! A network between an operator and a cloud, emulated: calls take its round trip besides their own time.

use std::fmt;
use std::future;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use futures_util::future::BoxFuture;
use tokio::time::{Instant, sleep};

use crate::Error;
use crate::call::Call;

/// An emulated network; clones are the same one. An [`EmulatedLink`](crate::EmulatedLink) adds a width.
///
/// A call takes the round trip of the moment at which it is made: half of it on the way there, half on the way back.
///
/// ```
/// use fuseline_testkit::networks::Drive;
/// # use fuseline_tokio::{Call, EmulatedNetwork, Error};
/// # async fn detect(_: Vec<u8>, _: Call) -> Result<Vec<u8>, Error> { Ok(Vec::new()) }
///
/// // A recorded one, from its second minute on.
/// let drive = Drive::load("cicv5g/rural_n8_v10")?;
/// let start = std::time::Duration::from_secs(60);
/// let network = EmulatedNetwork::new(move |moment| drive.round_trip(start + moment));
/// let handle = network.handle(detect); // for `use_cloud`
/// # let _: &dyn Fn(Vec<u8>, Call) -> _ = &handle;
/// # Ok::<(), fuseline_testkit::networks::DriveError>(())
/// ```
#[derive(Clone)]
pub struct EmulatedNetwork(Arc<EmulatedNetworkState>);

struct EmulatedNetworkState {
    /// When its time began.
    start: OnceLock<Instant>,
    round_trip: Box<RoundTripSource>,
}

type RoundTripSource = dyn Fn(Duration) -> Option<Duration> + Send + Sync;

impl EmulatedNetwork {
    /// A network whose time begins with its first call, or with [`begin`](Self::begin).
    ///
    /// `round_trip` is how long after a moment of its time what is sent then is back; `None` is never.
    #[must_use]
    pub fn new(round_trip: impl Fn(Duration) -> Option<Duration> + Send + Sync + 'static) -> Self {
        let round_trip = Box::new(round_trip);
        Self(Arc::new(EmulatedNetworkState { start: OnceLock::new(), round_trip }))
    }

    /// Begins its time now, if it has not begun.
    pub fn begin(&self) {
        self.0.start.get_or_init(Instant::now);
    }

    /// The round trip of what is sent now; none if it never is back.
    #[must_use]
    pub fn round_trip(&self) -> Option<Duration> {
        (self.0.round_trip)(self.0.start.get_or_init(Instant::now).elapsed())
    }

    /// A handle behind this network. The time on the way there is taken from the call's deadline. A call that is never back
    /// waits until it is aborted.
    pub fn handle<Req, Res, Fut>(
        &self,
        handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
    ) -> impl Fn(Req, Call) -> BoxFuture<'static, Result<Res, Error>> + Send + Sync + 'static
    where
        Req: Send + 'static,
        Res: Send + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let (network, handle) = (self.clone(), Arc::new(handle));
        move |request, mut call| {
            let (network, handle) = (network.clone(), Arc::clone(&handle));
            Box::pin(async move {
                let [there, back] = network.ways().await;
                sleep(there).await;
                call.deadline = call.deadline.saturating_sub(there);
                let reply = handle(request, call).await;
                sleep(back).await;
                reply
            })
        }
    }

    /// How long a call that is made now takes there and back; never ready if it never is back.
    pub(crate) async fn ways(&self) -> [Duration; 2] {
        match self.round_trip() {
            Some(round_trip) => {
                let there = round_trip / 2;
                [there, round_trip.saturating_sub(there)]
            }
            None => future::pending().await,
        }
    }
}

impl fmt::Debug for EmulatedNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EmulatedNetwork").finish_non_exhaustive()
    }
}
