//! The `fuseline.v1.Infer` service of `proto/fuseline.proto`, both sides, written out by hand so
//! that building it needs no code generator.

use std::convert::Infallible;
use std::sync::Arc;
use std::task::{Context, Poll};

use bytes::Bytes;
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

const METHOD: &str = "/fuseline.v1.Infer/Infer";

/// One message of an operator's input.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct Request {
    /// Its timestamp.
    #[prost(uint64, tag = "1")]
    pub timestamp: u64,
    /// The message as operator and cloud agreed to encode it.
    #[prost(bytes = "bytes", tag = "2")]
    pub payload: Bytes,
}

/// What the cloud computed of it.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct Reply {
    /// The result as operator and cloud agreed to encode it.
    #[prost(bytes = "bytes", tag = "1")]
    pub payload: Bytes,
}

/// The service's client.
#[derive(Clone, Debug)]
pub struct InferClient(Grpc<Connection>);

impl InferClient {
    /// A client over this connection.
    #[must_use]
    pub fn new(connection: Connection) -> Self {
        let grpc = Grpc::new(connection)
            .max_decoding_message_size(MESSAGE_BYTES)
            .max_encoding_message_size(MESSAGE_BYTES);
        Self(grpc)
    }

    /// Makes the call.
    ///
    /// # Errors
    /// The status that the server, or the way to it, answered with.
    pub async fn infer(
        &mut self,
        request: tonic::Request<Request>,
    ) -> Result<Response<Reply>, Status> {
        self.0.ready().await.map_err(|error| Status::unavailable(error.to_string()))?;
        let path = PathAndQuery::from_static(METHOD);
        self.0.unary(request, path, ProstCodec::<Request, Reply>::default()).await
    }
}

/// What a cloud does with a request. When the caller gives up or its deadline passes, the future is
/// dropped.
pub trait Infer: Send + Sync + 'static {
    /// Computes a message.
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send;
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

/// The service's server side, for `tonic::transport::Server::add_service`.
#[derive(Debug)]
pub struct InferServer<T>(Arc<T>);

impl<T: Infer> InferServer<T> {
    /// Serves with `infer`.
    #[must_use]
    pub fn new(infer: T) -> Self {
        Self(Arc::new(infer))
    }
}

impl<T> Clone for InferServer<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> NamedService for InferServer<T> {
    const NAME: &'static str = "fuseline.v1.Infer";
}

impl<T: Infer> UnaryService<Request> for InferServer<T> {
    type Response = Reply;
    type Future = BoxFuture<'static, Result<Response<Reply>, Status>>;

    fn call(&mut self, request: tonic::Request<Request>) -> Self::Future {
        let infer = Arc::clone(&self.0);
        Box::pin(async move { infer.infer(request.into_inner()).await.map(Response::new) })
    }
}

impl<T: Infer> Service<http::Request<Body>> for InferServer<T> {
    type Response = http::Response<Body>;
    type Error = Infallible;
    type Future = BoxFuture<'static, Result<Self::Response, Infallible>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let infer = self.clone();
        Box::pin(async move {
            if request.uri().path() != METHOD {
                return Ok(Status::new(Code::Unimplemented, "no such method").into_http());
            }
            let mut grpc = tonic::server::Grpc::new(ProstCodec::<Reply, Request>::default())
                .max_decoding_message_size(MESSAGE_BYTES)
                .max_encoding_message_size(MESSAGE_BYTES);
            Ok(grpc.unary(infer, request).await)
        })
    }
}
