//! The cloud's side: a server for the `Infer` service.

use thiserror::Error;
use tokio::net::TcpListener;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::server::TcpIncoming;
use tonic::transport::{self, Certificate, ServerTlsConfig};

use crate::grpc::infer::{Infer, InferServer};
use crate::grpc::remote::Identity;
use crate::grpc::token::{Doorman, Token};

/// How many calls one connection may have under way.
const CALLS: u32 = 64;

/// Whom a server accepts; by default everybody, without TLS.
#[derive(Clone, Debug, Default)]
pub struct Server {
    /// The server's certificate; with it, the server speaks TLS.
    pub identity: Option<Identity>,
    /// The CA certificates, PEM, one of which must have signed the client's (mutual TLS); needs an identity.
    pub client_ca: Option<Vec<u8>>,
    /// The token that each call must bear.
    pub token: Option<Token>,
}

/// Why a server ended by itself.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Client certificates are required but the server has no identity.
    #[error("asking for clients' certificates needs a certificate and key of the server's own")]
    Identity,
    /// The certificates or the key cannot be used.
    #[error("the server's certificates: {0}")]
    Tls(#[source] transport::Error),
    /// The network failed.
    #[error("the server: {0}")]
    Network(#[source] transport::Error),
}

/// Serves `infer` on `listener` until `until` is ready, then lets the calls under way end.
///
/// # Errors
/// If certificates cannot be used, or the listener fails.
pub async fn serve(
    infer: impl Infer,
    server: Server,
    listener: TcpListener,
    until: impl Future<Output = ()>,
) -> Result<(), ServeError> {
    let mut builder = transport::Server::builder().max_concurrent_streams(CALLS);
    match (server.identity, server.client_ca) {
        (Some(Identity { certificate, key }), client_ca) => {
            let identity = transport::Identity::from_pem(certificate, key);
            let mut tls = ServerTlsConfig::new().identity(identity);
            if let Some(ca) = client_ca {
                tls = tls.client_ca_root(Certificate::from_pem(ca));
            }
            builder = builder.tls_config(tls).map_err(ServeError::Tls)?;
        }
        (None, Some(_)) => return Err(ServeError::Identity),
        (None, None) => {}
    }
    let service = InterceptedService::new(InferServer::new(infer), Doorman(server.token));
    let incoming = TcpIncoming::from(listener).with_nodelay(Some(true));
    let router = builder.add_service(service);
    router.serve_with_incoming_shutdown(incoming, until).await.map_err(ServeError::Network)
}
