//! Hostile clients, each of which exceeds one of the bounds.

use std::net::IpAddr;
use std::time::Duration;

use bytes::Bytes;
use fuseline_testkit::Rng;
use futures_util::future::join_all;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::{Instant, sleep, timeout};

use super::memory::CallPlan;
use super::visitors::{SECOND, VisitedServer};

/// The number of clients that come beyond the limit.
pub(crate) const BEYOND: usize = 3;

/// The preface of HTTP/2 and an empty SETTINGS frame.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";

/// The ways in which a client can be hostile.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum HostileKind {
    /// Makes no call, but perhaps sends the preface or pings.
    Mute,
    /// Calls without the token.
    Unknown,
    /// Opens more connections than it may.
    Crowd,
    /// Reads nothing of one reply, but perhaps reads other replies.
    Stalls,
    /// Sends a byte of its request now and then.
    Dribbles,
    /// Cancels more calls than it may.
    Resets,
    /// Makes one call and then no other.
    Idles,
    /// Does not speak HTTP/2.
    Garbage,
    /// Disappears while a call is under way.
    Vanishes,
    /// Falls silent after a call without ending its connection.
    Dead,
    /// Comes when the system has no descriptor for it.
    NoDescriptor,
}

impl HostileKind {
    const ALL: [Self; 11] = [
        Self::Mute,
        Self::Unknown,
        Self::Crowd,
        Self::Stalls,
        Self::Dribbles,
        Self::Resets,
        Self::Idles,
        Self::Garbage,
        Self::Vanishes,
        Self::Dead,
        Self::NoDescriptor,
    ];

    pub(crate) fn draw(rng: &mut Rng, has_token: bool) -> Self {
        match Self::ALL[rng.index(Self::ALL.len())] {
            Self::Unknown if !has_token => Self::Mute,
            kind => kind,
        }
    }
}

/// Plays a hostile client from beginning to end. Returns an error if the server did not enforce its
/// bounds.
pub(crate) async fn come(
    here: &VisitedServer,
    kind: HostileKind,
    from: IpAddr,
    rng: &mut Rng,
) -> Option<String> {
    // The bounds count from when the client is accepted.
    if kind != HostileKind::NoDescriptor {
        here.server.accepts().await;
    }
    match kind {
        HostileKind::Mute => mute(here, from, rng).await,
        HostileKind::Unknown => unknown(here, from).await,
        HostileKind::Crowd => crowd(here, from).await,
        HostileKind::Stalls => stalls(here, from, [rng.bool(), rng.bool()]).await,
        HostileKind::Dribbles => dribbles(here, from).await,
        HostileKind::Resets => resets(here, from).await,
        HostileKind::Idles => {
            let visitor = here.server.visit(from).await;
            let is_served = here.answers(&visitor).await;
            let closed = visitor.closed(here.bounds.idle * 2).await;
            check(closed, here.bounds.idle).or((!is_served).then(|| "its call failed".into()))
        }
        HostileKind::Garbage => {
            let mut socket = here.server.connect(from);
            let noise: Vec<u8> = (0..200).map(|_| rng.u8(0..255)).collect();
            let _ = socket.write_all(&noise).await;
            check(end(&mut socket, here.bounds.idle).await, Duration::ZERO)
        }
        HostileKind::Vanishes => vanishes(here, from, rng).await,
        HostileKind::Dead => dead(here, from).await,
        HostileKind::NoDescriptor => {
            for _ in 0..rng.u8(1..20) {
                here.server.fail_to_accept();
            }
            sleep(3 * SECOND).await;
            let visitor = here.server.visit(from).await;
            (!here.answers(&visitor).await).then(|| "nobody is let in any more".into())
        }
    }
}

/// Returns an error unless the connection was closed after `at`, to within the rounding of timers.
fn check(closed: Option<Duration>, at: Duration) -> Option<String> {
    let is_then = closed.is_some_and(|took| took.abs_diff(at) < Duration::from_millis(50));
    (!is_then).then(|| format!("closed after {closed:?}, not {at:?}"))
}

/// Returns how long the server takes to close the socket.
async fn end(socket: &mut DuplexStream, within: Duration) -> Option<Duration> {
    let (since, mut bytes) = (Instant::now(), [0; 1024]);
    let read = async { while socket.read(&mut bytes).await.is_ok_and(|read| read > 0) {} };
    timeout(within, read).await.ok().map(|()| since.elapsed())
}

async fn mute(here: &VisitedServer, from: IpAddr, rng: &mut Rng) -> Option<String> {
    let greeting = here.bounds.greeting;
    let pinging = rng.u8(0..4);
    if pinging == 3 {
        let (send, mut connection) = h2::client::handshake(here.server.connect(from)).await.ok()?;
        let mut pings = connection.ping_pong()?;
        let visitor = super::memory::Visitor { send, connection: tokio::spawn(connection) };
        let pings = async move {
            while pings.ping(h2::Ping::opaque()).await.is_ok() {
                sleep(SECOND).await;
            }
        };
        let pings = tokio::spawn(pings);
        let closed = visitor.closed(10 * greeting).await;
        pings.abort();
        return check(closed, greeting);
    }
    let mut socket = here.server.connect(from);
    let sent = [&b""[..], &PREFACE[..12], PREFACE][usize::from(pinging)];
    let _ = socket.write_all(sent).await;
    check(end(&mut socket, 10 * greeting).await, greeting)
}

/// Plays a client without the token. Refused calls do not count as the first call that the greeting
/// requires.
async fn unknown(here: &VisitedServer, from: IpAddr) -> Option<String> {
    let (greeting, since) = (here.bounds.greeting, Instant::now());
    let visitor = here.server.visit(from).await;
    for token in [None, Some("wrong"), Some("righ"), Some("rightt")].into_iter().cycle() {
        let plan = CallPlan { token, ..here.plain() };
        match visitor.call(&plan).await {
            Ok(end) if end.status == 16 => {}
            Ok(end) => return Some(format!("{token:?}: {end:?}")),
            Err(_) => break,
        }
        sleep(greeting / 5).await;
        if since.elapsed() > 10 * greeting {
            break;
        }
    }
    let closed = visitor.closed(SECOND).await.map(|_| since.elapsed());
    // The client notices that it was closed only with its next call.
    (closed.is_none_or(|took| took > greeting + greeting / 4))
        .then(|| format!("closed after {closed:?}, not {greeting:?}"))
}

async fn crowd(here: &VisitedServer, from: IpAddr) -> Option<String> {
    let each = here.bounds.connections_each;
    let mut sockets: Vec<_> = (0..each + BEYOND).map(|_| here.server.connect(from)).collect();
    let ends = sockets.iter_mut().map(|socket| end(socket, 2 * here.bounds.greeting));
    let ends = join_all(ends).await;
    let (held, beyond) = ends.split_at(each);
    let at = here.bounds.greeting;
    held.iter()
        .find_map(|end| check(*end, at))
        .or_else(|| beyond.iter().find_map(|end| check(*end, Duration::ZERO)))
}

/// Plays a client that reads nothing of one reply. It may read others, and another call may be
/// under way.
async fn stalls(
    here: &VisitedServer,
    from: IpAddr,
    [takes_others, has_long_call]: [bool; 2],
) -> Option<String> {
    let (stall, since) = (here.bounds.stall, Instant::now());
    let mut builder = h2::client::Builder::new();
    builder.initial_connection_window_size(10 * 1024 * 1024);
    let (send, connection) = builder.handshake(here.server.connect(from)).await.ok()?;
    let visitor = super::memory::Visitor { send, connection: tokio::spawn(connection) };
    let plan = CallPlan { reply: 300_000, ..here.plain() };
    let mut send = visitor.send.clone().ready().await.ok()?;
    let mut begin = |plan: &CallPlan| {
        let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
        body.send_data(plan.body(), true).ok()?;
        Some(answer)
    };
    let long = CallPlan { compute: 8 * stall, ..here.plain() };
    let _long_call = if has_long_call { Some(begin(&long)?) } else { None };
    let _reply = begin(&plan)?.await.ok()?;
    while takes_others && since.elapsed() < 4 * stall && here.answers(&visitor).await {
        sleep(stall / 5).await;
    }
    let closed = visitor.closed(4 * stall).await.map(|_| since.elapsed());
    let latest = if takes_others { stall + stall / 4 } else { stall + SECOND };
    (closed.is_none_or(|took| took > latest)).then(|| format!("closed after {closed:?}"))
}

async fn dribbles(here: &VisitedServer, from: IpAddr) -> Option<String> {
    let stall = here.bounds.stall;
    let visitor = here.server.visit(from).await;
    let plan = CallPlan { payload: 1000, upload: (900, stall / 8), ..here.plain() };
    // The client notices the end only when it reads, so it reads while another task sends.
    let mut send = visitor.send.clone().ready().await.ok()?;
    let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
    let dribble = tokio::spawn(async move {
        while body.send_data(Bytes::from_static(&[0]), false).is_ok() {
            sleep(stall / 8).await;
        }
    });
    let since = Instant::now();
    let answer = timeout(10 * stall, answer).await.ok();
    dribble.abort();
    let wrong = check(answer.as_ref().map(|_| since.elapsed()), stall);
    let Some(Ok(answer)) = answer else { return wrong.or(Some(format!("{answer:?}"))) };
    let status = answer.headers().get("grpc-status").and_then(|it| it.to_str().ok());
    wrong.or((status != Some("4")).then(|| format!("status {status:?}")))
}

/// Plays a client that cancels one call more than it may in a second.
async fn resets(here: &VisitedServer, from: IpAddr) -> Option<String> {
    let visitor = here.server.visit(from).await;
    let plan = CallPlan { compute: 1000 * SECOND, ..here.plain() };
    for number in 0..=here.bounds.resets {
        let Ok(mut send) = visitor.send.clone().ready().await else {
            return Some(format!("closed after {number}"));
        };
        let Ok((answer, mut body)) = send.send_request(plan.head(), false) else {
            return Some(format!("closed after {number}"));
        };
        let _ = body.send_data(plan.body(), true);
        sleep(Duration::from_millis(10)).await;
        body.send_reset(h2::Reason::CANCEL);
        drop(answer);
    }
    check(visitor.closed(here.bounds.idle).await, Duration::ZERO)
}

/// Plays a client that disappears during a call. It must leave nothing behind.
async fn vanishes(here: &VisitedServer, from: IpAddr, rng: &mut Rng) -> Option<String> {
    let visitor = here.server.visit(from).await;
    let plan = CallPlan { compute: 100_000 * SECOND, reply: 1_000_000, ..here.plain() };
    let mut send = visitor.send.clone().ready().await.ok()?;
    let mut bodies = Vec::new();
    for _ in 0..rng.u8(1..4) {
        let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
        let is_whole = rng.bool();
        let part = if is_whole { plan.body() } else { plan.body().slice(..6) };
        body.send_data(part, is_whole).ok()?;
        drop(tokio::spawn(answer));
        bodies.push(body);
        send = send.ready().await.ok()?;
    }
    sleep(SECOND).await;
    visitor.connection.abort();
    None
}

/// Plays a client that stops answering. The server pings it and closes it long before it counts as
/// idle.
async fn dead(here: &VisitedServer, from: IpAddr) -> Option<String> {
    let (send, mut connection) = h2::client::handshake(here.server.connect(from)).await.ok()?;
    let mut send = send.ready().await.ok()?;
    let plan = here.plain();
    let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
    body.send_data(plan.body(), true).ok()?;
    let call = async {
        let mut reply = answer.await.ok()?.into_body();
        while let Some(Ok(data)) = reply.data().await {
            let _ = reply.flow_control().release_capacity(data.len());
        }
        reply.trailers().await.ok()
    };
    let trailers = tokio::select! {
        trailers = call => trailers,
        ended = &mut connection => return Some(format!("{ended:?}")),
    };
    // During this time nothing is read or written.
    sleep(45 * SECOND).await;
    let is_closed = timeout(SECOND, connection).await.is_ok();
    let wrong = (!is_closed).then(|| "a dead client has its place".to_owned());
    wrong.or(trailers.is_none().then(|| "its call failed".to_owned()))
}
