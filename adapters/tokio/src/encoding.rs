//! [`encoding`]: a handle that encodes on a thread where blocking is allowed, before it calls.

use std::sync::Arc;

use futures_util::future::BoxFuture;
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::Instant;

use crate::Error;
use crate::call::Call;
use crate::panics::panicked;

/// A handle for [`use_cloud`](crate::Setup::use_cloud) that first lets `encode` make the request of what the message
/// handler returns, on one of the runtime's threads for blocking work, then calls `handle` with it.
///
/// Encoding holds up neither the operator nor other calls. It takes its part of the deadline: `handle` is given the time that
/// is left. An error or a panic is a failure (F4). A call that is aborted before its encoding began does not begin it; one that
/// has begun runs on to its end, and the runtime waits for it when it is shut down.
///
/// ```
/// # use fuseline_tokio::{Call, Error, encoding};
/// async fn send(jpeg: Vec<u8>, call: Call) -> Result<usize, Error> {
///     Ok(jpeg.len()) // over the network
/// }
/// let handle = encoding(|frame: Vec<u8>| Ok(frame), send);
/// # let _: &dyn Fn(Vec<u8>, Call) -> _ = &handle;
/// ```
pub fn encoding<Raw, Req, Res, Fut>(
    encode: impl Fn(Raw) -> Result<Req, Error> + Send + Sync + 'static,
    handle: impl Fn(Req, Call) -> Fut + Send + Sync + 'static,
) -> impl Fn(Raw, Call) -> BoxFuture<'static, Result<Res, Error>> + Send + Sync + 'static
where
    Raw: Send + 'static,
    Req: Send + 'static,
    Fut: Future<Output = Result<Res, Error>> + Send + 'static,
{
    let both = Arc::new((encode, handle));
    move |raw, mut call| {
        let both = Arc::clone(&both);
        Box::pin(async move {
            let begin = Instant::now();
            let shared = Arc::clone(&both);
            let mut encoding = AbortedOnDrop(spawn_blocking(move || (shared.0)(raw)));
            let request = match (&mut encoding.0).await {
                Ok(request) => request?,
                Err(error) => match error.try_into_panic() {
                    Ok(panic) => return Err(panicked(&*panic)),
                    Err(error) => return Err(error.into()),
                },
            };
            call.deadline = call.deadline.saturating_sub(begin.elapsed());
            (both.1)(request, call).await
        })
    }
}

/// An encoding that does not begin once nobody waits for it.
struct AbortedOnDrop<T>(JoinHandle<T>);

impl<T> Drop for AbortedOnDrop<T> {
    fn drop(&mut self) {
        self.0.abort();
    }
}
