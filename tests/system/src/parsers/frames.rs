//! The contents of gRPC frames: requests as the server reads them, and replies as the operator
//! reads them.

use std::convert::Infallible;
use std::fmt::Debug;
use std::future::ready;

use bytes::Bytes;
use fuseline_tokio::grpc::tonic::body::Body;
use fuseline_tokio::grpc::tonic::codegen::Service;
use fuseline_tokio::grpc::tonic::{Code, Status};
use fuseline_tokio::grpc::{Description, Infer, InferServer, Reply, Request};
use futures_util::{FutureExt, stream};
use http_body::Frame;
use http_body_util::{BodyExt, StreamBody};
use prost::Message;

use crate::parsers::{Ends, ParserResult};

pub(super) const ENDS: &[&str] = &["answered", "described", "refused"];

/// The path of a call.
const INFER: &str = "/fuseline.v1.Infer/Infer";
const DESCRIBE: &str = "/fuseline.v1.Infer/Describe";
/// The number of bytes before a message in a frame: a flag, and the length in 4 bytes.
const PREFIX: usize = 5;

/// Checks a call. The first byte selects the call, the second one is where the other bytes are cut
/// in two.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let [selector, cut, rest @ ..] = bytes else { return Ok(()) };
    unchanged::<Reply>(rest)?;
    unchanged::<Description>(rest)?;
    // Seeds must keep their call, and there was once a third call.
    if selector % 3 == 1 { describe(rest, *cut, ends) } else { infer(rest, *cut, ends) }
}

/// Checks that a message that can be read is the same after it is written and read again.
fn unchanged<M: Message + Default + Debug>(bytes: &[u8]) -> ParserResult {
    let Ok(message) = M::decode(bytes) else { return Ok(()) };
    let written = message.encode_to_vec();
    let again = M::decode(&*written).map_err(|error| format!("{message:?}: {error}"))?;
    if again.encode_to_vec() != written {
        return Err(format!("{message:?} is read again as {again:?}"));
    }
    Ok(())
}

/// Checks that a server that echoes requests answers one whole frame, and nothing else.
fn infer(body: &[u8], cut: u8, ends: &mut Ends) -> ParserResult {
    let (code, replied) = call_server(INFER, body, cut)?;
    let whole = split(body).map(|(message, rest)| (Request::decode(message).ok(), rest));
    match whole {
        Some((Some(request), [])) => {
            let expected =
                Reply { payload: request.payload, of: Some(request.timestamp), ..Reply::default() }
                    .encode_to_vec();
            let replied = split(&replied).filter(|(_, rest)| rest.is_empty());
            if code != Code::Ok || replied.is_none_or(|(message, _)| message != expected) {
                return Err(format!("{code:?}, {replied:?} to {body:?}"));
            }
            ends.insert("answered");
        }
        // More bytes follow the message. The server may answer or refuse, depending on whether they
        // are a whole message.
        Some((Some(_), _)) => {}
        Some((None, _)) | None => {
            if code == Code::Ok {
                return Err(format!("{body:?} is no request, and is answered"));
            }
            ends.insert("refused");
        }
    }
    Ok(())
}

/// Checks that the description of the server is sent for one whole message.
fn describe(body: &[u8], cut: u8, ends: &mut Ends) -> ParserResult {
    let (code, replied) = call_server(DESCRIBE, body, cut)?;
    if code == Code::Ok {
        ends.insert("described");
        let reported = split(&replied).map(|(message, _)| Description::decode(message));
        if !matches!(reported, Some(Ok(reported)) if reported == served()) {
            return Err(format!("{body:?} gets {replied:?}"));
        }
    }
    Ok(())
}

fn served() -> Description {
    Description { model: "echo".to_owned(), runtime_ms: Some(0.5), ..Description::default() }
}

/// Returns the payload of each request.
struct Echo;

impl Infer for Echo {
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send {
        ready(Ok(Reply {
            payload: request.payload,
            of: Some(request.timestamp),
            ..Reply::default()
        }))
    }

    fn describe(&self) -> Option<Description> {
        Some(served())
    }
}

/// Sends the server a body in two pieces, and returns the code and the body of its reply.
fn call_server(path: &str, body: &[u8], cut: u8) -> Result<(Code, Bytes), String> {
    let (first, second) = body.split_at(usize::from(cut).min(body.len()));
    let piece = |bytes| Ok::<_, Infallible>(Frame::data(Bytes::copy_from_slice(bytes)));
    let pieces = StreamBody::new(stream::iter([piece(first), piece(second)]));
    let request = http::Request::post(path)
        .header("content-type", "application/grpc")
        .body(Body::new(pieces))
        .map_err(|error| error.to_string())?;
    let waits = "the server waits for what does not come";
    let Ok(response) = InferServer::new(Echo).call(request).now_or_never().ok_or(waits)?;
    let status = |headers: &http::HeaderMap| headers.get("grpc-status").cloned();
    let at_once = status(response.headers());
    let collected = response.into_body().collect().now_or_never().ok_or(waits)?;
    let collected = collected.map_err(|status| format!("a reply breaks off: {status}"))?;
    let reported = at_once.or_else(|| collected.trailers().and_then(status)).ok_or("no status")?;
    Ok((Code::from_bytes(reported.as_bytes()), collected.to_bytes()))
}

/// Returns the message of a first frame that is whole and not compressed, and the bytes after it.
fn split(body: &[u8]) -> Option<(&[u8], &[u8])> {
    let ([0, len @ ..], rest) = body.split_first_chunk::<PREFIX>()? else { return None };
    rest.split_at_checked(usize::try_from(u32::from_be_bytes(*len)).ok()?)
}
