//! The client and the server of the `fuseline.v1.Infer` service in `proto/fuseline.proto`. They are
//! written by hand, so that the build needs no code generator.

use std::convert::Infallible;
use std::fmt;
use std::future::{Ready, ready};
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use bytes::Bytes;
use fuseline_engine::{Lineage, Origin, StampedValue, nanos};
use futures_util::future::BoxFuture;
use http::uri::PathAndQuery;
use tonic::body::Body;
use tonic::client::Grpc;
use tonic::codegen::Service;
use tonic::server::{NamedService, UnaryService};
use tonic::{Code, Response, Status};
use tonic_prost::ProstCodec;

use crate::grpc::MESSAGE_BYTES;
use crate::grpc::remote::Connection;

const INFER: &str = "/fuseline.v1.Infer/Infer";
const DESCRIBE: &str = "/fuseline.v1.Infer/Describe";

/// One message of an operator's input, as it is sent to a cloud.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct Request {
    /// The message's timestamp.
    #[prost(uint64, tag = "1")]
    pub timestamp: u64,
    /// The message, encoded as operator and cloud have agreed.
    #[prost(bytes = "bytes", tag = "2")]
    pub payload: Bytes,
    /// The lineage of the message. If it is `None`, [`infer`](crate::grpc::infer) sends the lineage
    /// of the [call](crate::Call::lineage).
    #[prost(message, optional, tag = "3")]
    pub lineage: Option<RequestLineage>,
}

/// The lineage of a request's message at the time when the request was sent.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct RequestLineage {
    /// The sensor's stream.
    #[prost(string, optional, tag = "1")]
    pub origin: Option<String>,
    /// The message's timestamp in that stream.
    #[prost(uint64, optional, tag = "2")]
    pub seq: Option<u64>,
    /// The nanoseconds since the capture.
    #[prost(uint64, optional, tag = "3")]
    pub age_ns: Option<u64>,
    /// The end-to-end deadline, in nanoseconds from the capture.
    #[prost(uint64, optional, tag = "4")]
    pub within_ns: Option<u64>,
}

/// The result that the cloud computed from a message.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct Reply {
    /// The result, encoded as operator and cloud have agreed.
    #[prost(bytes = "bytes", tag = "1")]
    pub payload: Bytes,
    /// The timestamp of the message that the result was computed from, if the cloud names it. For
    /// several messages it is the oldest one's.
    #[prost(uint64, optional, tag = "2")]
    pub of: Option<u64>,
    /// The timestamp of the message that the result is meant for, if the cloud names it. For an
    /// action of a chunk, it is the action's tick.
    #[prost(uint64, optional, tag = "3")]
    pub meant_for: Option<u64>,
}

/// A cloud's description of what it serves.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Description {
    /// The model's name, for people; empty if it has none.
    #[prost(string, tag = "1")]
    pub model: String,
    /// The usual time of a computation, in milliseconds.
    #[prost(double, optional, tag = "2")]
    pub runtime_ms: Option<f64>,
    /// The model's box AP on COCO, 0 to 100.
    #[prost(double, optional, tag = "3")]
    pub ap: Option<f64>,
    /// The recorded drive whose round trips are added to each reply; empty if there is none.
    #[prost(string, tag = "4")]
    pub drive: String,
    /// `true` if the server only waits for as long as the model would take.
    #[prost(bool, tag = "5")]
    pub emulated: bool,
}

impl RequestLineage {
    /// Returns the lineage of a message that is sent at `now`.
    #[must_use]
    pub fn new(lineage: &Lineage, now: Instant) -> Self {
        Self {
            origin: lineage.origin.as_ref().map(|origin| origin.stream.as_ref().to_owned()),
            seq: lineage.origin.as_ref().and_then(|origin| origin.seq),
            age_ns: lineage.age(now).map(nanos),
            within_ns: lineage.within.map(nanos),
        }
    }

    /// Returns the lineage on this host's clock, for a request that came at `now`. The message is
    /// older than this lineage says, because the time on the way is not known.
    #[must_use]
    pub fn lineage(&self, now: Instant) -> Lineage {
        let origin =
            self.origin.as_deref().map(|stream| Origin { stream: stream.into(), seq: self.seq });
        let captured = self.age_ns.and_then(|age| now.checked_sub(Duration::from_nanos(age)));
        let within = self.within_ns.map(Duration::from_nanos);
        Lineage { origin, captured, within, ..Lineage::default() }
    }
}

impl Reply {
    /// Returns the payload with the timestamps that the cloud named, as the response handler of a
    /// [stamped cloud](crate::Setup::use_stamped_cloud) returns it.
    #[must_use]
    pub fn stamped(self) -> StampedValue<Bytes> {
        let Self { payload, of, meant_for } = self;
        StampedValue { value: payload, of, meant_for }
    }
}

/// The service's client.
#[derive(Clone, Debug)]
pub struct InferClient(Grpc<Connection>);

impl InferClient {
    /// Creates a client over this connection.
    #[must_use]
    pub fn new(connection: Connection) -> Self {
        let grpc = Grpc::new(connection)
            .max_decoding_message_size(MESSAGE_BYTES)
            .max_encoding_message_size(MESSAGE_BYTES);
        Self(grpc)
    }

    /// Asks the cloud to compute a message.
    ///
    /// # Errors
    /// Returns the status from the server, or from the connection to it.
    pub async fn infer(
        &mut self,
        request: tonic::Request<Request>,
    ) -> Result<Response<Reply>, Status> {
        self.unary(INFER, request).await
    }

    /// Requests a description of what the server serves.
    ///
    /// # Errors
    /// Returns the status from the server, or from the connection to it. It is `Unimplemented` if
    /// the server has no description.
    pub async fn describe(
        &mut self,
        request: tonic::Request<()>,
    ) -> Result<Response<Description>, Status> {
        self.unary(DESCRIBE, request).await
    }

    async fn unary<Req, Res>(
        &mut self,
        method: &'static str,
        request: tonic::Request<Req>,
    ) -> Result<Response<Res>, Status>
    where
        Req: prost::Message + Send + Sync + 'static,
        Res: prost::Message + Default + Send + Sync + 'static,
    {
        // `from_error` keeps the cause.
        self.0.ready().await.map_err(|error| Status::from_error(error.into()))?;
        let path = PathAndQuery::from_static(method);
        self.0.unary(request, path, ProstCodec::<Req, Res>::default()).await
    }
}

/// Computes a cloud's results. If the caller gives up or its deadline passes, the future is
/// dropped.
pub trait Infer: Send + Sync + 'static {
    /// Computes the result for a message.
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send;

    /// Returns the description of what the server serves. By default there is none.
    fn describe(&self) -> Option<Description> {
        None
    }
}

impl<F, Fut> Infer for F
where
    F: Fn(Request) -> Fut + Send + Sync + 'static,
    Fut: Future<Output = Result<Reply, Status>> + Send,
{
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send {
        self(request)
    }
}

/// An [`Infer`] of any type, so that the server is compiled only once.
trait BoxedInfer: Send + Sync {
    fn infer(
        self: Arc<Self>,
        request: Request,
    ) -> BoxFuture<'static, Result<Response<Reply>, Status>>;

    fn describe(&self) -> Option<Description>;
}

impl<T: Infer> BoxedInfer for T {
    fn infer(
        self: Arc<Self>,
        request: Request,
    ) -> BoxFuture<'static, Result<Response<Reply>, Status>> {
        Box::pin(async move { Infer::infer(&*self, request).await.map(Response::new) })
    }

    fn describe(&self) -> Option<Description> {
        Infer::describe(self)
    }
}

/// The service's server side, for `tonic::transport::Server::add_service`.
#[derive(Clone)]
pub struct InferServer(Arc<dyn BoxedInfer>);

impl InferServer {
    /// Creates a service that answers with `infer`.
    #[must_use]
    pub fn new(infer: impl Infer) -> Self {
        Self(Arc::new(infer))
    }
}

impl fmt::Debug for InferServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("InferServer").finish_non_exhaustive()
    }
}

impl NamedService for InferServer {
    const NAME: &'static str = "fuseline.v1.Infer";
}

/// Serves the method that computes results.
struct ComputeService(Arc<dyn BoxedInfer>);

/// Serves the method that returns the description.
struct DescribeService(Arc<dyn BoxedInfer>);

impl UnaryService<Request> for ComputeService {
    type Response = Reply;
    type Future = BoxFuture<'static, Result<Response<Reply>, Status>>;

    fn call(&mut self, request: tonic::Request<Request>) -> Self::Future {
        Arc::clone(&self.0).infer(request.into_inner())
    }
}

impl UnaryService<()> for DescribeService {
    type Response = Description;
    type Future = Ready<Result<Response<Description>, Status>>;

    fn call(&mut self, _: tonic::Request<()>) -> Self::Future {
        let logged = self.0.describe().map(Response::new);
        ready(logged.ok_or_else(|| Status::unimplemented("the server does not say what it serves")))
    }
}

impl Service<http::Request<Body>> for InferServer {
    type Response = http::Response<Body>;
    type Error = Infallible;
    type Future = BoxFuture<'static, Result<Self::Response, Infallible>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let infer = Arc::clone(&self.0);
        Box::pin(async move {
            Ok(match request.uri().path() {
                INFER => server().unary(ComputeService(infer), request).await,
                DESCRIBE => server().unary(DescribeService(infer), request).await,
                _ => Status::new(Code::Unimplemented, "no such method").into_http(),
            })
        })
    }
}

fn server<Req, Res>() -> tonic::server::Grpc<ProstCodec<Res, Req>>
where
    Req: prost::Message + Default + Send + 'static,
    Res: prost::Message + Send + 'static,
{
    tonic::server::Grpc::new(ProstCodec::default())
        .max_decoding_message_size(MESSAGE_BYTES)
        .max_encoding_message_size(MESSAGE_BYTES)
}
