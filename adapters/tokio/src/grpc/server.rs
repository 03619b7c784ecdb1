//! The cloud's side: a server for the `Infer` service.

mod bounds;
mod connection_handler;
mod connection_watch;
mod held;
mod limits;
#[cfg(feature = "tls")]
mod tls;
#[cfg(not(feature = "tls"))]
#[path = "server/without_tls.rs"]
mod tls;

use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use futures_util::{Stream, StreamExt, stream};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tracing::warn;

pub use bounds::Bounds;

use crate::grpc::infer::{Infer, InferServer};
use crate::grpc::remote::Identity;
use crate::grpc::server::connection_handler::ConnectionHandler;
use crate::grpc::server::limits::ServerLimits;
use crate::grpc::token::{AuthCheck, Token};

/// The pause before the next connection is accepted after the system had no room for one.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Configures whom a server accepts, and what clients may take. By default it accepts everybody,
/// without TLS.
#[derive(Clone, Debug, Default)]
pub struct Server {
    /// The server's certificate; with it, the server uses TLS.
    pub identity: Option<Identity>,
    /// The certificates of the CAs that may have signed a client's certificate, in PEM (mutual
    /// TLS). Needs an identity.
    pub client_ca: Option<Vec<u8>>,
    /// The token that each call must carry.
    pub token: Option<Token>,
    /// The bounds for all clients, known or not.
    pub bounds: Bounds,
}

/// The reason why a server cannot start.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Client certificates are required but the server has no identity.
    #[error(
        "a server that asks for clients' certificates needs a certificate and a key of its own"
    )]
    Identity,
    /// The certificates or the key cannot be used.
    #[error("the server's certificates cannot be used: {0}")]
    Tls(#[source] crate::Error),
    /// This build lacks the feature `tls`, which a certificate needs.
    #[error("this build has no TLS for the server's certificates; build it with the feature tls")]
    NoTls,
}

/// Serves `infer` on `listener` until `until` is ready, then lets the calls under way end.
///
/// The server logs a warning, with the address and the reason, if it refuses a client or closes a
/// connection. It logs each reason once a second at most, with the number of the others. It also
/// warns if the system has no room for another connection, and goes on with those that it has.
///
/// # Errors
/// Returns an error if the certificates cannot be used.
pub async fn serve(
    infer: impl Infer,
    server: Server,
    listener: TcpListener,
    until: impl Future<Output = ()>,
) -> Result<(), ServeError> {
    let incoming = stream::unfold(listener, async |listener| {
        let accepted = listener.accept().await.inspect(|(socket, _)| {
            let _ = socket.set_nodelay(true);
        });
        Some((accepted, listener))
    });
    serve_with_incoming(infer, server, incoming, until).await
}

/// Serves as [`serve`] does, on connections of any kind, each with the address that it counts for.
/// Also ends when `incoming` ends.
///
/// # Errors
/// Returns an error if the certificates cannot be used.
pub async fn serve_with_incoming<S>(
    infer: impl Infer,
    server: Server,
    incoming: impl Stream<Item = io::Result<(S, SocketAddr)>>,
    until: impl Future<Output = ()>,
) -> Result<(), ServeError>
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let tls = tls::acceptor(server.identity.as_ref(), server.client_ca.as_deref())?;
    let limits = Arc::new(ServerLimits::new(server.bounds));
    let (close, closing) = watch::channel(());
    let connection_handler = ConnectionHandler {
        limits: Arc::clone(&limits),
        infer: InferServer::new(infer),
        auth: AuthCheck(server.token),
        tls,
        closing,
    };
    let mut connections = JoinSet::new();
    {
        let (mut until, mut incoming) = (pin!(until), pin!(incoming));
        loop {
            tokio::select! {
                () = &mut until => break,
                accepted = incoming.next() => match accepted {
                    Some(Ok((socket, peer))) => match limits.permit(peer.ip()) {
                        Ok(permit) => {
                            connections.spawn(connection_handler.clone().run(Box::new(socket), peer, permit));
                        }
                        Err(why) => limits.log(peer, &why),
                    },
                    Some(Err(error)) => {
                        warn!(%error, "a connection cannot be accepted");
                        tokio::time::sleep(ACCEPT_PAUSE).await;
                    }
                    None => break,
                },
                Some(_) = connections.join_next() => {}
            }
        }
    }
    let _ = close.send(());
    while connections.join_next().await.is_some() {}
    Ok(())
}
