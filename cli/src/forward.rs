//! A recorded network before a real server.
//!
//! [`forward`] reads HTTP/2 and nothing of gRPC: it passes headers, data and trailers on as they
//! come, each as late as the network has it. A call that ends on one side ends on the other.

use std::convert::Infallible;
use std::future::{self, poll_fn};
use std::pin::{Pin, pin};
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::Bytes;
use fuseline_testkit::networks::Drive;
use fuseline_tokio::Error;
use fuseline_tokio::grpc::tonic::Status;
use fuseline_tokio::grpc::tonic::body::Body;
use fuseline_tokio::grpc::tonic::codegen::Service;
use fuseline_tokio::grpc::{Connection, Remote, RemoteError};
use http::{Request, Response};
use http_body::Frame;
use hyper::body::Incoming;
use hyper::server::conn::http2::Builder;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, Sleep, sleep, sleep_until};
use tracing::{debug, warn};

/// At most this many frames of a call may be on their way; then its sender waits.
const FRAMES: usize = 1024;
/// No connection is accepted for this long after the system had no room for one more.
const BREATH: Duration = Duration::from_millis(100);

/// A recorded network; its time begins with the first call.
pub(crate) struct RecordedNetwork {
    drive: Drive,
    /// The time of the drive at which it begins.
    start: Duration,
    began: OnceLock<Instant>,
}

/// Forwards each call that comes to `listener` to `remote`, behind `network`, until `until` is
/// ready.
///
/// A call takes the round trip of the moment at which it comes: each part of its request half of it
/// on the way there, each part of its response the other half. Metadata, deadlines, statuses and
/// the ends of calls pass through, whatever service it is; `:authority` becomes the remote's. If
/// the remote cannot be reached, calls fail `UNAVAILABLE`. Clients are not bounded as
/// [`serve`](fuseline_tokio::grpc::serve) bounds them.
///
/// # Errors
/// If the remote's settings cannot work.
pub(crate) async fn forward(
    remote: &Remote,
    network: RecordedNetwork,
    listener: TcpListener,
    until: impl Future<Output = ()>,
) -> Result<(), RemoteError> {
    let (connection, network) = (remote.connect()?, Arc::new(network));
    let mut connections = JoinSet::new();
    let mut until = pin!(until);
    loop {
        tokio::select! {
            () = &mut until => return Ok(()),
            accepted = listener.accept() => match accepted {
                Ok((socket, _)) => {
                    let _ = socket.set_nodelay(true);
                    let network = Arc::clone(&network);
                    connections.spawn(forward_connection(socket, connection.clone(), network));
                }
                Err(error) => {
                    warn!(%error, "a connection cannot be accepted");
                    sleep(BREATH).await;
                }
            },
            Some(_) = connections.join_next() => {}
        }
    }
}

impl RecordedNetwork {
    pub(crate) const fn new(drive: Drive, start: Duration) -> Self {
        Self { drive, start, began: OnceLock::new() }
    }

    /// Returns how long a call that is made now takes there and back. It is never ready if the call
    /// does not come back.
    async fn ways(&self) -> [Duration; 2] {
        let moment = self.began.get_or_init(Instant::now).elapsed();
        match self.drive.round_trip(self.start + moment) {
            Some(round_trip) => {
                let there = round_trip / 2;
                [there, round_trip.saturating_sub(there)]
            }
            None => future::pending().await,
        }
    }
}

async fn forward_connection(
    socket: TcpStream,
    connection: Connection,
    network: Arc<RecordedNetwork>,
) {
    let service = service_fn(move |request| {
        let (connection, network) = (connection.clone(), Arc::clone(&network));
        async move { Ok::<_, Infallible>(forward_call(request, connection, &network).await) }
    });
    let builder = Builder::new(TokioExecutor::new());
    if let Err(error) = builder.serve_connection(TokioIo::new(socket), service).await {
        debug!(%error, "a connection broke");
    }
}

/// Forwards one call; a caller that gives it up drops it, and with it the call behind.
async fn forward_call(
    request: Request<Incoming>,
    mut connection: Connection,
    network: &RecordedNetwork,
) -> Response<Body> {
    let [there, back] = network.ways().await;
    let (head, body) = request.into_parts();
    let body = on_the_way(body, there);
    sleep(there).await;
    let called = async {
        // The cause is kept.
        poll_fn(|context| connection.poll_ready(context)).await?;
        connection.call(Request::from_parts(head, body)).await
    };
    match called.await {
        Ok(response) => {
            let (head, body) = response.into_parts();
            let body = on_the_way(body, back);
            sleep(back).await;
            Response::from_parts(head, body)
        }
        Err(error) => {
            sleep(back).await;
            Status::from_error(error.into()).into_http()
        }
    }
}

/// Delays each frame of a body, and its end, by this time.
fn on_the_way<B>(mut body: B, late: Duration) -> Body
where
    B: http_body::Body<Data = Bytes> + Send + Unpin + 'static,
    B::Error: Into<Error>,
{
    // A reply that ends with its headers does so on the other side too: an error of gRPC without a
    // message does.
    if body.is_end_stream() {
        return Body::empty();
    }
    let (sender, frames) = mpsc::channel(FRAMES);
    tokio::spawn(async move {
        loop {
            let frame = tokio::select! {
                frame = poll_fn(|context| Pin::new(&mut body).poll_frame(context)) => frame,
                () = sender.closed() => return,
            };
            let frame = frame.map(|it| it.map_err(|error| Status::from_error(error.into())));
            let is_last = frame.as_ref().is_none_or(Result::is_err);
            if sender.send((Instant::now() + late, frame)).await.is_err() || is_last {
                return;
            }
        }
    });
    Body::new(DelayedBody { frames, next: None })
}

/// A frame or the end.
type FrameOrEnd = Option<Result<Frame<Bytes>, Status>>;
/// A frame on its way, with the instant of its arrival.
type DelayedFrame = (Instant, FrameOrEnd);

/// The other end of [`on_the_way`].
struct DelayedBody {
    frames: mpsc::Receiver<DelayedFrame>,
    next: Option<(Pin<Box<Sleep>>, FrameOrEnd)>,
}

impl http_body::Body for DelayedBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        if self.next.is_none() {
            let Some((due, frame)) = ready!(self.frames.poll_recv(context)) else {
                return Poll::Ready(None);
            };
            self.next = Some((Box::pin(sleep_until(due)), frame));
        }
        if let Some((arrival, _)) = &mut self.next {
            ready!(arrival.as_mut().poll(context));
        }
        Poll::Ready(self.next.take().and_then(|(_, frame)| frame))
    }
}

#[cfg(test)]
mod tests;
