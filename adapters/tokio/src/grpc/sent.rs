//! Counts the bytes that a connection takes of the calls' requests.

use std::pin::Pin;
use std::task::{Context, Poll};

use bytes::Bytes;
use http_body::{Frame, SizeHint};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::transport::{self, Channel};

use crate::call::Call;

/// Counts what the channel takes of a request, for the [`Call`](crate::Call) in the request, if
/// there is one.
#[derive(Clone, Debug)]
pub struct CountedBody(pub(crate) Channel);

impl Service<http::Request<Body>> for CountedBody {
    type Response = http::Response<Body>;
    type Error = transport::Error;
    type Future = <Channel as Service<http::Request<Body>>>::Future;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), transport::Error>> {
        self.0.poll_ready(cx)
    }

    fn call(&mut self, mut request: http::Request<Body>) -> Self::Future {
        if let Some(call) = request.extensions_mut().remove::<Call>() {
            request = request.map(|body| Body::new(Sending { body, call }));
        }
        self.0.call(request)
    }
}

/// A request's body. It is polled only when a connection has room for it.
struct Sending {
    body: Body,
    call: Call,
}

impl http_body::Body for Sending {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let frame = Pin::new(&mut self.body).poll_frame(cx);
        if let Poll::Ready(Some(Ok(frame))) = &frame
            && let Some(data) = frame.data_ref()
        {
            self.call.sent(data.len());
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
