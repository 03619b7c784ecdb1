//! Small files that options name: certificates, keys and tokens.

use std::env;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use fuseline_tokio::grpc::{Identity, InvalidToken, Token};
use rustls_pki_types::pem::PemObject;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use thiserror::Error;

use crate::fault::{Fault, plain};

/// Certificates and tokens are far smaller, in bytes.
const BYTES: u64 = 1 << 20;

/// The reason why a file is of no use.
#[derive(Debug, Error)]
pub(crate) enum FileError {
    #[error("{path}: {}; give a file that can be read", plain(.source))]
    Read { path: PathBuf, source: io::Error },
    #[error("{path}: the file has more than 1 MiB; give a certificate, a key or a token")]
    TooLarge { path: PathBuf },
    #[error("{path}: {source}")]
    Token { path: PathBuf, source: InvalidToken },
    #[error("{path}: the file has no certificate; give one in PEM{}", hint(.found))]
    NoCertificate { path: PathBuf, found: Vec<u8> },
    #[error("{path}: the file has no private key; give one in PEM{}", hint(.found))]
    NoKey { path: PathBuf, found: Vec<u8> },
    #[error("a certificate needs its key and a key its certificate; give both")]
    Half,
}

impl From<FileError> for Fault {
    fn from(error: FileError) -> Self {
        Self::own(error)
    }
}

/// Returns the bytes of a small file.
///
/// # Errors
/// If it cannot be read or is not small.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let fault = |source| FileError::Read { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(BYTES + 1).read_to_end(&mut bytes))
        .map_err(fault)?;
    if bytes.len() as u64 > BYTES {
        return Err(FileError::TooLarge { path: path.to_owned() });
    }
    Ok(bytes)
}

/// Says what was found instead, if that is known.
fn hint(found: &[u8]) -> &'static str {
    if CertificateDer::from_pem_slice(found).is_ok() {
        " (this is a certificate)"
    } else if PrivateKeyDer::from_pem_slice(found).is_ok() {
        " (this is a private key)"
    } else {
        ""
    }
}

/// Returns the certificates in a file, at least one, as PEM.
///
/// # Errors
/// If it cannot be read or holds none.
pub(crate) fn certificates(path: &Path) -> Result<Vec<u8>, FileError> {
    let bytes = bytes(path)?;
    if CertificateDer::from_pem_slice(&bytes).is_err() {
        return Err(FileError::NoCertificate { path: path.to_owned(), found: bytes });
    }
    Ok(bytes)
}

/// Returns the private key in a file, as PEM.
fn key(path: &Path) -> Result<Vec<u8>, FileError> {
    let bytes = bytes(path)?;
    if PrivateKeyDer::from_pem_slice(&bytes).is_err() {
        return Err(FileError::NoKey { path: path.to_owned(), found: bytes });
    }
    Ok(bytes)
}

/// Returns the bearer token in a file, without the white space around it.
///
/// # Errors
/// If the file cannot be read or holds none.
pub(crate) fn token(path: &Path) -> Result<Token, FileError> {
    let bytes = bytes(path)?;
    let text = str::from_utf8(&bytes).unwrap_or_default().trim();
    Token::new(text).map_err(|source| FileError::Token { path: path.to_owned(), source })
}

/// Returns the bearer token in the environment's `FUSELINE_TOKEN`, if it is set and not empty.
///
/// # Errors
/// If it is set to something that no token can be: whoever set it wants it to be used.
pub(crate) fn token_of_environment() -> Result<Option<Token>, FileError> {
    const NAME: &str = "FUSELINE_TOKEN";
    let Some(value) = env::var_os(NAME).filter(|value| !value.is_empty()) else { return Ok(None) };
    let token = Token::new(value.to_str().unwrap_or_default());
    token.map(Some).map_err(|source| FileError::Token { path: NAME.into(), source })
}

/// Returns the identity that a certificate and its key make, if both are there.
///
/// # Errors
/// If one is missing or cannot be read.
pub(crate) fn identity(
    certificate: Option<&Path>,
    private: Option<&Path>,
) -> Result<Option<Identity>, FileError> {
    match (certificate, private) {
        (Some(certificate), Some(private)) => {
            Ok(Some(Identity { certificate: certificates(certificate)?, key: key(private)? }))
        }
        (None, None) => Ok(None),
        (Some(_), None) | (None, Some(_)) => Err(FileError::Half),
    }
}
