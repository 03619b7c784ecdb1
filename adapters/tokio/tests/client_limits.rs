//! Tests a server against hostile clients and floods of connections, over real sockets on loopback.
//!
//! Each hostile client is refused or closed and named in the log, and it takes no more memory than
//! it may. Another client is served all the time.
#![cfg(feature = "grpc")]

#[path = "support/hostile.rs"]
mod hostile;
#[path = "support/hosts.rs"]
mod hosts;

use std::future::ready;
use std::io::Write as _;
use std::iter;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use fuseline_testkit::Rng;
use fuseline_tokio::grpc::tonic::{self, Code, Status};
use fuseline_tokio::grpc::{Bounds, InferClient, Remote, Reply, Request, Server, Token};
use futures_util::future::join_all;
use hostile::{CONTINUATION, DATA, END_HEADERS, HEADERS, PING, RST_STREAM, Raw, SETTINGS};
use hosts::{Ca, Cloud};
use tokio::net::{TcpSocket, TcpStream};
use tokio::sync::oneshot;
use tracing_subscriber::fmt::MakeWriter;

const MIB: usize = 1024 * 1024;

/// Longer than any test.
const NEVER: Duration = Duration::from_secs(3600);

/// Bounds so wide that a flood reaches only the bound that its test narrows.
const WIDE: Bounds = Bounds {
    connections: 100_000,
    connections_each: 100_000,
    calls: 64,
    resets: 1_000_000_000,
    header_bytes: 16 * 1024,
    held_bytes: 64 * MIB,
    greeting: NEVER,
    stall: NEVER,
    idle: NEVER,
};

/// Lets one test run at a time, because they check the log and the memory of the whole process.
static TURN: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

/// The log that the servers write.
static LOG: LazyLock<Log> = LazyLock::new(|| {
    let log = Log::default();
    tracing_subscriber::fmt().with_writer(log.clone()).with_ansi(false).init();
    log
});

#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl Log {
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.0.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }

    /// Waits until the log contains these words.
    async fn wait_for_log(&self, words: &str) {
        self.wait_for_lines(words, 1).await;
    }

    /// Waits until the log contains these words this many times.
    async fn wait_for_lines(&self, words: &str, count: usize) {
        let soon = async {
            while self.text().matches(words).count() < count {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        let logged = tokio::time::timeout(Duration::from_secs(30), soon).await;
        assert!(logged.is_ok(), "not {count} of {words:?} in the log:\n{}", self.text());
    }
}

impl std::io::Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Log {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        self.clone()
    }
}

/// Answers with a reply of `timestamp` bytes.
fn sized(request: Request) -> impl Future<Output = Result<Reply, Status>> {
    let Request { timestamp, payload, .. } = request;
    drop(payload);
    let bytes = usize::try_from(timestamp).unwrap();
    ready(Ok(Reply { payload: vec![7; bytes].into(), ..Reply::default() }))
}

async fn call(remote: &Remote) -> Result<usize, Status> {
    let mut client = InferClient::new(remote.connect().unwrap());
    one(&mut client).await
}

async fn one(client: &mut InferClient) -> Result<usize, Status> {
    let mut request = tonic::Request::new(Request { timestamp: 9, ..Request::default() });
    request.set_timeout(Duration::from_secs(30));
    Ok(client.infer(request).await?.into_inner().payload.len())
}

/// Returns the resident memory of this process in bytes.
fn resident() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    pages.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
}

/// Counts how often this process did not run for more than a second, which is less than any bound
/// here.
struct Standstills(Arc<AtomicU64>);

impl Standstills {
    /// Starts a thread that watches until the value is dropped.
    fn watch() -> Self {
        let count = Arc::new(AtomicU64::new(0));
        let watched = Arc::downgrade(&count);
        std::thread::spawn(move || {
            let mut last = Instant::now();
            while let Some(count) = watched.upgrade() {
                std::thread::sleep(Duration::from_millis(10));
                if last.elapsed() > Duration::from_secs(1) {
                    count.fetch_add(1, Relaxed);
                }
                last = Instant::now();
            }
        });
        Self(count)
    }

    fn count(&self) -> u64 {
        self.0.load(Relaxed)
    }
}

/// Runs a server under a flood, and checks that a known client is served before, during and after
/// it.
async fn under<F: Future>(bounds: Bounds, flood: impl FnOnce(Raw) -> F) -> F::Output {
    LOG.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    let cloud = Cloud::start("127.0.0.1:0", Server { bounds, ..Server::default() }, sized);
    let mut known = InferClient::new(cloud.http().connect().unwrap());
    one(&mut known).await.unwrap();
    let before = resident();
    let (stop, mut stopped) = oneshot::channel::<()>();
    let standstills = Standstills::watch();
    let good = tokio::spawn(async move {
        let (mut served, mut most) = (0, 0);
        loop {
            let before = standstills.count();
            match one(&mut known).await {
                Ok(bytes) => assert_eq!(bytes, 9),
                // If the host stood still, even a well-behaved client is late and may be refused.
                Err(status) => assert!(standstills.count() > before, "{status}"),
            }
            (served, most) = (served + 1, most.max(resident()));
            if stopped.try_recv().is_ok() {
                return (served, most);
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    });
    let address = cloud.address;
    let out = flood(Raw::new(address)).await;
    stop.send(()).unwrap();
    let (served, most) = good.await.unwrap();
    println!("{served} calls served; {} MiB more memory at most", (most - before.min(most)) / MIB);
    assert!(most < before + bounds.held_bytes * 3 + 32 * MIB, "{before} {most}");
    // The places of clients that hung up become free once the server notices.
    let served = async { while call(&cloud.http()).await.is_err() {} };
    let soon = tokio::time::timeout(Duration::from_secs(60), served).await;
    soon.expect("a new client is served too");
    cloud.kill();
    out
}

/// The log's line about a hostile client, and the connection that causes it.
type HostileClient<'a> = (&'a str, &'a dyn Fn(&Cloud) -> Remote);

/// Each hostile client is refused and named in the log, and a known client is served before and
/// after (D12).
#[tokio::test]
async fn hostile_clients_are_refused_and_named() {
    let _turn = TURN.lock().await;
    let (ca, other) = (Ca::new(), Ca::new());
    let token = || Some(Token::new("right").unwrap());
    let server = || Server {
        identity: Some(ca.sign("localhost")),
        client_ca: Some(ca.certificate.clone()),
        token: token(),
        ..Server::default()
    };
    let known = |cloud: &Cloud| Remote {
        identity: Some(ca.sign("vehicle")),
        token: token(),
        ..cloud.https(&ca)
    };
    let clients: [HostileClient<'_>; 6] = [
        ("its TLS handshake failed: peer sent no certificates", &|c| Remote {
            identity: None,
            ..known(c)
        }),
        ("its TLS handshake failed: invalid peer certificate", &|c| Remote {
            identity: Some(other.sign("vehicle")),
            ..known(c)
        }),
        ("its TLS handshake failed: invalid peer certificate: certificate expired", &|c| Remote {
            identity: Some(ca.sign_until("vehicle", 2020)),
            ..known(c)
        }),
        ("its TLS handshake failed: received corrupt message", &|c| Remote {
            token: token(),
            ..c.http()
        }),
        ("its call failed: a bearer token is needed", &|c| Remote { token: None, ..known(c) }),
        ("its call failed: the bearer token is wrong", &|c| Remote {
            token: Some(Token::new("wrong").unwrap()),
            ..known(c)
        }),
    ];
    for (words, client) in clients {
        LazyLock::force(&LOG).0.lock().unwrap().clear();
        let cloud = Cloud::start("127.0.0.1:0", server(), sized);
        assert_eq!(call(&known(&cloud)).await.unwrap(), 9);
        assert_eq!(LOG.text(), "", "nobody was refused");
        call(&client(&cloud)).await.expect_err(words);
        LOG.wait_for_log(words).await;
        assert!(LOG.text().contains("peer=127.0.0.1:"), "{}", LOG.text());
        assert_eq!(call(&known(&cloud)).await.unwrap(), 9);
        cloud.kill();
    }
}

/// Removing a CA revokes its certificates. While both CAs are trusted, clients of both are served
/// (D12).
#[tokio::test]
async fn a_client_is_refused_once_its_ca_is_taken_away() {
    let _turn = TURN.lock().await;
    let (old, new) = (Ca::new(), Ca::new());
    let serve = |address: &str, client_ca: Vec<u8>| {
        let (identity, client_ca) = (Some(new.sign("localhost")), Some(client_ca));
        Cloud::start(address, Server { identity, client_ca, ..Server::default() }, sized)
    };
    let cloud = serve("127.0.0.1:0", [&old.certificate[..], &new.certificate[..]].concat());
    let was = Remote { identity: Some(old.sign("vehicle")), ..cloud.https(&new) };
    let is = Remote { identity: Some(new.sign("vehicle")), ..cloud.https(&new) };
    let mut known_client = InferClient::new(was.connect().unwrap());
    assert_eq!((one(&mut known_client).await.unwrap(), call(&is).await.unwrap()), (9, 9));
    let address = cloud.address.to_string();
    cloud.kill();

    let cloud = serve(&address, new.certificate.clone());
    one(&mut known_client).await.expect_err("its CA is gone");
    call(&was).await.expect_err("its CA is gone");
    assert_eq!(call(&is).await.unwrap(), 9);
    cloud.kill();
}

/// Cancels each call as soon as it is made, until the server closes the connection.
async fn rapid_reset(mut raw: Raw) -> usize {
    raw.greet().await;
    for n in 0..200_000_u32 {
        let stream = 2 * n + 1;
        let is_open = raw.frame(HEADERS, END_HEADERS, stream, &hostile::call()).await
            && raw.frame(RST_STREAM, 0, stream, &8_u32.to_be_bytes()).await;
        if !is_open {
            return n as usize;
        }
    }
    panic!("200,000 calls were taken back")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_takes_back_calls_faster_than_it_may_is_closed() {
    let _turn = TURN.lock().await;
    under(Bounds { resets: 100, ..WIDE }, rapid_reset).await;
    LOG.wait_for_log("a client was rejected").await;
    // The calls are made one by one, so that each has begun before it is cancelled.
    under(Bounds { resets: 2, ..WIDE }, async |mut raw: Raw| {
        raw.greet().await;
        let mut calls = 0_u32;
        while raw.frame(HEADERS, END_HEADERS, 2 * calls + 1, &hostile::call()).await {
            raw.taken_in().await;
            raw.frame(RST_STREAM, 0, 2 * calls + 1, &8_u32.to_be_bytes()).await;
            calls += 1;
            assert!(calls < 20_000, "20,000 calls were taken back one by one");
        }
    })
    .await;
    LOG.wait_for_log("it cancels calls faster than it is allowed to").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn headers_are_bounded() {
    let _turn = TURN.lock().await;
    under(WIDE, async |raw: Raw| {
        let (mut send, connection) = h2::client::handshake(raw.connect().await).await.unwrap();
        let connection = tokio::spawn(connection);
        let request = |bytes: usize| {
            http::Request::post("http://x/fuseline.v1.Infer/Infer")
                .header("x-long", "x".repeat(bytes))
                .body(())
                .unwrap()
        };
        let (answer, _) = send.send_request(request(64 * 1024), true).unwrap();
        let refused = answer.await;
        let is_refused = refused.as_ref().map_or(true, |answer| answer.status() == 431);
        assert!(is_refused, "{refused:?}");
        connection.abort();
    })
    .await;
    // Sends a block of headers that never ends.
    under(WIDE, async |mut raw: Raw| {
        raw.greet().await;
        assert!(raw.frame(HEADERS, 0, 1, &hostile::call()).await);
        let part = hostile::header("x-long", &"x".repeat(16_000));
        for _ in 0..20_000 {
            if !raw.frame(CONTINUATION, 0, 1, &part).await {
                return;
            }
        }
        panic!("320 MB of headers were taken");
    })
    .await;
    LOG.wait_for_log("its HTTP/2 connection failed: ").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn streams_are_bounded() {
    let _turn = TURN.lock().await;
    under(Bounds { calls: 8, ..WIDE }, async |mut raw: Raw| {
        raw.greet().await;
        for n in 0..100_000_u32 {
            if !raw.frame(HEADERS, END_HEADERS, 2 * n + 1, &hostile::call()).await {
                return;
            }
        }
        panic!("100,000 streams were opened");
    })
    .await;
    LOG.wait_for_log("its HTTP/2 connection failed: ").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn floods_of_pings_and_settings_take_no_memory() {
    let _turn = TURN.lock().await;
    for (kind, payload) in [(PING, vec![0; 8]), (SETTINGS, [0, 4, 0, 1, 0, 0].repeat(500))] {
        under(WIDE, async |mut raw: Raw| {
            raw.greet().await;
            for _ in 0..20_000 {
                if !raw.frame(kind, 0, 0, &payload).await {
                    return;
                }
            }
        })
        .await;
    }
}

/// A client that does not read its replies is closed and holds no more memory than it may (D8).
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_does_not_take_its_replies_is_closed_and_holds_no_more_than_it_may() {
    let _turn = TURN.lock().await;
    let bounds = Bounds { held_bytes: 32 * MIB, stall: Duration::from_secs(2), ..WIDE };
    under(bounds, async |raw: Raw| {
        let (mut send, connection) = h2::client::handshake(raw.connect().await).await.unwrap();
        let connection = tokio::spawn(connection);
        // Requests 60 replies of 8 MiB and reads none of them.
        let mut bodies = Vec::new();
        for _ in 0..60 {
            let request = http::Request::post("http://x/fuseline.v1.Infer/Infer")
                .header("content-type", "application/grpc")
                .header("te", "trailers");
            let request = request.body(()).unwrap();
            let Ok(mut ready) = send.ready().await else { break };
            let (answer, mut body) = ready.send_request(request, false).unwrap();
            send = ready;
            body.send_data(hostile::request(8 * MIB as u64), true).unwrap();
            bodies.push(answer.await);
        }
        let ended = tokio::time::timeout(Duration::from_secs(60), connection).await;
        ended.expect("the server closes the connection").unwrap().ok();
    })
    .await;
    LOG.wait_for_log("it does not read its replies").await;
    assert!(
        LOG.text().contains("the server holds as many bytes as its limit allows"),
        "{}",
        LOG.text()
    );
}

/// Requests that never end hold no more memory than they may (D8).
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_that_never_end_hold_no_more_than_they_may() {
    let _turn = TURN.lock().await;
    let long = 30 * MIB;
    // Each request sends all but the last byte of 30 MiB, and waits.
    let flood = async |mut raw: Raw| {
        raw.greet().await;
        let block = vec![0; 16 * 1024];
        for stream in [1, 3, 5, 7] {
            // The server may close the whole connection if data was still on its way when it reset
            // the stream.
            if !raw.frame(HEADERS, END_HEADERS, stream, &hostile::call()).await {
                break;
            }
            let head = [&[0][..], &u32::try_from(long).unwrap().to_be_bytes()].concat();
            raw.frame(DATA, 0, stream, &head).await;
            for _ in 0..long / block.len() - 1 {
                raw.room(stream, block.len()).await;
                if raw.is_reset(stream) || !raw.frame(DATA, 0, stream, &block).await {
                    break;
                }
            }
        }
        LOG.wait_for_log("its call failed: ").await;
    };
    under(Bounds { held_bytes: 16 * MIB, ..WIDE }, flood).await;
    LOG.wait_for_log("the server holds as many bytes as its limit allows").await;
    let dribble = async |mut raw: Raw| {
        raw.greet().await;
        raw.frame(HEADERS, END_HEADERS, 1, &hostile::call()).await;
        raw.frame(DATA, 0, 1, &[0, 0, 0]).await;
        LOG.wait_for_log("the request did not arrive completely in time").await;
    };
    under(Bounds { stall: Duration::from_secs(2), ..WIDE }, dribble).await;
}

/// The bytes that a call held are given back when it ends (D8).
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_call_held_is_given_back_when_it_ends() {
    let _turn = TURN.lock().await;
    let bounds = Bounds { held_bytes: 4 * MIB, ..WIDE };
    let cloud = Cloud::start("127.0.0.1:0", Server { bounds, ..Server::default() }, sized);
    let mut client = InferClient::new(cloud.http().connect().unwrap());
    let mut holding = async |request: usize, reply: usize| {
        let payload = vec![0; request].into();
        let request =
            Request { timestamp: reply.try_into().unwrap(), payload, ..Request::default() };
        let reply = client.infer(tonic::Request::new(request)).await;
        reply.map(|reply| reply.into_inner().payload.len()).map_err(|status| status.code())
    };
    // Each kind of call takes far more in total than the server may hold at once.
    for _ in 0..8 {
        assert_eq!(holding(3 * MIB, 9).await, Ok(9));
        assert_eq!(holding(9, 3 * MIB).await, Ok(3 * MIB));
        assert_eq!(holding(5 * MIB, 9).await, Err(Code::ResourceExhausted));
    }
    cloud.kill();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_on_the_port_is_closed_and_named() {
    let _turn = TURN.lock().await;
    let mut noise = Rng::with_seed(1);
    let noise = iter::repeat_with(|| noise.next_u64().to_le_bytes());
    let noise: Vec<u8> = noise.flatten().take(100_000).collect();
    let tls = [&[22, 3, 1, 2, 0, 1, 0, 1, 252, 3, 3][..], &[7; 600]].concat();
    for garbage in [&noise[..], b"GET / HTTP/1.1\r\nhost: x\r\n\r\n", &tls, &[0; 4096]] {
        under(WIDE, async |mut raw: Raw| {
            raw.open().await;
            raw.bytes(garbage).await;
            raw.ended().await;
        })
        .await;
        LOG.wait_for_log("its HTTP/2 connection failed: ").await;
    }
    // Three clients send nothing, half of the preface, and a greeting without a call at the same
    // time. The log names one and counts the others.
    let bounds = Bounds { greeting: Duration::from_secs(2), ..WIDE };
    // Two more clients send nothing, and noise, instead of a TLS handshake.
    let identity = Some(Ca::new().sign("localhost"));
    let cloud =
        Cloud::start("127.0.0.1:0", Server { identity, bounds, ..Server::default() }, sized);
    let send = async |address: SocketAddr, garbage: &[u8]| {
        let mut raw = Raw::new(address);
        raw.open().await;
        raw.bytes(garbage).await;
        raw.ended().await;
    };
    under(bounds, async |known: Raw| {
        let silent = [&b""[..], b"PRI * HTTP/2", &hostile::GREETING];
        let silent = silent.map(|garbage| send(known.address, garbage));
        tokio::join!(join_all(silent), send(cloud.address, b""), send(cloud.address, &noise));
    })
    .await;
    LOG.wait_for_log("its TLS handshake failed: ").await;
    LOG.wait_for_lines("it made no call in time", 2).await;
    cloud.kill();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_makes_no_calls_any_more_is_closed() {
    let _turn = TURN.lock().await;
    let bounds = Bounds { idle: Duration::from_secs(2), ..WIDE };
    under(bounds, async |mut raw: Raw| {
        raw.greet().await;
        raw.frame(HEADERS, END_HEADERS | 1, 1, &hostile::call()).await;
        raw.ended().await;
    })
    .await;
    LOG.wait_for_log("it has made no call for too long").await;
}

/// The server ends a call at its deadline by itself, whatever the client does (D6).
#[tokio::test]
async fn a_call_ends_with_its_deadline_though_the_client_goes_on() {
    let _turn = TURN.lock().await;
    let never = |_: Request| std::future::pending::<Result<Reply, Status>>();
    let cloud = Cloud::start("127.0.0.1:0", Server::default(), never);
    let mut raw = Raw::new(cloud.address);
    raw.greet().await;
    let call = [hostile::call(), hostile::header("grpc-timeout", "50m")].concat();
    raw.frame(HEADERS, END_HEADERS, 1, &call).await;
    raw.frame(DATA, 1, 1, &hostile::request(0)).await;
    let answer = async { while !raw.is_answered(1) && raw.received().await {} };
    let answer = tokio::time::timeout(Duration::from_secs(30), answer).await;
    assert!(answer.is_ok() && raw.is_answered(1), "the call went on");
    cloud.kill();
}

/// The number of clients that connect at the same time.
const TURNS: usize = 50;

/// The greatest number of addresses that they come from.
const ADDRESSES: usize = 200;

/// Connects from one of 200 addresses.
async fn knock(address: SocketAddr, host: usize) -> std::io::Result<TcpStream> {
    let from = Ipv4Addr::new(127, 0, 1, 1 + u8::try_from(host).unwrap());
    let socket = TcpSocket::new_v4()?;
    // Without this, each connection would keep its port for a minute.
    socket.set_zero_linger()?;
    socket.bind((from, 0).into())?;
    socket.connect(address).await
}

/// The environment variable `HOSTILE` sets the number of clients, by default 4,000. The limit on
/// open files decides how many connections, with both ends, are held at once, and the bounds are
/// smaller than that. The size is printed.
///
/// The system completes a connection before the server accepts it. On a busy host, all clients
/// could come and go before the server looks, and no bound would be reached. So they hang up only
/// after the server has logged that it reached one.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn connections_are_bounded_by_address_and_in_all() {
    let _turn = TURN.lock().await;
    let in_all = std::env::var("HOSTILE").map_or(4_000, |count| count.parse().unwrap());
    let at_once = (rustix::process::getrlimit(rustix::process::Resource::Nofile).current)
        .map_or(5_000, |files| usize::try_from(files).unwrap_or(usize::MAX) / 4)
        .clamp(100, 5_000)
        .min(in_all / 2);
    // Writes to standard error directly, because the test harness captures `println!`.
    writeln!(std::io::stderr(), "{in_all} clients connect, {at_once} at once").unwrap();
    let bounds = Bounds {
        connections: at_once / 2,
        connections_each: (at_once / ADDRESSES + 1) * 2,
        ..WIDE
    };
    let flood = |addresses: usize, words: &'static str| {
        move |raw: Raw| async move {
            let mut held: Vec<TcpStream> = Vec::new();
            for first in (0..in_all / 2).step_by(TURNS) {
                let turn = (first..first + TURNS).map(|n| knock(raw.address, n % addresses));
                // The system may refuse connections that the server has not accepted yet.
                held.extend(join_all(turn).await.into_iter().flatten());
                if held.len() >= at_once {
                    LOG.wait_for_log(words).await;
                    held.clear();
                }
            }
            LOG.wait_for_log(words).await;
        }
    };
    under(bounds, flood(10, "its address has reached its limit of connections")).await;
    under(bounds, flood(ADDRESSES, "the server has reached its limit of connections")).await;
}
