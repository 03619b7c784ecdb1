//! Local and the clouds: how a message gets to each of them.

use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::grpc::{self, Identity, Remote, RemoteError, Token};
use fuseline_tokio::{Call, Error};
use futures_util::future::BoxFuture;

use crate::dds::{End, Outlet};
use crate::raw::Payload;
use crate::settings::Grpc;

/// Local or a cloud, as the node sees it.
pub(crate) struct Source {
    /// 0 is local.
    pub(crate) priority: u16,
    pub(crate) name: String,
    pub(crate) way: Way,
    /// Whether it is asked at all; local always is.
    pub(crate) enabled: bool,
    /// How long it may take; none is the node's deadline.
    pub(crate) deadline: Option<Duration>,
    pub(crate) strays: Strays,
}

/// How messages go there and results come back.
pub(crate) enum Way {
    /// Over two topics.
    Topics { requests: Outlet, results: Arc<End> },
    /// By a call each.
    Grpc(Handle),
}

/// Makes a call with a serialized message, and answers with a serialized result.
pub(crate) type Handle =
    Arc<dyn Fn(Payload, Call) -> BoxFuture<'static, Result<Payload, Error>> + Send + Sync>;

/// What came on its topic and is no result of any message.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Strays {
    /// Its key is of no message that is remembered.
    pub(crate) unknown_stamp: u64,
    /// It has no key.
    pub(crate) malformed: u64,
}

/// Why a cloud's server cannot be called.
#[derive(Debug, thiserror::Error)]
pub enum GrpcError {
    /// A file that a parameter names.
    #[error("{path} cannot be read: {error}")]
    File {
        /// The file.
        path: String,
        /// Why not.
        error: std::io::Error,
    },
    /// The token in the file.
    #[error("{path} has no token: {error}")]
    Token {
        /// The file.
        path: String,
        /// Why not.
        error: grpc::InvalidToken,
    },
    /// The server's address and what secures it.
    #[error(transparent)]
    Remote(#[from] RemoteError),
}

/// What a reply must be.
#[derive(Debug, thiserror::Error)]
#[error("the reply is no message serialized as plain CDR")]
struct NotCdr;

impl Source {
    /// Who should be there and is not.
    pub(crate) fn missing(&self) -> Option<String> {
        match &self.way {
            Way::Topics { requests, .. } if requests.end.matched() == 0 => {
                Some(format!("nobody subscribes to {}", requests.end.topic))
            }
            Way::Topics { results, .. } if results.matched() == 0 => {
                Some(format!("nobody publishes on {}", results.topic))
            }
            Way::Topics { .. } | Way::Grpc(_) => None,
        }
    }

    /// Whether a message can get there now.
    pub(crate) fn is_reached(&self) -> bool {
        match &self.way {
            Way::Topics { requests, .. } => requests.end.matched() > 0,
            Way::Grpc(_) => true,
        }
    }

    /// The topics' ends, to tell what does not fit.
    pub(crate) fn ends(&self) -> impl Iterator<Item = &End> {
        match &self.way {
            Way::Topics { requests, results } => [Some(&*requests.end), Some(&**results)],
            Way::Grpc(_) => [None, None],
        }
        .into_iter()
        .flatten()
    }
}

/// The handle of a cloud that offers `fuseline.v1.Infer`.
///
/// # Errors
/// If a file cannot be read or the address is none.
pub(crate) fn call(grpc: &Grpc) -> Result<Handle, GrpcError> {
    let mut remote = Remote::new(&grpc.url);
    remote.ca = grpc.ca.as_deref().map(read).transpose()?;
    remote.server_name.clone_from(&grpc.server_name);
    if let (Some(certificate), Some(key)) = (&grpc.certificate, &grpc.key) {
        remote.identity = Some(Identity { certificate: read(certificate)?, key: read(key)? });
    }
    if let Some(path) = &grpc.token_file {
        let bytes = read(path)?;
        let text = String::from_utf8_lossy(&bytes);
        let token = Token::new(text.trim())
            .map_err(|error| GrpcError::Token { path: path.display().to_string(), error })?;
        remote.token = Some(token);
    }
    let infer = grpc::infer(remote.connect()?);
    Ok(Arc::new(move |payload: Payload, call: Call| {
        let request = grpc::Request { timestamp: call.timestamp, payload: payload.to_serialized() };
        let reply = infer(request, call);
        Box::pin(async move {
            Payload::from_serialized(&reply.await?.payload).ok_or_else(|| NotCdr.into())
        })
    }))
}

fn read(path: impl AsRef<std::path::Path>) -> Result<Vec<u8>, GrpcError> {
    let path = path.as_ref();
    std::fs::read(path).map_err(|error| GrpcError::File { path: path.display().to_string(), error })
}
