//! Replaces `tls` if the feature is off. It refuses certificates before a connection is accepted.

use std::convert::Infallible;
use std::future::Ready;
use std::io;

use crate::grpc::remote::Identity;
use crate::grpc::server::ServeError;

/// An acceptor that cannot exist.
#[derive(Clone)]
pub(crate) struct TlsAcceptor(Infallible);

impl TlsAcceptor {
    pub(crate) fn accept<S>(self, _: S) -> Ready<io::Result<S>> {
        match self.0 {}
    }
}

/// Returns no acceptor.
///
/// # Errors
/// Returns an error if there is an identity or a CA.
pub(crate) const fn acceptor(
    identity: Option<&Identity>,
    client_ca: Option<&[u8]>,
) -> Result<Option<TlsAcceptor>, ServeError> {
    match (identity, client_ca) {
        (None, None) => Ok(None),
        (None, Some(_)) => Err(ServeError::Identity),
        (Some(_), _) => Err(ServeError::NoTls),
    }
}
