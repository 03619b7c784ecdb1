//! Raw HTTP/2 on loopback on both sides of a recorded network.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use bytes::Bytes;
use fuseline_testkit::networks::Drive;
use fuseline_tokio::grpc::{Remote, RemoteError};
use h2::client::SendRequest;
use h2::server::SendResponse;
use h2::{Reason, RecvStream};
use http::{HeaderMap, Request, Response};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use super::{RecordedNetwork, forward};

/// A fault must come within this time.
const PATIENCE: Duration = Duration::from_secs(60);
const ROUND_TRIP: Duration = Duration::from_millis(200);

fn network(round_trip_ms: u64) -> RecordedNetwork {
    let rows = format!("second,rtt_ms\n0,{round_trip_ms}\n1000,{round_trip_ms}\n");
    RecordedNetwork::new(Drive::read("d.csv", None, rows.as_bytes()).unwrap(), Duration::ZERO)
}

async fn listener() -> (TcpListener, SocketAddr) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

/// A server that hands its calls on, and where it listens.
async fn server()
-> (mpsc::UnboundedReceiver<(Request<RecvStream>, SendResponse<Bytes>)>, SocketAddr) {
    let (listener, address) = listener().await;
    let (calls, received) = mpsc::unbounded_channel();
    tokio::spawn(async move {
        while let Ok((socket, _)) = listener.accept().await {
            let calls = calls.clone();
            tokio::spawn(async move {
                let mut connection = h2::server::handshake(socket).await.unwrap();
                while let Some(Ok(call)) = connection.accept().await {
                    calls.send(call).unwrap();
                }
            });
        }
    });
    (received, address)
}

/// A client of the server behind the network.
async fn client(
    server: SocketAddr,
    network: RecordedNetwork,
) -> (SendRequest<Bytes>, JoinHandle<Result<(), RemoteError>>) {
    let (listener, address) = listener().await;
    let remote = Remote::new(format!("http://{server}"));
    let proxy =
        tokio::spawn(
            async move { forward(&remote, network, listener, std::future::pending()).await },
        );
    let socket = TcpStream::connect(address).await.unwrap();
    let (client, connection) = h2::client::handshake(socket).await.unwrap();
    tokio::spawn(connection);
    (client.ready().await.unwrap(), proxy)
}

fn call() -> Request<()> {
    let call = Request::post("http://vehicle.example/any.Service/Method")
        .header("content-type", "application/grpc")
        .header("te", "trailers")
        .header("grpc-timeout", "9S")
        .header("x-frame-bin", "AAE");
    call.body(()).unwrap()
}

/// Returns what comes next; the end may have an empty frame of its own.
async fn next(body: &mut RecvStream) -> Option<Bytes> {
    loop {
        let data = body.data().await?.unwrap();
        body.flow_control().release_capacity(data.len()).unwrap();
        if !data.is_empty() {
            return Some(data);
        }
    }
}

#[tokio::test]
async fn call_is_late_by_the_round_trip_and_unread() {
    let (mut calls, address) = server().await;
    let (mut client, _proxy) = client(address, network(200)).await;
    let began = Instant::now();
    let (response, mut sending) = client.send_request(call(), false).unwrap();
    // No protobuf: nobody reads it.
    sending.send_data(Bytes::from_static(b"\xff\xff not gRPC"), true).unwrap();

    let (request, mut respond) = calls.recv().await.unwrap();
    assert!(began.elapsed() >= ROUND_TRIP / 2);
    let (head, mut body) = request.into_parts();
    assert_eq!(head.uri.path(), "/any.Service/Method");
    for (name, value) in call().headers() {
        assert_eq!(head.headers.get(name), Some(value));
    }
    assert_eq!(next(&mut body).await.unwrap(), &b"\xff\xff not gRPC"[..]);
    assert!(next(&mut body).await.is_none());
    let answer = Response::builder().header("x-model", "yolo").body(()).unwrap();
    let mut replying = respond.send_response(answer, false).unwrap();
    replying.send_data(Bytes::from(vec![7; 300_000]), false).unwrap();
    let mut trailers = HeaderMap::new();
    trailers.insert("grpc-status", "5".parse().unwrap());
    trailers.insert("grpc-message", "no such frame".parse().unwrap());
    replying.send_trailers(trailers.clone()).unwrap();

    let (head, mut body) = response.await.unwrap().into_parts();
    assert!(began.elapsed() >= ROUND_TRIP);
    assert_eq!(head.headers["x-model"], "yolo");
    let mut bytes = 0;
    while let Some(data) = next(&mut body).await {
        assert!(data.iter().all(|byte| *byte == 7));
        bytes += data.len();
    }
    assert_eq!(bytes, 300_000);
    assert_eq!(body.trailers().await.unwrap(), Some(trailers));
}

#[tokio::test]
async fn status_without_message_ends_with_headers() {
    let (mut calls, address) = server().await;
    let (mut client, _proxy) = client(address, network(2)).await;
    let (response, _sending) = client.send_request(call(), true).unwrap();
    let (_, mut respond) = calls.recv().await.unwrap();
    let status = Response::builder().header("grpc-status", "12").body(()).unwrap();
    respond.send_response(status, true).unwrap();
    let response = response.await.unwrap();
    assert_eq!(response.headers()["grpc-status"], "12");
    assert!(response.body().is_end_stream());
}

#[tokio::test]
async fn both_sides_of_a_stream_go_on_at_once() {
    let (mut calls, address) = server().await;
    let (mut client, _proxy) = client(address, network(20)).await;
    let (response, mut sending) = client.send_request(call(), false).unwrap();
    let (request, mut respond) = calls.recv().await.unwrap();
    let mut replying = respond.send_response(Response::new(()), false).unwrap();
    let (mut request, mut response) = (request.into_body(), response.await.unwrap().into_body());
    for number in 0..5_u8 {
        sending.send_data(Bytes::from(vec![number]), number == 4).unwrap();
        let data = next(&mut request).await.unwrap();
        assert_eq!(data, vec![number]);
        replying.send_data(data, number == 4).unwrap();
        assert_eq!(next(&mut response).await.unwrap(), vec![number]);
    }
    assert!(next(&mut request).await.is_none() && next(&mut response).await.is_none());
}

#[tokio::test]
async fn call_given_up_ends_behind_the_network() {
    let (mut calls, address) = server().await;
    let (mut client, _proxy) = client(address, network(2)).await;
    for is_answering in [false, true] {
        let (response, mut sending) = client.send_request(call(), false).unwrap();
        let (_request, mut respond) = calls.recv().await.unwrap();
        if is_answering {
            let mut replying = respond.send_response(Response::new(()), false).unwrap();
            let response = response.await.unwrap();
            sending.send_reset(Reason::CANCEL);
            drop(response);
            let ended = std::future::poll_fn(|context| replying.poll_reset(context));
            assert!(tokio::time::timeout(PATIENCE, ended).await.expect("it goes on").is_ok());
        } else {
            sending.send_reset(Reason::CANCEL);
            drop(response);
            let ended = std::future::poll_fn(|context| respond.poll_reset(context));
            assert!(tokio::time::timeout(PATIENCE, ended).await.expect("it goes on").is_ok());
        }
    }
}

#[tokio::test]
async fn absent_server_is_a_status_bad_url_an_error() {
    let (closed, address) = listener().await;
    drop(closed);
    let (mut client, _proxy) = client(address, network(2)).await;
    let (response, _sending) = client.send_request(call(), true).unwrap();
    assert_eq!(response.await.unwrap().headers()["grpc-status"], "14");
    for url in ["localhost:50051", "ftp://localhost", "http://", "http://a b"] {
        let (listener, _) = listener().await;
        let remote = Remote::new(url);
        let ended = forward(&remote, network(2), listener, std::future::pending()).await;
        assert!(ended.is_err(), "{url}");
    }
}
