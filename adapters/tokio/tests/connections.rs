//! Tests the time limits of a connection: for a client's attempt to reach a host, and for an
//! unknown client's greeting.
#![cfg(feature = "grpc")]

use std::future::{self, ready};
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use fuseline_tokio::grpc::{
    Bounds, CallError, Identity, InferClient, Remote, Reply, Request, Server, serve_with_incoming,
    tonic,
};
use futures_util::{StreamExt, stream};
use tokio::io::AsyncReadExt;
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::{Instant, pause, timeout};

/// An attempt to reach an unreachable host ends, so that the next one succeeds once the host is
/// back (D13).
#[cfg(target_os = "linux")]
#[tokio::test]
async fn an_attempt_to_connect_ends_with_its_deadline() {
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
    let listener = socket.listen(0).unwrap();
    let address = listener.local_addr().unwrap();
    // When the queue is full, the system drops new connections, as if the host were unreachable.
    let mut queued = Vec::new();
    let more = || timeout(Duration::from_millis(300), TcpStream::connect(address));
    while let Ok(connected) = more().await {
        queued.push(connected.unwrap());
    }
    // From here on the time is virtual. An unreachable host does nothing, and the load of the test
    // host must not matter.
    pause();
    let connect_deadline = Duration::from_millis(100);
    let remote = Remote { connect_deadline, ..Remote::new(format!("http://{address}")) };
    let mut client = InferClient::new(remote.connect().unwrap());
    let call = client.infer(tonic::Request::new(Request::default()));
    let failed = timeout(20 * connect_deadline, call).await.expect("the attempt goes on");
    let why = CallError::from(failed.unwrap_err()).to_string();
    assert_eq!(why, "no connection in time");
}

/// A place is given back when the time for the greeting is over, also with TLS (D8).
#[tokio::test(start_paused = true)]
async fn who_says_nothing_over_tls_is_closed_when_its_greeting_is_over() {
    let greeting = Duration::from_secs(7);
    let bounds = Bounds { greeting, ..Bounds::default() };
    let own = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let (certificate, key) = (own.cert.pem().into(), own.signing_key.serialize_pem().into());
    let identity = Some(Identity { certificate, key });
    let server = Server { identity, bounds, ..Server::default() };
    let (mut silent, socket) = tokio::io::duplex(1024);
    let peer = SocketAddr::from(([10, 0, 0, 1], 1));
    let incoming = stream::iter([Ok((socket, peer))]).chain(stream::pending());
    let infer = |_: Request| ready(Ok(Reply::default()));
    let serving = serve_with_incoming(infer, server, incoming, future::pending());
    let (begin, mut read) = (Instant::now(), Vec::new());
    tokio::select! {
        ended = serving => panic!("{ended:?}"),
        closed = timeout(10 * greeting, silent.read_to_end(&mut read)) => {
            assert_eq!(closed.expect("it keeps its place").unwrap(), 0);
        }
    }
    assert_eq!(begin.elapsed().as_secs(), greeting.as_secs());
}

/// A server that has no descriptor for one connection accepts the next one (D8).
#[tokio::test(start_paused = true)]
async fn server_goes_on_after_a_failed_accept() {
    let (mut visitor, socket) = tokio::io::duplex(1024);
    let no_descriptor = io::Error::from_raw_os_error(24);
    let arrivals = [Err(no_descriptor), Ok((socket, SocketAddr::from(([10, 0, 0, 1], 1))))];
    let incoming = stream::iter(arrivals).chain(stream::pending());
    let infer = |_: Request| ready(Ok(Reply::default()));
    let serving = serve_with_incoming(infer, Server::default(), incoming, future::pending());
    // A visitor that sends nothing is accepted, and closed when the time for its greeting is over.
    let mut read = Vec::new();
    tokio::select! {
        ended = serving => panic!("{ended:?}"),
        closed = visitor.read_to_end(&mut read) => drop(closed.unwrap()),
    }
}
