//! Clouds behind gRPC: connections with TLS and tokens, handles for any client, and a service ready
//! to use.
//!
//! A [`Remote`] names a cloud and makes a [`Connection`], which connects when it is first used and
//! again after it was lost. Any client that `tonic` generates takes the connection, and [`unary`]
//! turns one method of that client into a handle. If requests and results are bytes, use [`infer`]
//! for the client and [`serve`] for the server. The protocol is `proto/fuseline.proto`.
//!
//! ```no_run
//! # use std::time::Duration;
//! # use fuseline_tokio::{Error, Setup, grpc};
//! # fn setup(setup: &mut Setup<Vec<u8>, Vec<u8>>) -> Result<(), Error> {
//! let remote = grpc::Remote {
//!     ca: Some(std::fs::read("west.pem")?),
//!     token: Some(grpc::Token::new("secret")?),
//!     ..grpc::Remote::new("https://west.example:50051")
//! };
//! let message_handler = |frame: &Vec<u8>, timestamp| {
//!     let request = grpc::Request { timestamp, payload: frame.clone().into(), ..Default::default() };
//!     Some((request, Duration::from_millis(500)))
//! };
//! let response_handler = |reply: grpc::Reply| Ok(reply.payload.to_vec());
//! setup.use_cloud(grpc::infer(remote.connect()?), message_handler, response_handler, 1);
//! # Ok(())
//! # }
//! ```

mod failure;
mod handle;
mod infer;
mod remote;
mod sent;
mod server;
mod token;

pub use failure::CallError;
pub use handle::{infer, unary};
pub use infer::{Description, Infer, InferClient, InferServer, Reply, Request, RequestLineage};
pub use remote::{Connection, Identity, Remote, RemoteError};
pub use server::{Bounds, ServeError, Server, serve, serve_with_incoming};
pub use token::{InvalidToken, Token};
/// The gRPC library, for your own clients and services.
pub use tonic;

/// The greatest size of an encoded message of [`infer`] and [`serve`], in bytes.
pub const MESSAGE_BYTES: usize = 32 * 1024 * 1024;
