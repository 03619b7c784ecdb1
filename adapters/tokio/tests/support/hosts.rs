//! Servers and certificates for tests over real sockets on loopback.

use std::net::SocketAddr;
use std::sync::mpsc;
use std::thread::{self, JoinHandle};

use fuseline_tokio::grpc::{Identity, Infer, Remote, Server, serve};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use std::future::pending;
use tokio::net::TcpSocket;
use tokio::sync::oneshot;

/// A server with its own runtime, so that it can be killed with all its connections.
pub(crate) struct Cloud {
    pub(crate) address: SocketAddr,
    kill: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl Cloud {
    /// Starts a server that listens at `address`. Port 0 means any free port.
    pub(crate) fn start(address: &str, server: Server, infer: impl Infer) -> Self {
        let (kill, killed) = oneshot::channel();
        let (sender, reported) = mpsc::channel();
        let address = address.parse().unwrap();
        let thread = thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.unwrap().block_on(async {
                let socket = TcpSocket::new_v4().unwrap();
                socket.set_reuseaddr(true).unwrap();
                socket.bind(address).unwrap();
                // The queue is long, because a client that finds it full tries again only after a
                // second.
                let listener = socket.listen(4096).unwrap();
                sender.send(listener.local_addr().unwrap()).unwrap();
                tokio::select! {
                    ended = serve(infer, server, listener, pending()) => ended.unwrap(),
                    _ = killed => {}
                }
            });
        });
        Self { address: reported.recv().unwrap(), kill, thread }
    }

    /// Ends the server and closes all its sockets.
    pub(crate) fn kill(self) {
        self.kill.send(()).unwrap();
        self.thread.join().unwrap();
    }

    pub(crate) fn http(&self) -> Remote {
        Remote::new(format!("http://{}", self.address))
    }

    pub(crate) fn https(&self, ca: &Ca) -> Remote {
        let url = format!("https://localhost:{}", self.address.port());
        Remote { ca: Some(ca.certificate.clone()), ..Remote::new(url) }
    }
}

/// A certificate authority for a test.
pub(crate) struct Ca {
    pub(crate) certificate: Vec<u8>,
    issuer: Issuer<'static, KeyPair>,
}

impl Ca {
    pub(crate) fn new() -> Self {
        let mut params = CertificateParams::new([]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        let certificate = params.self_signed(&key).unwrap().pem().into_bytes();
        Self { certificate, issuer: Issuer::new(params, key) }
    }

    pub(crate) fn sign(&self, name: &str) -> Identity {
        self.sign_until(name, 4000)
    }

    /// Returns a certificate that expires at the beginning of `year`.
    pub(crate) fn sign_until(&self, name: &str, year: i32) -> Identity {
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new([name.to_owned()]).unwrap();
        params.not_after = rcgen::date_time_ymd(year, 1, 1);
        let certificate = params.signed_by(&key, &self.issuer).unwrap().pem().into_bytes();
        Identity { certificate, key: key.serialize_pem().into_bytes() }
    }
}
