//! Bearer tokens (D12).

use std::fmt;
use std::sync::{Arc, PoisonError, RwLock};

use http::HeaderMap;
use subtle::ConstantTimeEq;
use thiserror::Error;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::{Request, Status};

/// A bearer token that can be replaced while connections use it. Clones share it.
#[derive(Clone)]
pub struct Token(Arc<RwLock<MetadataValue<Ascii>>>);

/// The token is empty or has characters other than visible ASCII.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
#[error("a token must be one or more visible ASCII characters")]
pub struct InvalidToken;

impl Token {
    /// Creates a token of visible ASCII characters.
    ///
    /// # Errors
    /// Returns an error if the token is empty or has other characters.
    pub fn new(token: &str) -> Result<Self, InvalidToken> {
        header(token).map(|header| Self(Arc::new(RwLock::new(header))))
    }

    /// Replaces the token for calls from now on.
    ///
    /// # Errors
    /// Returns an error if the new token is empty or has characters other than visible ASCII. The
    /// old token then stays.
    pub fn replace(&self, token: &str) -> Result<(), InvalidToken> {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = header(token)?;
        Ok(())
    }

    fn header(&self) -> MetadataValue<Ascii> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

/// Adds the token, if any, to each call.
#[derive(Clone, Debug)]
pub struct BearerToken(pub(crate) Option<Token>);

impl Interceptor for BearerToken {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            request.metadata_mut().insert("authorization", token.header());
        }
        Ok(request)
    }
}

/// Accepts only calls with the token, if there is one.
#[derive(Clone, Debug)]
pub(crate) struct AuthCheck(pub(crate) Option<Token>);

impl AuthCheck {
    pub(crate) fn check(&self, headers: &HeaderMap) -> Result<(), Status> {
        let Some(token) = &self.0 else { return Ok(()) };
        match headers.get("authorization") {
            Some(shown) if is_same(shown.as_bytes(), token.header().as_encoded_bytes()) => Ok(()),
            Some(_) => Err(Status::unauthenticated("the bearer token is wrong")),
            None => Err(Status::unauthenticated("a bearer token is needed")),
        }
    }
}

/// Compares in a time that does not depend on where the two differ, so it reveals nothing about the
/// token.
fn is_same<T: ConstantTimeEq>(shown: &[T], token: &[T]) -> bool {
    shown.ct_eq(token).into()
}

fn header(token: &str) -> Result<MetadataValue<Ascii>, InvalidToken> {
    if token.is_empty() || !token.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Err(InvalidToken);
    }
    let mut header: MetadataValue<Ascii> =
        format!("Bearer {token}").parse().map_err(|_| InvalidToken)?;
    header.set_sensitive(true);
    Ok(header)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use subtle::Choice;

    use super::*;

    /// A byte that counts how often it is compared.
    struct Byte<'a>(u8, &'a Cell<usize>);

    impl ConstantTimeEq for Byte<'_> {
        fn ct_eq(&self, other: &Self) -> Choice {
            self.1.update(|count| count + 1);
            self.0.ct_eq(&other.0)
        }
    }

    /// Every byte is compared, wherever the token that a client shows differs (D12).
    #[test]
    fn every_byte_is_looked_at_wherever_the_token_shown_differs() {
        let token = b"Bearer secret";
        let looked_at = |shown: &[u8]| {
            let looks = Cell::new(0);
            let [shown, token] = [shown, token]
                .map(|bytes| -> Vec<_> { bytes.iter().map(|byte| Byte(*byte, &looks)).collect() });
            (is_same(&shown, &token), looks.get())
        };
        let all = token.len();
        assert_eq!(looked_at(token), (true, all));
        for index in 0..token.len() {
            let mut shown = *token;
            shown[index] ^= 1;
            assert_eq!(looked_at(&shown), (false, all), "{index}");
            assert!(!looked_at(&token[..index]).0, "the first {index} are not all");
        }
    }
}
