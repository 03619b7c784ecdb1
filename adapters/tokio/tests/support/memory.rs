//! A server and its clients over streams in memory, so that hours of virtual time take almost no
//! real time.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fuseline_tokio::grpc::{Reply, Request, ServeError, Server, serve_with_incoming};
use futures_util::stream;
use h2::client::SendRequest;
use http::HeaderMap;
use prost::Message;
use tokio::io::DuplexStream;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, timeout};

/// The number of bytes that may be on their way in one direction.
const WIRE: usize = 16 * 1024;

/// The number of low bits of a timestamp that hold the reply's length. The other bits hold the
/// milliseconds for which the server computes.
const REPLY_BITS: u32 = 24;

type IncomingStream = io::Result<(DuplexStream, SocketAddr)>;

/// A server that computes for as long and replies with as many bytes as a request's timestamp says.
pub(crate) struct MemoryServer {
    entry: mpsc::UnboundedSender<IncomingStream>,
    stop: oneshot::Sender<()>,
    task: JoinHandle<Result<(), ServeError>>,
    computing: Arc<AtomicUsize>,
    /// The number of failures to accept after which the server has not yet tried again.
    failures: Arc<AtomicUsize>,
}

/// A running computation. Dropping it reduces the count.
struct Computing(Arc<AtomicUsize>);

impl Drop for Computing {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl MemoryServer {
    pub(crate) fn start(server: Server) -> Self {
        let (entry, arrivals) = mpsc::unbounded_channel();
        let (stop, stopped) = oneshot::channel();
        let computing = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&computing);
        let infer = move |request: Request| {
            counter.fetch_add(1, Ordering::Relaxed);
            let computing = Computing(Arc::clone(&counter));
            async move {
                sleep(Duration::from_millis(request.timestamp >> REPLY_BITS)).await;
                drop(computing);
                let bytes = usize::try_from(request.timestamp % (1 << REPLY_BITS)).unwrap();
                Ok(Reply { payload: vec![7; bytes].into(), ..Reply::default() })
            }
        };
        let failures = Arc::new(AtomicUsize::new(0));
        let state = (arrivals, Arc::clone(&failures), false);
        let incoming = stream::unfold(state, async |(mut arrivals, failures, has_failed)| {
            failures.fetch_sub(usize::from(has_failed), Ordering::Relaxed);
            let arrival: IncomingStream = arrivals.recv().await?;
            let has_failed = arrival.is_err();
            Some((arrival, (arrivals, failures, has_failed)))
        });
        let until = async move {
            let _ = stopped.await;
        };
        let task = tokio::spawn(serve_with_incoming(infer, server, incoming, until));
        Self { entry, stop, task, computing, failures }
    }

    /// Opens a connection. Returns the client's end.
    pub(crate) fn connect(&self, from: IpAddr) -> DuplexStream {
        let (ours, theirs) = tokio::io::duplex(WIRE);
        self.entry.send(Ok((theirs, (from, 4711).into()))).unwrap();
        ours
    }

    /// Makes the server's next accept fail, as if no descriptor were free.
    pub(crate) fn fail_to_accept(&self) {
        self.failures.fetch_add(1, Ordering::Relaxed);
        self.entry.send(Err(io::Error::from_raw_os_error(24))).unwrap();
    }

    /// Waits until the server accepts connections at once again.
    pub(crate) async fn accepts(&self) {
        while self.failures.load(Ordering::Relaxed) > 0 {
            assert!(!self.task.is_finished(), "the server ended");
            sleep(Duration::from_millis(10)).await;
        }
    }

    pub(crate) async fn visit(&self, from: IpAddr) -> Visitor {
        let (send, connection) = h2::client::handshake(self.connect(from)).await.unwrap();
        Visitor { send, connection: tokio::spawn(connection) }
    }

    /// Returns the number of running computations.
    pub(crate) fn computing(&self) -> usize {
        self.computing.load(Ordering::Relaxed)
    }

    /// Stops the server. Returns how long that took, or `None` if it did not end in time.
    pub(crate) async fn stop(self, within: Duration) -> Option<Duration> {
        let since = Instant::now();
        let _ = self.stop.send(());
        let ended = timeout(within, self.task).await.ok()?;
        ended.unwrap().unwrap();
        Some(since.elapsed())
    }
}

/// A client's connection.
pub(crate) struct Visitor {
    pub(crate) send: SendRequest<Bytes>,
    pub(crate) connection: JoinHandle<Result<(), h2::Error>>,
}

/// One call, and how the client behaves in it.
#[derive(Clone, Debug, Default)]
pub(crate) struct CallPlan {
    /// The time for which the server computes.
    pub(crate) compute: Duration,
    /// The size of the reply in bytes.
    pub(crate) reply: usize,
    /// The size of the request's payload in bytes.
    pub(crate) payload: usize,
    /// The header `grpc-timeout`.
    pub(crate) timeout: Option<String>,
    pub(crate) token: Option<&'static str>,
    /// The number of parts in which the request is sent, and the time between them.
    pub(crate) upload: (usize, Duration),
    /// The time before the client takes each frame of the reply.
    pub(crate) read_pause: Duration,
}

/// The outcome of a call.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct VisitEnd {
    /// The gRPC status.
    pub(crate) status: u16,
    /// The size of the reply's payload in bytes.
    pub(crate) bytes: usize,
    pub(crate) took: Duration,
}

impl CallPlan {
    pub(crate) fn head(&self) -> http::Request<()> {
        let mut head = http::Request::post("http://x/fuseline.v1.Infer/Infer")
            .header("content-type", "application/grpc")
            .header("te", "trailers");
        if let Some(text) = &self.timeout {
            head = head.header("grpc-timeout", text);
        }
        if let Some(token) = self.token {
            head = head.header("authorization", format!("Bearer {token}"));
        }
        head.body(()).unwrap()
    }

    /// Returns the request in gRPC's framing.
    pub(crate) fn body(&self) -> Bytes {
        let ms = u64::try_from(self.compute.as_millis()).unwrap();
        let timestamp = (ms << REPLY_BITS) | self.reply as u64;
        let payload = vec![7; self.payload].into();
        let message = Request { timestamp, payload, ..Request::default() }.encode_to_vec();
        let length = u32::try_from(message.len()).unwrap().to_be_bytes();
        [&[0][..], &length, &message].concat().into()
    }
}

impl Visitor {
    pub(crate) fn is_open(&self) -> bool {
        !self.connection.is_finished()
    }

    /// Waits until the server closes the connection. Returns how long that took, or `None` if it
    /// did not happen in time.
    pub(crate) async fn closed(self, within: Duration) -> Option<Duration> {
        let since = Instant::now();
        // Holding the client's end means that only the server has a reason to close the connection.
        let _send = self.send;
        timeout(within, self.connection).await.ok().map(|_| since.elapsed())
    }

    /// Makes one call, from its first to its last byte.
    pub(crate) async fn call(&self, plan: &CallPlan) -> Result<VisitEnd, h2::Error> {
        let since = Instant::now();
        let mut send = self.send.clone().ready().await?;
        let (answer, mut body) = send.send_request(plan.head(), false)?;
        let (parts, gap) = (plan.upload.0.max(1), plan.upload.1);
        let mut request = plan.body();
        for part in 1..=parts {
            let piece = request.split_to(request.len() / (parts + 1 - part));
            // The call may be over by now.
            if body.send_data(piece, part == parts).is_err() {
                break;
            }
            if part < parts {
                sleep(gap).await;
            }
        }
        let (head, mut reply) = answer.await?.into_parts();
        let mut all = BytesMut::new();
        while let Some(data) = reply.data().await {
            let data = data?;
            sleep(plan.read_pause).await;
            reply.flow_control().release_capacity(data.len())?;
            all.extend_from_slice(&data);
        }
        let trailers = reply.trailers().await?;
        let status = trailers.as_ref().and_then(status).or_else(|| status(&head.headers));
        let bytes = all.get(5..).map_or(0, |message| {
            Reply::decode(message).map_or(usize::MAX, |reply| reply.payload.len())
        });
        Ok(VisitEnd { status: status.unwrap_or(u16::MAX), bytes, took: since.elapsed() })
    }
}

pub(crate) fn status(headers: &HeaderMap) -> Option<u16> {
    headers.get("grpc-status")?.to_str().ok()?.parse().ok()
}

/// The lines that were logged on this thread.
#[derive(Clone, Default)]
pub(crate) struct CapturedLog(Arc<Mutex<Vec<u8>>>);

impl CapturedLog {
    /// Captures what is logged on this thread until the guard is dropped.
    pub(crate) fn begin(&self) -> tracing::subscriber::DefaultGuard {
        let log = self.clone();
        let make = move || log.clone();
        let lines = tracing_subscriber::fmt().with_writer(make).with_ansi(false).without_time();
        tracing::subscriber::set_default(lines.finish())
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.0.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }
}

impl io::Write for CapturedLog {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
