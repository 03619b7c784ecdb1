//! The server's side of TLS (D12).

use std::sync::Arc;

use rustls_pki_types::pem::PemObject;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
pub(crate) use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{RootCertStore, ServerConfig};

use crate::Error;
use crate::grpc::remote::Identity;
use crate::grpc::server::ServeError;

/// Returns an acceptor of TLS connections with this identity, or `None` without an identity. If
/// there is a CA, it accepts only the CA's clients.
///
/// # Errors
/// Returns an error if there is a CA without an identity, or if the certificates or the key cannot
/// be used.
pub(crate) fn acceptor(
    identity: Option<&Identity>,
    client_ca: Option<&[u8]>,
) -> Result<Option<TlsAcceptor>, ServeError> {
    match (identity, client_ca) {
        (Some(identity), client_ca) => {
            let config = config(identity, client_ca).map_err(ServeError::Tls)?;
            Ok(Some(TlsAcceptor::from(Arc::new(config))))
        }
        (None, Some(_)) => Err(ServeError::Identity),
        (None, None) => Ok(None),
    }
}

fn config(identity: &Identity, client_ca: Option<&[u8]>) -> Result<ServerConfig, Error> {
    let builder = ServerConfig::builder();
    let builder = match client_ca {
        Some(ca) => {
            let mut roots = RootCertStore::empty();
            for certificate in certificates(ca)? {
                roots.add(certificate)?;
            }
            let verifier = WebPkiClientVerifier::builder(roots.into()).build()?;
            builder.with_client_cert_verifier(verifier)
        }
        None => builder.with_no_client_auth(),
    };
    let key = PrivateKeyDer::from_pem_slice(&identity.key)?;
    let mut config = builder.with_single_cert(certificates(&identity.certificate)?, key)?;
    config.alpn_protocols.push(b"h2".to_vec());
    Ok(config)
}

fn certificates(pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, Error> {
    Ok(CertificateDer::pem_slice_iter(pem).collect::<Result<_, _>>()?)
}
