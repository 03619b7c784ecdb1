//! Local and the clouds: how a message gets to each of them.

use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::grpc::{self, Identity, Remote, Token};
use fuseline_tokio::{Call, Error, StampedValue};
use futures_util::future::BoxFuture;

use crate::error::GrpcError;
use crate::middleware::{Endpoint, Publish};
use crate::raw::Payload;
use crate::settings::Grpc;

/// Local or a cloud, as the node sees it.
pub(crate) struct NodeSource {
    /// 0 is local.
    pub(crate) priority: u16,
    pub(crate) name: String,
    pub(crate) route: Route,
    /// `true` if it gets requests at all; local always does.
    pub(crate) enabled: bool,
    /// Its deadline; `None` means the node's deadline.
    pub(crate) deadline: Option<Duration>,
    /// The topic of its late results, if there is one.
    pub(crate) hints: Option<Box<dyn Publish>>,
    pub(crate) unmatched: UnmatchedResults,
}

/// The connection to it.
pub(crate) enum Route {
    /// Over two topics.
    Topics { requests: Box<dyn Publish>, results: Arc<Endpoint> },
    /// gRPC, with a call for each message.
    Grpc(Handle),
}

/// Makes a call with a serialized message, and returns a serialized result.
pub(crate) type Handle = Arc<
    dyn Fn(Payload, Call) -> BoxFuture<'static, Result<StampedValue<Payload>, Error>> + Send + Sync,
>;

/// Counts what came on a source's topic and is no message's result.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct UnmatchedResults {
    /// Results whose key belongs to no remembered message.
    pub(crate) unknown_stamp: u64,
    /// The results among `unknown_stamp` whose header has the stamp 0.
    pub(crate) stamp_zero: u64,
    /// Results without a key.
    pub(crate) malformed: u64,
}

/// A reply is not plain CDR.
#[derive(Debug, thiserror::Error)]
#[error("the reply is not a message serialized as plain CDR")]
struct NotCdr;

impl NodeSource {
    /// Describes the missing peers, if there are any.
    pub(crate) fn missing(&self) -> Option<String> {
        match &self.route {
            Route::Topics { requests, .. } if requests.matched() == 0 => {
                Some(format!("nobody subscribes to {}", requests.end().topic))
            }
            Route::Topics { results, .. } if results.matched() == 0 => {
                Some(format!("nobody publishes on {}", results.topic))
            }
            Route::Topics { .. } | Route::Grpc(_) => None,
        }
    }

    /// Returns `true` if a message can get there now.
    pub(crate) fn is_reached(&self) -> bool {
        match &self.route {
            Route::Topics { requests, .. } => requests.matched() > 0,
            Route::Grpc(_) => true,
        }
    }

    /// Returns the topics' ends, to report peers that do not fit.
    pub(crate) fn ends(&self) -> impl Iterator<Item = &Endpoint> {
        let ends = match &self.route {
            Route::Topics { requests, results } => [Some(&**requests.end()), Some(&**results)],
            Route::Grpc(_) => [None, None],
        };
        ends.into_iter().flatten().chain(self.hints.iter().map(|hints| &**hints.end()))
    }
}

/// Returns the handle of a cloud that offers `fuseline.v1.Infer`.
///
/// # Errors
/// If a file cannot be read or the address is not valid.
pub(crate) fn call(grpc: &Grpc) -> Result<Handle, GrpcError> {
    let mut remote = Remote::new(&grpc.url);
    remote.ca = grpc.ca.as_deref().map(certificates).transpose()?;
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
        let request = grpc::Request {
            timestamp: call.timestamp,
            payload: payload.to_serialized(),
            ..grpc::Request::default()
        };
        let reply = infer(request, call);
        Box::pin(async move {
            let grpc::Reply { payload, of, meant_for } = reply.await?;
            let value = Payload::from_serialized(&payload).ok_or(NotCdr)?;
            Ok(StampedValue { value, of, meant_for })
        })
    }))
}

/// Reads the certificates that are trusted. With none, each call would fail for a reason that does
/// not name the file.
fn certificates(path: &std::path::Path) -> Result<Vec<u8>, GrpcError> {
    let bytes = read(path)?;
    if String::from_utf8_lossy(&bytes).contains("-----BEGIN CERTIFICATE-----") {
        Ok(bytes)
    } else {
        Err(GrpcError::NoCertificate { path: path.display().to_string() })
    }
}

fn read(path: impl AsRef<std::path::Path>) -> Result<Vec<u8>, GrpcError> {
    let path = path.as_ref();
    std::fs::read(path).map_err(|error| GrpcError::File { path: path.display().to_string(), error })
}

#[cfg(test)]
mod tests {
    use std::future::ready;
    use std::path::PathBuf;

    use fuseline_engine::{Engine, EngineConfig};
    use fuseline_tokio::grpc::Server;
    use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
    use tokio::net::TcpListener;

    use super::*;

    /// The credentials that a server requires, and a client's files of them.
    struct CredentialFiles {
        folder: tempfile::TempDir,
        server: Server,
    }

    impl CredentialFiles {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let mut params = CertificateParams::new([]).unwrap();
            params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
            let key = KeyPair::generate().unwrap();
            let ca = params.self_signed(&key).unwrap().pem();
            let issuer = Issuer::new(params, key);
            let sign = |name: &str| {
                let key = KeyPair::generate().unwrap();
                let params = CertificateParams::new([name.to_owned()]).unwrap();
                (params.signed_by(&key, &issuer).unwrap().pem(), key.serialize_pem())
            };
            let (ours, our_key) = sign("robot");
            for (name, text) in
                [("ca", ca.as_str()), ("ours", &ours), ("key", &our_key), ("token", "a-token\n")]
            {
                std::fs::write(folder.path().join(name), text).unwrap();
            }
            let (theirs, their_key) = sign("localhost");
            let server = Server {
                identity: Some(Identity { certificate: theirs.into(), key: their_key.into() }),
                client_ca: Some(ca.into()),
                token: Some(Token::new("a-token").unwrap()),
                ..Server::default()
            };
            Self { folder, server }
        }

        fn file(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }
    }

    /// One call's result.
    async fn call_once(grpc: &Grpc) -> Result<StampedValue<Payload>, Error> {
        let engine = Engine::<Payload, Payload>::new(EngineConfig::default()).unwrap();
        let call_of = Call::new(7, Duration::from_secs(60), 0, engine.counts());
        let message = Payload { big_endian: true, body: b"message".as_slice().into() };
        call(grpc).unwrap()(message, call_of).await
    }

    /// D2, D12, D18.
    #[tokio::test]
    async fn a_call_bears_the_token_and_the_certificate_of_their_files() {
        let secrets = CredentialFiles::new();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("https://localhost:{}", listener.local_addr().unwrap().port());
        let echo = |request: grpc::Request| {
            let (payload, of) = (request.payload, Some(request.timestamp));
            ready(Ok(grpc::Reply { payload, of, meant_for: Some(9) }))
        };
        let server = grpc::serve(echo, secrets.server.clone(), listener, std::future::pending());
        let server = tokio::spawn(server);
        let all = Grpc {
            url,
            ca: Some(secrets.file("ca")),
            certificate: Some(secrets.file("ours")),
            key: Some(secrets.file("key")),
            token_file: Some(secrets.file("token")),
            server_name: None,
        };
        let StampedValue { value: echoed, of, meant_for } = call_once(&all).await.unwrap();
        assert_eq!((of, meant_for), (Some(7), Some(9)));
        assert_eq!((echoed.big_endian, &echoed.body[..]), (true, b"message".as_slice()));
        let without_token = Grpc { token_file: None, ..all.clone() };
        let without_certificate = Grpc { certificate: None, key: None, ..all };
        assert!(call_once(&without_token).await.is_err(), "the server asks for no token");
        assert!(
            call_once(&without_certificate).await.is_err(),
            "the server asks for no certificate"
        );
        server.abort();
    }

    /// D12.
    #[tokio::test]
    async fn a_secret_that_is_set_and_cannot_be_read_is_an_error() {
        let secrets = CredentialFiles::new();
        let write = |name: &str, bytes: &[u8]| {
            std::fs::write(secrets.folder.path().join(name), bytes).unwrap();
        };
        write("not-unicode", b"a-token\xff");
        write("empty", b" \n");
        write("lines", b"a-token\nanother");
        let plain = Grpc {
            url: "https://localhost:1".into(),
            ca: Some(secrets.file("ca")),
            certificate: None,
            key: None,
            token_file: None,
            server_name: None,
        };
        assert!(call(&plain).is_ok());
        for file in ["none", ".", "not-unicode", "empty", "lines"] {
            let path = secrets.file(file);
            let shown = path.display().to_string();
            let refused = call(&Grpc { token_file: Some(path), ..plain.clone() }).err().unwrap();
            assert!(refused.to_string().starts_with(&shown), "{refused}");
        }
        let no_certificate = Grpc { ca: Some(secrets.file("key")), ..plain.clone() };
        assert!(matches!(call(&no_certificate), Err(GrpcError::NoCertificate { .. })));
        for none in [
            Grpc { ca: Some(secrets.file("none")), ..plain.clone() },
            Grpc {
                certificate: Some(secrets.file("none")),
                key: Some(secrets.file("key")),
                ..plain.clone()
            },
            Grpc {
                certificate: Some(secrets.file("ours")),
                key: Some(secrets.file("none")),
                ..plain.clone()
            },
        ] {
            assert!(matches!(call(&none), Err(GrpcError::File { .. })));
        }
    }
}
