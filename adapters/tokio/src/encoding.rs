//! [`EncodeOnce`] encodes messages on a thread where blocking is allowed, before they are sent.

use std::error;
use std::fmt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::lock;
use futures_util::FutureExt;
use futures_util::future::{BoxFuture, Shared, WeakShared};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::Instant;

use crate::Error;
use crate::call::Call;
use crate::panics::panicked;

/// Encodes each message once for all clouds of an operator, on one of the runtime's threads for
/// blocking work.
///
/// The first call of a message begins the encoding. The others wait for it and get clones of the
/// request. Encoding holds up neither the operator nor other calls. It takes time from the
/// deadline, so each handle is given the time that is left. An error or a panic is a failure (F4).
/// An encoding does not begin once all its calls were aborted. Once begun it runs to its end, and
/// the runtime waits for it when it is shut down. Clones share the encodings.
///
/// ```
/// # use std::{sync::Arc, time::Duration};
/// # use fuseline_tokio::{Call, EncodeOnce, Error, Setup};
/// # struct Frame { pixels: Arc<[u8]> }
/// # fn jpeg(pixels: &[u8]) -> Result<Vec<u8>, Error> { Ok(pixels.to_vec()) }
/// # async fn west(_: Arc<Vec<u8>>, _: Call) -> Result<u8, Error> { Ok(1) }
/// # async fn east(_: Arc<Vec<u8>>, _: Call) -> Result<u8, Error> { Ok(2) }
/// # fn setup(setup: &mut Setup<Frame, u8>) {
/// let once = EncodeOnce::new(|pixels: Arc<[u8]>| jpeg(&pixels).map(Arc::new));
/// let send = |frame: &Frame, _| Some((Arc::clone(&frame.pixels), Duration::from_millis(500)));
/// setup.use_cloud(once.handle(west), once.message_handler(send), Ok, 1);
/// setup.use_cloud(once.handle(east), once.message_handler(send), Ok, 2);
/// # }
/// ```
pub struct EncodeOnce<Raw, Req>(Arc<EncodeOnceState<Raw, Req>>);

/// A request that is encoded once, for all calls of its message; it goes from
/// [`EncodeOnce::message_handler`] to [`EncodeOnce::handle`].
#[derive(Clone)]
pub struct EncodedRequest<Req>(SharedEncoding<Req>);

struct EncodeOnceState<Raw, Req> {
    encode: Encode<Raw, Req>,
    latest: Mutex<Option<LatestEncoding<Req>>>,
}

type Encode<Raw, Req> = Arc<dyn Fn(Raw) -> Result<Req, Error> + Send + Sync>;
type SharedEncoding<Req> = Shared<BoxFuture<'static, Result<Req, SharedError>>>;

/// The encoding of the latest message, for as long as a request holds it.
struct LatestEncoding<Req> {
    /// The timestamp, and the address of the message: another operator's message of the same
    /// timestamp has another address.
    message: (u64, usize),
    encoding: WeakShared<BoxFuture<'static, Result<Req, SharedError>>>,
}

/// An error of an encoding, which each call that waited for it gets.
#[derive(Clone, Debug)]
struct SharedError(Arc<dyn error::Error + Send + Sync>);

impl<Raw: Send + 'static, Req: Clone + Send + Sync + 'static> EncodeOnce<Raw, Req> {
    /// Creates an encoder that calls `encode`. Make its requests cheap to clone, as an `Arc` or
    /// `Bytes` is.
    pub fn new(encode: impl Fn(Raw) -> Result<Req, Error> + Send + Sync + 'static) -> Self {
        Self(Arc::new(EncodeOnceState { encode: Arc::new(encode), latest: Mutex::new(None) }))
    }

    /// Wraps a message handler that returns what is to be encoded. Only the value that the first
    /// cloud's handler returns for a message is encoded, so the handlers of all clouds must return
    /// the same.
    pub fn message_handler<M, Handler>(
        &self,
        mut handler: Handler,
    ) -> impl FnMut(&M, u64) -> Option<(EncodedRequest<Req>, Duration)> + Send + use<Raw, Req, M, Handler>
    where
        Handler: FnMut(&M, u64) -> Option<(Raw, Duration)> + Send + 'static,
    {
        let once = self.clone();
        move |message, timestamp| {
            let (raw, deadline) = handler(message, timestamp)?;
            let address = std::ptr::from_ref(message).addr();
            Some((EncodedRequest(once.encoding_of((timestamp, address), raw)), deadline))
        }
    }

    /// Returns a handle that waits for the request and calls `handle` with it and the time that is
    /// left. An error or a panic of the encoding is a failure of each call (F4).
    pub fn handle<Res, Fut, Handle>(
        &self,
        handle: Handle,
    ) -> impl Fn(EncodedRequest<Req>, Call) -> BoxFuture<'static, Result<Res, Error>>
    + Send
    + Sync
    + use<Raw, Req, Res, Fut, Handle>
    where
        Handle: Fn(Req, Call) -> Fut + Send + Sync + 'static,
        Fut: Future<Output = Result<Res, Error>> + Send + 'static,
    {
        let handle = Arc::new(handle);
        move |EncodedRequest(encoding), mut call| {
            let handle = Arc::clone(&handle);
            Box::pin(async move {
                let begin = Instant::now();
                let request = encoding.await?;
                take_time(&mut call, begin);
                handle(request, call).await
            })
        }
    }

    /// Returns the encoding of a message, begun when it is first waited for.
    fn encoding_of(&self, message: (u64, usize), raw: Raw) -> SharedEncoding<Req> {
        let mut latest = lock(&self.0.latest);
        let known = latest.as_ref().filter(|latest| latest.message == message);
        if let Some(encoding) = known.and_then(|latest| latest.encoding.upgrade()) {
            return encoding;
        }
        let encode = Arc::clone(&self.0.encode);
        let encoding = async move {
            let encoded = on_thread(move || encode(raw)).await;
            encoded.map_err(|error| SharedError(error.into()))
        };
        let encoding = encoding.boxed().shared();
        *latest = encoding.downgrade().map(|encoding| LatestEncoding { message, encoding });
        encoding
    }
}

impl<Raw, Req> Clone for EncodeOnce<Raw, Req> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<Raw, Req> fmt::Debug for EncodeOnce<Raw, Req> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EncodeOnce").finish_non_exhaustive()
    }
}

impl<Req> fmt::Debug for EncodedRequest<Req> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EncodedRequest").finish_non_exhaustive()
    }
}

impl fmt::Display for SharedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl error::Error for SharedError {
    fn source(&self) -> Option<&(dyn error::Error + 'static)> {
        self.0.source()
    }
}

/// Subtracts the time since `begin` from a call's deadline.
fn take_time(call: &mut Call, begin: Instant) {
    call.deadline = call.deadline.saturating_sub(begin.elapsed());
}

/// Encodes on a thread for blocking work.
async fn on_thread<Req: Send + 'static>(
    encode: impl FnOnce() -> Result<Req, Error> + Send + 'static,
) -> Result<Req, Error> {
    let mut encoding = AbortedOnDrop(spawn_blocking(encode));
    match (&mut encoding.0).await {
        Ok(request) => request,
        Err(error) => match error.try_into_panic() {
            Ok(panic) => Err(panicked(&*panic)),
            Err(error) => Err(error.into()),
        },
    }
}

/// An encoding that does not begin if nobody waits for it any more.
struct AbortedOnDrop<T>(JoinHandle<T>);

impl<T> Drop for AbortedOnDrop<T> {
    fn drop(&mut self) {
        self.0.abort();
    }
}
