//! Serves one connection, from its first byte to its end: TLS, HTTP/2 and its calls.
//!
//! It closes a connection that reaches one of the `Bounds`, and logs why. The state that all
//! connections share is in `limits`.

use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use http::{HeaderMap, Request, Response};
use hyper::body::Incoming;
use hyper::server::conn::http2::Builder;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::watch;
use tokio::time::{Instant, timeout};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::Service;

use crate::grpc::infer::InferServer;
use crate::grpc::server::connection_watch::ConnectionWatch;
use crate::grpc::server::held::{ReplyBody, RequestBody, RequestMemory};
use crate::grpc::server::limits::{ConnectionPermit, RejectReason, ServerLimits};
use crate::grpc::server::tls::TlsAcceptor;
use crate::grpc::token::AuthCheck;

/// A connection that was silent for the first duration is sent a ping, and must answer it within
/// the second.
const PING: (Duration, Duration) = (Duration::from_secs(30), Duration::from_secs(10));

/// The greatest number of calls that were cancelled before they began, which HTTP/2 keeps in a
/// queue of its own.
const UNBEGUN: usize = 64;

/// The number of streams that the client may break before its connection is closed.
const BROKEN: usize = 256;

/// The number of bytes of a stream's replies that HTTP/2 buffers itself.
const SENDING: usize = 64 * 1024;

/// A connection of any type, with or without TLS, so that the server is compiled only once.
pub(crate) trait Socket: AsyncRead + AsyncWrite + Send + Unpin {}

impl<S: AsyncRead + AsyncWrite + Send + Unpin> Socket for S {}

/// The service and the limits with which each connection is served.
#[derive(Clone)]
pub(crate) struct ConnectionHandler {
    pub(crate) limits: Arc<ServerLimits>,
    pub(crate) infer: InferServer,
    pub(crate) auth: AuthCheck,
    pub(crate) tls: Option<TlsAcceptor>,
    /// Ready when the server accepts no more calls.
    pub(crate) closing: watch::Receiver<()>,
}

impl ConnectionHandler {
    /// Serves a connection until it ends, and logs why if it had to be closed.
    pub(crate) async fn run(
        self,
        socket: Box<dyn Socket>,
        peer: SocketAddr,
        permit: ConnectionPermit,
    ) {
        let (limits, mut closing) = (Arc::clone(&self.limits), self.closing.clone());
        let since = Instant::now();
        let greeted = async {
            let Some(tls) = self.tls.clone() else { return self.serve(socket, peer, since).await };
            let greeting = timeout(limits.bounds.greeting, tls.accept(socket));
            let greeting = tokio::select! {
                greeting = greeting => greeting,
                _ = closing.changed() => return Ok(()),
            };
            let socket = greeting.map_err(|_| RejectReason::Mute)?.map_err(RejectReason::Tls)?;
            self.serve(Box::new(socket), peer, since).await
        };
        if let Err(why) = greeted.await {
            limits.log(peer, &why);
        }
        drop(permit);
    }

    async fn serve(
        self,
        socket: Box<dyn Socket>,
        peer: SocketAddr,
        since: Instant,
    ) -> Result<(), RejectReason> {
        let watch = Arc::new(ConnectionWatch::new(Arc::clone(&self.limits), peer, since));
        let (watched, mut closing) = (Arc::clone(&watch), self.closing.clone());
        let service = service_fn(move |request| {
            let (connection_handler, watch) = (self.clone(), Arc::clone(&watched));
            async move { Ok::<_, Infallible>(connection_handler.call(request, watch).await) }
        });
        let bounds = watch.limits.bounds;
        let mut builder = Builder::new(TokioExecutor::new());
        builder
            .timer(TokioTimer::new())
            .max_concurrent_streams(bounds.calls)
            .max_header_list_size(bounds.header_bytes)
            .max_pending_accept_reset_streams(UNBEGUN)
            .max_local_error_reset_streams(BROKEN)
            .max_send_buf_size(SENDING)
            .keep_alive_interval(PING.0)
            .keep_alive_timeout(PING.1);
        let mut connection = pin!(builder.serve_connection(TokioIo::new(socket), service));
        let mut is_open = true;
        loop {
            tokio::select! {
                ended = &mut connection => return ended.or_else(|error| protocol(&error)),
                why = watch.expired() => return Err(why),
                _ = closing.changed(), if is_open => {
                    is_open = false;
                    connection.as_mut().graceful_shutdown();
                }
            }
        }
    }

    /// Serves one call. It ends the call at its deadline.
    async fn call(self, request: Request<Incoming>, watch: Arc<ConnectionWatch>) -> Response<Body> {
        if let Err(status) = self.auth.check(request.headers()) {
            return watch.refused(status).into_http();
        }
        let under_way = UnderWay::new(Arc::clone(&watch));
        let held = RequestMemory::new(Arc::clone(&watch));
        let deadline = deadline(request.headers()).unwrap_or(Duration::MAX);
        let request = request.map(|body| Body::new(RequestBody::new(body, Arc::clone(&held))));
        let mut infer = self.infer;
        let response = match timeout(deadline, infer.call(request)).await {
            Ok(Ok(response)) => response,
            Err(_) => Status::deadline_exceeded("the call's deadline ended").into_http(),
        };
        drop(held);
        under_way.answered();
        response.map(|body| Body::new(ReplyBody::new(body, watch)))
    }
}

/// Returns an error if a connection violated HTTP/2, and `Ok` if it merely broke.
fn protocol(error: &hyper::Error) -> Result<(), RejectReason> {
    let mut innermost: &dyn std::error::Error = error;
    while let Some(cause) = innermost.source() {
        innermost = cause;
    }
    let is_io = innermost.is::<io::Error>();
    if is_io || error.is_closed() || error.is_incomplete_message() {
        return Ok(());
    }
    Err(RejectReason::Protocol(innermost.to_string()))
}

/// Returns the time that the caller has left, by `grpc-timeout`: up to eight digits and a unit.
fn deadline(headers: &HeaderMap) -> Option<Duration> {
    let text = headers.get("grpc-timeout")?.to_str().ok()?;
    let (digits, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    if digits.len() > 8 || !digits.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let count = digits.parse().ok()?;
    Some(match unit {
        "H" => Duration::from_secs(count * 3600),
        "M" => Duration::from_secs(count * 60),
        "S" => Duration::from_secs(count),
        "m" => Duration::from_millis(count),
        "u" => Duration::from_micros(count),
        "n" => Duration::from_nanos(count),
        _ => return None,
    })
}

/// A call that was admitted and is not answered yet.
struct UnderWay {
    watch: Arc<ConnectionWatch>,
    is_answered: bool,
}

impl UnderWay {
    fn new(watch: Arc<ConnectionWatch>) -> Self {
        watch.call_began();
        Self { watch, is_answered: false }
    }

    fn answered(mut self) {
        self.is_answered = true;
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.watch.call_ended(self.is_answered);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timeout_is_up_to_eight_digits_and_a_unit() {
        let read = |text: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("grpc-timeout", text.parse().unwrap());
            deadline(&headers)
        };
        for (text, nanos) in [
            ("7H", 25_200_000_000_000),
            ("7M", 420_000_000_000),
            ("7S", 7_000_000_000),
            ("7m", 7_000_000),
            ("7u", 7_000),
            ("7n", 7),
            ("00000000S", 0),
            ("99999999n", 99_999_999),
        ] {
            assert_eq!(read(text), Some(Duration::from_nanos(nanos)), "{text}");
        }
        for text in ["", "S", "7", "+7S", "-7S", "7s", "7 S", " 7S", "100000000n", "7.5S"] {
            assert_eq!(read(text), None, "{text}");
        }
        assert_eq!(deadline(&HeaderMap::new()), None);
    }
}
