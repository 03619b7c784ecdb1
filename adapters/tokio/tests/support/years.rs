//! Checks a server over years of virtual time. Everything that reaches a bound ends at its own
//! instant, however far away that is, and nothing else ends.
//!
//! The clock jumps to a second before each instant, because playing pings for years would take
//! minutes.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use fuseline_tokio::grpc::{Bounds, Server};
use tokio::io::AsyncReadExt;
use tokio::task::{JoinHandle, LocalSet, spawn_local};
use tokio::time::{Instant, advance, sleep};

use super::memory::{CallPlan, CapturedLog, MemoryServer, Visitor, status};
use super::visitors::SECOND;

const DAY: Duration = Duration::from_secs(24 * 3600);

/// A client whose call or connection ends in the far future.
struct DistantClient {
    name: &'static str,
    /// The time after the start at which it is due to end.
    due: Duration,
    /// The status of its call, or `None` if its connection is closed.
    expected: Option<u16>,
    task: JoinHandle<Option<u16>>,
}

const fn address(number: u8) -> IpAddr {
    IpAddr::V4(Ipv4Addr::new(10, 0, number, 1))
}

/// Returns the errors of a server that runs for a thousand days.
pub(crate) async fn years_wrongs() -> Vec<String> {
    LocalSet::new().run_until(wrongs()).await
}

async fn wrongs() -> Vec<String> {
    let log = CapturedLog::default();
    let _guard = log.begin();
    // The runtime's timer wheel covers about 795 days.
    let bounds =
        Bounds { greeting: 40 * DAY, stall: 366 * DAY, idle: 900 * DAY, ..Bounds::default() };
    let server = MemoryServer::start(Server { bounds, ..Server::default() });
    let start = Instant::now();
    let client = server.visit(address(0)).await;
    let is_served = async || {
        let since = Instant::now();
        let answer = client.call(&CallPlan { reply: 9, ..CallPlan::default() }).await;
        answer.is_ok_and(|end| end.status == 0) && since.elapsed() < SECOND / 10
    };
    assert!(is_served().await);
    let mut clients = clients(&server, bounds).await;
    // This lets all of them begin before the clock jumps.
    sleep(SECOND).await;
    let mut wrong = Vec::new();
    for due in clients.iter().map(|client| client.due).collect::<BTreeSet<_>>() {
        advance((start + due - SECOND).duration_since(Instant::now())).await;
        sleep(SECOND / 10).await;
        let early = clients.iter().filter(|client| client.task.is_finished());
        wrong.extend(early.map(|client| format!("{} ended before {due:?}", client.name)));
        sleep(SECOND).await;
        let (ended, others) = clients.into_iter().partition(|client| client.due == due);
        clients = others;
        for DistantClient { name, task, expected, .. } in ended {
            let end = if task.is_finished() { Ok(task.await.unwrap()) } else { Err("no end") };
            if end != Ok(expected) {
                wrong.push(format!("{name} at {due:?}: {end:?}, not {expected:?}"));
            }
        }
        if !is_served().await {
            wrong.push(format!("the well-behaved client at {due:?}"));
        }
    }
    if log.text().lines().count() != 4 || log.text().contains(&address(0).to_string()) {
        wrong.push(log.text());
    }
    if server.computing() > 0 || server.stop(SECOND).await.is_none() {
        wrong.push("something is left".to_owned());
    }
    wrong
}

/// Starts one client for each bound, and calls with deadlines of years and without one.
async fn clients(server: &MemoryServer, bounds: Bounds) -> Vec<DistantClient> {
    let mut socket = server.connect(address(1));
    let mute = async move {
        while socket.read(&mut [0; 64]).await.is_ok_and(|read| read > 0) {}
        None
    };
    let plan = |days, timeout: Option<&str>| CallPlan {
        compute: days * DAY,
        timeout: timeout.map(str::to_owned),
        ..CallPlan::default()
    };
    let [incomplete, stalled, idle, late, long, longest] = [2, 3, 4, 5, 6, 7].map(address);
    let client = |name, due, expected, task| DistantClient { name, due, expected, task };
    let (closed, answered, expired) = (None, Some(0), Some(4));
    let call = |visitor: Visitor, plan: CallPlan| {
        spawn_local(async move { Some(visitor.call(&plan).await.ok()?.status) })
    };
    vec![
        client("who makes no call", bounds.greeting, closed, spawn_local(mute)),
        client(
            "an incomplete request",
            bounds.stall,
            expired,
            spawn_local(begin(server.visit(incomplete).await)),
        ),
        client(
            "a stalled reply",
            bounds.stall,
            closed,
            spawn_local(stall(server.visit(stalled).await)),
        ),
        client("who makes one call", bounds.idle, closed, {
            let visitor = server.visit(idle).await;
            spawn_local(async move {
                let answer = visitor.call(&CallPlan::default()).await;
                let _ = visitor.closed(2000 * DAY).await;
                answer.err().map(|_| u16::MAX)
            })
        }),
        client(
            "a call with a deadline",
            21_000 * DAY / 24,
            expired,
            call(server.visit(late).await, plan(2000, Some("21000H"))),
        ),
        client(
            "a call without one",
            800 * DAY,
            answered,
            call(server.visit(long).await, plan(800, None)),
        ),
        client(
            "a call with the longest",
            1000 * DAY,
            answered,
            call(server.visit(longest).await, plan(1000, Some("99999999H"))),
        ),
    ]
}

/// Sends only the first bytes of a request.
async fn begin(visitor: Visitor) -> Option<u16> {
    let mut send = visitor.send.clone().ready().await.ok()?;
    let plan = CallPlan { payload: 1000, ..CallPlan::default() };
    let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
    body.send_data(plan.body().slice(..6), false).ok()?;
    status(answer.await.ok()?.headers())
}

/// Reads nothing of a reply until the connection is closed.
async fn stall(visitor: Visitor) -> Option<u16> {
    let mut send = visitor.send.clone().ready().await.ok()?;
    let plan = CallPlan { reply: 300_000, ..CallPlan::default() };
    let (answer, mut body) = send.send_request(plan.head(), false).ok()?;
    body.send_data(plan.body(), true).ok()?;
    let _reply = answer.await.ok()?;
    let _ = visitor.connection.await;
    None
}
