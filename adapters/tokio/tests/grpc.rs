//! Tests clouds over real sockets on loopback.
#![cfg(feature = "grpc")]

use std::future::{pending, ready};
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use crate::hosts::{Ca, Cloud};
use crate::support::without_deadline;
use fuseline_engine::{Engine, EngineConfig};
use fuseline_tokio::grpc::tonic::{self, Code, Status, transport};
use fuseline_tokio::grpc::{
    self, CallError, Description, Identity, Infer, InferClient, InferServer, InvalidToken, Remote,
    RemoteError, Reply, Request, RequestLineage, ServeError, Server, Token, serve,
};
use fuseline_tokio::{
    Call, Config, Item, Items, Lineage, Local, Operator, Setup, SharedState, StampedValue, Trigger,
    Writer, spawn, stream,
};
use prost::Message;
use prost_reflect::{DescriptorPool, DynamicMessage, Value};
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::timeout;

/// Answers with the request's payload.
fn echo(request: Request) -> impl Future<Output = Result<Reply, Status>> {
    ready(Ok(Reply { payload: request.payload, ..Reply::default() }))
}

/// Never answers.
fn silent(_: Request) -> impl Future<Output = Result<Reply, Status>> {
    pending()
}

/// Makes one call.
async fn call(remote: &Remote) -> Result<Vec<u8>, Status> {
    one(&mut InferClient::new(remote.connect().unwrap()), b"frame").await
}

async fn one(client: &mut InferClient, payload: &[u8]) -> Result<Vec<u8>, Status> {
    let request = Request { timestamp: 7, payload: payload.to_vec().into(), ..Request::default() };
    let mut request = tonic::Request::new(request);
    request.set_timeout(Duration::from_secs(20));
    Ok(client.infer(request).await?.into_inner().payload.to_vec())
}

/// An operator with one cloud, whose local computation answers at once.
struct Vehicle {
    remote: Remote,
    deadline: Duration,
}

impl Operator for Vehicle {
    type Input = Vec<u8>;
    type Output = Vec<u8>;

    fn setup(self, setup: &mut Setup<Vec<u8>, Vec<u8>>) -> Local<Vec<u8>, Vec<u8>> {
        let message_handler = move |frame: &Vec<u8>, timestamp| {
            let payload = frame.clone().into();
            Some((Request { timestamp, payload, ..Request::default() }, self.deadline))
        };
        let response_handler = |reply: Reply| Ok([b"cloud ", &reply.payload[..]].concat());
        let handle = grpc::infer(self.remote.connect().unwrap());
        setup.use_cloud(handle, message_handler, response_handler, 1);
        without_deadline(Local::blocking(|_, _| Ok(b"local".into())))
    }
}

/// An operator whose cloud states the messages that its replies are of. Local's result comes when
/// the cloud has failed.
struct StampedVehicle(Remote);

impl Operator for StampedVehicle {
    type Input = Vec<u8>;
    type Output = Vec<u8>;

    fn setup(self, setup: &mut Setup<Vec<u8>, Vec<u8>>) -> Local<Vec<u8>, Vec<u8>> {
        let message_handler = |_: &Vec<u8>, timestamp| {
            Some((Request { timestamp, ..Request::default() }, Duration::from_secs(20)))
        };
        let response_handler = |reply: Reply| {
            let StampedValue { value, of, meant_for } = reply.stamped();
            Ok(StampedValue { value: value.to_vec(), of, meant_for })
        };
        let handle = grpc::infer(self.0.connect().unwrap());
        setup.use_stamped_cloud(handle, message_handler, response_handler, 1);
        Local::future(|_, _| async { Ok(b"local".to_vec()) })
    }
}

/// Returns a configuration that bounds no offer.
fn unbounded() -> Config {
    Config { greatest_deadline: Duration::MAX, ..Config::default() }
}

/// Sends one message and waits for its item. Returns the item's value and trigger.
async fn exchange(camera: &mut Writer<Vec<u8>>, output: &mut Items<Vec<u8>>) -> (Vec<u8>, Trigger) {
    camera.write(b"frame".into()).unwrap();
    let item = output.read().await.unwrap();
    let forwarded = Item::forwarded(&item).unwrap();
    (forwarded.value.clone(), forwarded.trigger)
}

/// Long enough that only a failure explains an earlier output.
const LONG: Duration = Duration::from_secs(3600);

#[tokio::test]
async fn a_cloud_answers_and_what_was_sent_is_counted() {
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), echo);
    let (mut camera, frames) = stream(8);
    let vehicle = Vehicle { remote: cloud.http(), deadline: LONG };
    let (running, mut output) = spawn(vehicle, unbounded(), frames).unwrap();
    assert_eq!(
        exchange(&mut camera, &mut output).await,
        (b"cloud frame".to_vec(), Trigger::Arrival)
    );
    assert_eq!(
        exchange(&mut camera, &mut output).await,
        (b"cloud frame".to_vec(), Trigger::Arrival)
    );
    // Timestamp 0 is not encoded, and 1 takes two bytes. The payload takes two bytes more than its
    // length, and gRPC adds five bytes in front.
    assert_eq!(running.tally().sources[1].sent_bytes, 12 + 14);
    camera.write(vec![7; 100_000]).unwrap();
    output.read().await.unwrap();
    assert_eq!(running.tally().sources[1].sent_bytes, 12 + 14 + 100_011);
    cloud.kill();
}

/// Returns the error of a call that fails.
async fn failure(remote: &Remote) -> String {
    CallError::from(call(remote).await.unwrap_err()).to_string()
}

#[tokio::test]
async fn a_call_that_came_to_nothing_says_why_in_plain_words() {
    let ca = Ca::new();
    let plain = Cloud::start("127.0.0.1:0", Server::default(), echo);
    let secure = Server { identity: Some(ca.sign("localhost")), ..Server::default() };
    let secure = Cloud::start("127.0.0.1:0", secure, echo);
    let old = Server { identity: Some(ca.sign_until("localhost", 2020)), ..Server::default() };
    let old = Cloud::start("127.0.0.1:0", old, echo);
    let locked = Server { token: Some(Token::new("secret").unwrap()), ..Server::default() };
    let locked = Cloud::start("127.0.0.1:0", locked, echo);
    assert_eq!(failure(&Remote::new("http://127.0.0.1:1")).await, "connection refused");
    assert_eq!(failure(&locked.http()).await, "a bearer token is needed");
    assert_eq!(failure(&plain.https(&ca)).await, "the server does not speak TLS");
    assert_eq!(failure(&secure.http()).await, "the connection broke");
    let unknown_client = failure(&secure.https(&Ca::new())).await;
    assert_eq!(unknown_client, "invalid peer certificate: BadSignature");
    // A text that changed every second would be a new reason every second.
    let expired = failure(&old.https(&ca)).await;
    assert_eq!(expired, "invalid peer certificate: certificate expired");
    [plain, secure, old, locked].into_iter().for_each(Cloud::kill);
}

/// All errors that break a connection are one reason, because it is chance which of them occurs
/// (D15).
#[test]
fn a_connection_that_broke_is_one_reason_and_one_that_is_refused_another() {
    use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
    let why = |kind: io::ErrorKind| {
        CallError::from(Status::from_error(Box::new(io::Error::from(kind)))).to_string()
    };
    for kind in [BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof] {
        assert_eq!(why(kind), CallError::BROKE);
    }
    assert_eq!(why(io::ErrorKind::ConnectionRefused), "connection refused");
}

#[tokio::test]
async fn what_no_connection_took_does_not_count_as_sent() {
    let (mut camera, frames) = stream(8);
    let remote = Remote::new("http://127.0.0.1:1");
    let (running, mut output) =
        spawn(Vehicle { remote, deadline: LONG }, unbounded(), frames).unwrap();
    assert_eq!(exchange(&mut camera, &mut output).await.0, b"local");
    drop((camera, output));
    let tally = running.join().await.unwrap();
    assert_eq!((tally.sources[1].failed, tally.sources[1].sent_bytes), (1, 0));
    let why: Vec<_> = tally.sources[1].reasons.iter().collect();
    assert_eq!(why, [("connection refused", 1)]);
}

/// An echo service that describes itself.
struct DescribedService;

impl Infer for DescribedService {
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send {
        echo(request)
    }

    fn describe(&self) -> Option<Description> {
        Some(Description { model: "echo".into(), ..Description::default() })
    }
}

#[tokio::test]
async fn a_server_says_what_it_serves_if_it_does() {
    let describe = async |remote: &Remote| {
        let mut client = InferClient::new(remote.connect().unwrap());
        client.describe(tonic::Request::new(())).await.map(tonic::Response::into_inner)
    };
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), DescribedService);
    assert_eq!(describe(&cloud.http()).await.unwrap().model, "echo");
    assert_eq!(call(&cloud.http()).await.unwrap(), b"frame");
    let silent = Cloud::start("127.0.0.1:0", Server::default(), echo);
    assert_eq!(describe(&silent.http()).await.unwrap_err().code(), Code::Unimplemented);
    [cloud, silent].into_iter().for_each(Cloud::kill);
}

#[tokio::test]
async fn a_server_that_never_answers_costs_no_more_than_the_deadline() {
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), silent);
    let (mut camera, frames) = stream(8);
    let vehicle = Vehicle { remote: cloud.http(), deadline: Duration::from_millis(50) };
    let (running, mut output) = spawn(vehicle, unbounded(), frames).unwrap();
    assert_eq!(exchange(&mut camera, &mut output).await.0, b"local");
    let cloud_tally = &running.tally().sources[1];
    assert_eq!((cloud_tally.timers + cloud_tally.failed, cloud_tally.forwarded()), (1, 0));
    cloud.kill();
}

#[tokio::test]
async fn a_killed_server_fails_its_calls_at_once_and_is_used_again_when_it_is_back() {
    let (arrived, arrivals) = mpsc::channel();
    let hold = move |_| {
        arrived.send(()).unwrap();
        pending::<Result<Reply, Status>>()
    };
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), hold);
    let address = cloud.address.to_string();
    let (mut camera, frames) = stream(8);
    let vehicle = Vehicle { remote: cloud.http(), deadline: LONG };
    let (_, mut output) = spawn(vehicle, unbounded(), frames).unwrap();

    camera.write(b"frame".into()).unwrap();
    tokio::task::spawn_blocking(move || {
        arrivals.recv().unwrap();
        cloud.kill();
    })
    .await
    .unwrap();
    let item = output.read().await.unwrap();
    assert_eq!(item.forwarded().unwrap().value, b"local");
    // Nobody listens, so the call fails at once, perhaps while local still computes.
    assert_eq!(exchange(&mut camera, &mut output).await.0, b"local");

    let cloud = Cloud::start(&address, Server::default(), echo);
    assert_eq!(
        exchange(&mut camera, &mut output).await,
        (b"cloud frame".to_vec(), Trigger::Arrival)
    );
    cloud.kill();
}

/// Forwards a connection to the cloud and back until it is signalled. Then the connection stays
/// open, but nothing passes any more. The next connection is forwarded again.
async fn passed_on(entry: TcpListener, cloud: SocketAddr, reported: oneshot::Receiver<()>) {
    let connection =
        async || (entry.accept().await.unwrap().0, TcpStream::connect(cloud).await.unwrap());
    let mut silent = connection().await;
    tokio::select! {
        ended = copy_bidirectional(&mut silent.0, &mut silent.1) => panic!("{ended:?}"),
        _ = reported => {}
    }
    let (mut client, mut server) = connection().await;
    copy_bidirectional(&mut client, &mut server).await.unwrap();
}

/// A connection that falls silent counts as lost once a ping has had no answer (D13).
#[tokio::test]
async fn a_connection_that_falls_silent_is_lost_once_a_ping_has_no_answer() {
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), echo);
    let entry = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let remote = Remote {
        ping_after: Duration::from_millis(200),
        ping_deadline: Duration::from_secs(2),
        ..Remote::new(format!("http://{}", entry.local_addr().unwrap()))
    };
    let (fall_silent, reported) = oneshot::channel();
    let between = tokio::spawn(passed_on(entry, cloud.address, reported));
    let mut client = InferClient::new(remote.connect().unwrap());
    assert_eq!(one(&mut client, b"first").await.unwrap(), b"first");
    fall_silent.send(()).unwrap();
    let lost = timeout(Duration::from_secs(10), one(&mut client, b"second")).await;
    assert_eq!(
        lost.expect("the call waits for its own deadline").unwrap_err().code(),
        Code::Unavailable
    );
    assert_eq!(one(&mut client, b"third").await.unwrap(), b"third");
    between.abort();
    cloud.kill();
}

/// Messages of many megabytes pass in both directions (D2).
#[tokio::test]
async fn messages_of_many_megabytes_pass_both_ways() {
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), echo);
    let image: Vec<u8> = (0..=250).cycle().take(24 * 1024 * 1024).collect();
    let mut client = InferClient::new(cloud.http().connect().unwrap());
    assert!(one(&mut client, &image).await.unwrap() == image, "other bytes came back");
    cloud.kill();
}

/// The deadline travels with the call (D5).
#[tokio::test]
async fn the_deadline_travels_with_the_call() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let remote = Remote::new(format!("http://{}", listener.local_addr().unwrap()));
    let (sender, reported) = mpsc::channel();
    let note = move |request: tonic::Request<()>| {
        let timeout = request.metadata().get("grpc-timeout").unwrap().to_str().unwrap().to_owned();
        sender.send(timeout).unwrap();
        Ok(request)
    };
    let service =
        tonic::service::interceptor::InterceptedService::new(InferServer::new(echo), note);
    let incoming = transport::server::TcpIncoming::from(listener);
    tokio::spawn(transport::Server::builder().add_service(service).serve_with_incoming(incoming));

    let (mut camera, frames) = stream(8);
    let (_, mut output) = spawn(Vehicle { remote, deadline: LONG }, unbounded(), frames).unwrap();
    assert_eq!(exchange(&mut camera, &mut output).await.0, b"cloud frame");
    let timeout = reported.recv().unwrap();
    let (digits, unit) = timeout.split_at(timeout.len() - 1);
    let digits: u64 = digits.parse().unwrap();
    let seconds = match unit {
        "m" => digits / 1000,
        "S" => digits,
        "M" => digits * 60,
        _ => panic!("{timeout}"),
    };
    assert!((3000..=3600).contains(&seconds), "{timeout}");
}

/// With mutual TLS a stranger is refused and a known client is served (D12).
#[tokio::test]
async fn with_mutual_tls_a_stranger_is_refused_and_a_known_client_served() {
    let (ca, other) = (Ca::new(), Ca::new());
    let server = Server {
        identity: Some(ca.sign("localhost")),
        client_ca: Some(ca.certificate.clone()),
        ..Server::default()
    };
    let cloud = Cloud::start("127.0.0.1:0", server, echo);
    let known = Remote { identity: Some(ca.sign("vehicle")), ..cloud.https(&ca) };
    assert_eq!(call(&known).await.unwrap(), b"frame");

    let unknown_client = cloud.https(&ca);
    call(&unknown_client).await.expect_err("no certificate");
    let forger = Remote { identity: Some(other.sign("vehicle")), ..cloud.https(&ca) };
    call(&forger).await.expect_err("another CA's certificate");
    let plain = cloud.http();
    call(&plain).await.expect_err("no TLS");
    assert_eq!(call(&known).await.unwrap(), b"frame");
    cloud.kill();
}

/// A client sends nothing to a server that cannot prove its name (D12).
#[tokio::test]
async fn a_server_that_is_not_the_one_is_not_spoken_to() {
    let (ca, other) = (Ca::new(), Ca::new());
    let server = Server { identity: Some(ca.sign("localhost")), ..Server::default() };
    let cloud = Cloud::start("127.0.0.1:0", server, echo);
    assert_eq!(call(&cloud.https(&ca)).await.unwrap(), b"frame");
    call(&cloud.https(&other)).await.expect_err("signed by another CA");
    let elsewhere = Remote { server_name: Some("elsewhere".into()), ..cloud.https(&ca) };
    call(&elsewhere).await.expect_err("a certificate for another name");
    cloud.kill();
}

/// Only the right token is accepted, and it can be replaced (D12).
#[tokio::test]
async fn only_the_right_token_is_let_in_and_it_can_be_replaced() {
    let ours = Token::new("right").unwrap();
    let server = Server { token: Some(ours.clone()), ..Server::default() };
    let cloud = Cloud::start("127.0.0.1:0", server, echo);
    let shown = Token::new("wrong").unwrap();
    let remote = Remote { token: Some(shown.clone()), ..cloud.http() };
    assert_eq!(call(&remote).await.unwrap_err().code(), Code::Unauthenticated);
    assert_eq!(call(&cloud.http()).await.unwrap_err().code(), Code::Unauthenticated);
    shown.replace("right").unwrap();
    assert_eq!(call(&remote).await.unwrap(), b"frame");
    let mut client = InferClient::new(remote.connect().unwrap());
    assert_eq!(one(&mut client, b"frame").await.unwrap(), b"frame");
    shown.replace("righ").unwrap();
    assert_eq!(one(&mut client, b"frame").await.unwrap_err().code(), Code::Unauthenticated);
    ours.replace("next").unwrap();
    shown.replace("next").unwrap();
    assert_eq!(call(&remote).await.unwrap(), b"frame");
    assert_eq!(shown.replace("two words"), Err(InvalidToken));
    assert_eq!(Token::new("").unwrap_err(), InvalidToken);
    assert_eq!(call(&remote).await.unwrap(), b"frame");
    cloud.kill();
}

#[tokio::test]
async fn garbage_is_no_request_and_an_unknown_method_is_said_to_be() {
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), echo);
    let mut grpc = tonic::client::Grpc::new(cloud.http().connect().unwrap());
    let mut exchange = async |path: &'static str| {
        grpc.ready().await.unwrap();
        let path = http::uri::PathAndQuery::from_static(path);
        // The timestamp is a string, which cannot be decoded.
        let garbage = GarbageService { timestamp: "garbage".into() };
        let codec = tonic_prost::ProstCodec::<GarbageService, Reply>::default();
        grpc.unary(tonic::Request::new(garbage), path, codec).await.unwrap_err().code()
    };
    assert_eq!(exchange("/fuseline.v1.Infer/Infer").await, Code::Internal);
    assert_eq!(exchange("/fuseline.v1.Infer/Other").await, Code::Unimplemented);
    assert_eq!(exchange("/other.Service/Infer").await, Code::Unimplemented);
    cloud.kill();
}

#[derive(Clone, PartialEq, Eq, prost::Message)]
struct GarbageService {
    #[prost(string, tag = "1")]
    timestamp: String,
}

#[tokio::test]
async fn remotes_and_servers_that_cannot_be_are_refused() {
    let refused = |remote: Remote| remote.connect().unwrap_err();
    assert!(matches!(refused(Remote::new("not a url")), RemoteError::Url(_)));
    assert!(matches!(refused(Remote::new("localhost:50051")), RemoteError::Scheme));
    assert!(matches!(refused(Remote::new("ftp://localhost")), RemoteError::Scheme));
    #[cfg(not(feature = "native-roots"))]
    assert!(matches!(refused(Remote::new("https://localhost")), RemoteError::Ca));
    let ca = Some(Ca::new().certificate);
    let plain = Remote { ca: ca.clone(), ..Remote::new("http://localhost") };
    assert!(matches!(refused(plain), RemoteError::Plain));
    let identity = Some(Identity { certificate: b"garbage".into(), key: b"garbage".into() });
    let garbage = Remote { ca, identity: identity.clone(), ..Remote::new("https://localhost") };
    assert!(matches!(refused(garbage), RemoteError::Tls(_)));

    for (server, is_identity) in [
        (Server { client_ca: Some(Ca::new().certificate), ..Server::default() }, true),
        (Server { identity, ..Server::default() }, false),
    ] {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        match serve(echo, server, listener, pending()).await.unwrap_err() {
            ServeError::Identity => assert!(is_identity),
            ServeError::NoTls => panic!("the tests have TLS"),
            ServeError::Tls(_) => assert!(!is_identity),
        }
    }
}

#[test]
fn without_a_runtime_there_is_no_connection() {
    let refused = Remote::new("http://localhost").connect();
    assert!(matches!(refused, Err(RemoteError::NoRuntime)));
}

#[test]
fn secrets_do_not_show() {
    let identity = Some(Identity { certificate: b"shown".into(), key: b"secret".into() });
    let token = Some(Token::new("secret").unwrap());
    let remote = Remote { identity, token, ..Remote::new("https://localhost") };
    assert!(!format!("{remote:?}").contains("secret"));
    let secret = format!("{:?}", b"secret");
    assert!(!format!("{remote:?}").contains(&secret[1..secret.len() - 1]));
}

/// An older peer sends only a timestamp and a payload, or a payload. Both sides read the fields
/// that they know.
#[test]
fn an_old_peer_is_read_and_reads_what_it_knows() {
    let request = Request::decode(&[8, 7, 18, 1, b'x'][..]).unwrap();
    assert_eq!(request, Request { timestamp: 7, payload: b"x".as_slice().into(), lineage: None });
    assert_eq!(request.encode_to_vec(), [8, 7, 18, 1, b'x']);
    let reply = Reply::decode(&[10, 1, b'y'][..]).unwrap();
    assert_eq!(reply, Reply { payload: b"y".as_slice().into(), ..Reply::default() });
    assert_eq!(reply.encode_to_vec(), [10, 1, b'y']);
}

/// The server's handler reads the lineage, and its reply states the message that it is of (D2).
#[tokio::test]
async fn lineage_goes_with_the_request_and_of_comes_with_the_reply() {
    let seen = SharedState::new(Vec::new());
    let log = seen.clone();
    // The server answers the second request with a reply of the first message.
    let server = move |request: Request| {
        log.with(|seen: &mut Vec<Request>| seen.push(request));
        let (payload, meant_for) = (b"boxes".as_slice().into(), Some(0));
        ready(Ok(Reply { payload, of: Some(0), meant_for }))
    };
    let server = Cloud::start("127.0.0.1:0", Server::default(), server);
    let (mut camera, frames) = stream(4);
    let vehicle = StampedVehicle(server.http());
    let (running, mut output) = spawn(vehicle, unbounded(), frames).unwrap();
    let captured = Instant::now();
    let lineage = Lineage::new("camera/front", 41, captured).within(LONG);
    let mut received = Vec::new();
    for lineage in [Some(Arc::new(lineage)), None] {
        camera.write_with(Vec::new(), lineage).unwrap();
        let item = output.read().await.unwrap();
        let forwarded = Item::forwarded(&item).unwrap().clone();
        received.push((forwarded.value, forwarded.of, forwarded.meant_for));
    }
    let expected = [(b"boxes".to_vec(), Some(0), Some(0)), (b"local".to_vec(), None, None)];
    assert_eq!(received, expected);
    let requests = seen.with(|seen| seen.clone());
    let sent = requests[0].lineage.clone().unwrap();
    assert_eq!((sent.origin.as_deref(), sent.seq), (Some("camera/front"), Some(41)));
    assert_eq!(sent.within_ns, Some(u64::try_from(LONG.as_nanos()).unwrap()));
    let now = Instant::now();
    let read = sent.lineage(now);
    assert_eq!(read.origin.as_ref().unwrap().seq, Some(41));
    assert_eq!((read.age(now), read.within), (sent.age_ns.map(Duration::from_nanos), Some(LONG)));
    assert!(read.captured.unwrap() >= captured, "the way is not counted");
    assert!(sent.age_ns.unwrap() > 0, "it was sent after it was captured");
    assert_eq!(requests[1].lineage, None);
    drop(camera);
    drop(output);
    running.join().await.unwrap();
    server.kill();
}

/// A request that has a lineage of its own keeps it, instead of the message's (E7).
#[tokio::test]
async fn a_requests_own_lineage_is_sent_as_it_is() {
    let own = RequestLineage { seq: Some(9), age_ns: Some(5), ..RequestLineage::default() };
    let sent = own.clone();
    let server = move |request: Request| {
        let of = (request.lineage.as_ref() == Some(&sent)).then_some(request.timestamp);
        ready(Ok(Reply { payload: request.payload, of, meant_for: None }))
    };
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), server);
    let counting = Engine::<(), ()>::new(EngineConfig::default()).unwrap().counts();
    let operators = Arc::new(Lineage::new("camera", 41, Instant::now()));
    let call = Call::new(7, LONG, 1, counting).with_lineage(Some(operators));
    let request = Request { timestamp: 7, lineage: Some(own), ..Request::default() };
    let reply = grpc::infer(cloud.http().connect().unwrap())(request, call).await;
    assert_eq!(reply.unwrap().of, Some(7));
    cloud.kill();
}

#[test]
fn the_messages_are_those_of_the_proto_file() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/proto");
    let files = protox::compile(["fuseline.proto"], [folder]).unwrap();
    let pool = DescriptorPool::from_file_descriptor_set(files).unwrap();
    let decode = |name: &str, bytes: &[u8]| {
        DynamicMessage::decode(pool.get_message_by_name(name).unwrap(), bytes).unwrap()
    };
    let payload = prost::bytes::Bytes::from_static(b"frame");
    let lineage = RequestLineage {
        origin: Some("camera/front".into()),
        seq: Some(0),
        age_ns: Some(u64::MAX),
        within_ns: Some(7),
    };
    let request = Request { timestamp: u64::MAX, payload: payload.clone(), lineage: Some(lineage) };
    let request = decode("fuseline.v1.Request", &request.encode_to_vec());
    assert_eq!(*request.get_field_by_name("timestamp").unwrap(), Value::U64(u64::MAX));
    assert_eq!(*request.get_field_by_name("payload").unwrap(), Value::Bytes(payload.clone()));
    assert_eq!(request.unknown_fields().count(), 0);
    let lineage = request.get_field_by_name("lineage").unwrap().into_owned();
    let lineage = lineage.as_message().unwrap();
    let fields = ["origin", "seq", "age_ns", "within_ns"]
        .map(|name| lineage.get_field_by_name(name).unwrap().into_owned());
    let numbers = [0, u64::MAX, 7].map(Value::U64);
    assert_eq!(fields[0], Value::String("camera/front".into()));
    assert_eq!(fields[1..], numbers);
    assert!(lineage.has_field_by_name("seq") && lineage.unknown_fields().count() == 0);
    let reply = Reply { payload: payload.clone(), of: Some(0), meant_for: Some(0) };
    let reply = decode("fuseline.v1.Reply", &reply.encode_to_vec());
    assert_eq!(*reply.get_field_by_name("payload").unwrap(), Value::Bytes(payload));
    let has_all = ["of", "meant_for"].iter().all(|name| reply.has_field_by_name(name));
    assert!(has_all && reply.unknown_fields().count() == 0);
    let logged = Description {
        model: "M".into(),
        runtime_ms: Some(1.5),
        ap: Some(0.0),
        drive: "D".into(),
        emulated: true,
    };
    let logged = decode("fuseline.v1.Description", &logged.encode_to_vec());
    let fields: Vec<Value> = ["model", "runtime_ms", "ap", "drive", "emulated"]
        .map(|name| logged.get_field_by_name(name).unwrap().into_owned())
        .into();
    let text = |text: &str| Value::String(text.into());
    let numbers = [Value::F64(1.5), Value::F64(0.0)];
    assert_eq!(fields, [&[text("M")][..], &numbers, &[text("D"), Value::Bool(true)]].concat());
    assert!(logged.has_field_by_name("ap") && logged.unknown_fields().count() == 0);
    let service = pool.get_service_by_name("fuseline.v1.Infer").unwrap();
    assert_eq!(
        service.methods().map(|m| m.name().to_owned()).collect::<Vec<_>>(),
        ["Infer", "Describe"]
    );
}
