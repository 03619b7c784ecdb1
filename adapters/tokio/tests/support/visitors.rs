//! Checks a server with well-behaved and hostile clients, which are drawn by seed, in virtual time.
//!
//! For hours each well-behaved client is served at once. It is never closed or named in the log,
//! whatever the hostile clients do. Each hostile client is closed at its bound. When the hostile
//! clients are gone, all places, bytes, tasks and counts are as before.

use std::cell::Cell;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::rc::Rc;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::grpc::{Bounds, Server, Token};
use futures_util::future::join_all;
use tokio::runtime::Handle;
use tokio::task::LocalSet;
use tokio::time::{Instant, sleep};

use super::hostile_clients::{HostileKind, come};
use super::memory::{CallPlan, CapturedLog, MemoryServer, Visitor};
use super::well_behaved_clients::stay;

pub(crate) const SECOND: Duration = Duration::from_secs(1);

/// The overhead of a reply of 4 MiB: gRPC's five bytes, a tag, and the length.
const REPLY_FRAMING: usize = 5 + 1 + 4;

const WELL_BEHAVED: u8 = 6;
const HOSTILE: u8 = 24;

/// The state that well-behaved and hostile clients share.
pub(crate) struct VisitedServer {
    pub(crate) server: MemoryServer,
    pub(crate) bounds: Bounds,
    pub(crate) token: Option<&'static str>,
    /// The instant until which well-behaved clients make calls.
    pub(crate) until: Instant,
    /// The number of visitors that have not finished.
    pub(crate) busy: Cell<usize>,
    /// The kind of all addresses: 0 is IPv4, 1 is IPv4 mapped to IPv6, and 2 is IPv6.
    family: u8,
}

impl VisitedServer {
    fn draw(rng: &mut Rng) -> Self {
        let greeting = Duration::from_secs(rng.u64(5..20));
        let stall = greeting + Duration::from_secs(rng.u64(5..40));
        let bounds = Bounds {
            connections: 40,
            connections_each: rng.usize(2..6),
            calls: 8,
            resets: rng.u32(3..20),
            held_bytes: 4 * 1024 * 1024,
            greeting,
            stall,
            idle: stall + Duration::from_secs(rng.u64(60..600)),
            ..Bounds::default()
        };
        let token = rng.bool().then_some("right");
        let server = Server {
            bounds,
            token: token.map(|token| Token::new(token).unwrap()),
            ..Server::default()
        };
        let until = Instant::now() + Duration::from_secs(rng.u64(3600..3 * 3600));
        let family = rng.u8(0..3);
        let busy = Cell::new(usize::from(WELL_BEHAVED + HOSTILE));
        Self { server: MemoryServer::start(server), bounds, token, until, busy, family }
    }

    pub(crate) fn address(&self, group: u8, number: u8) -> IpAddr {
        let v4 = Ipv4Addr::new(10, group, number, 1);
        match self.family {
            0 => v4.into(),
            1 => v4.to_ipv6_mapped().into(),
            _ => Ipv6Addr::new(0x2001, 0xdb8, group.into(), number.into(), 0, 0, 0, 1).into(),
        }
    }

    /// Returns the plan of a call that is answered at once.
    pub(crate) fn plain(&self) -> CallPlan {
        CallPlan { reply: 9, token: self.token, ..CallPlan::default() }
    }

    /// Returns `true` if a call over this connection is answered.
    pub(crate) async fn answers(&self, visitor: &Visitor) -> bool {
        visitor.call(&self.plain()).await.is_ok_and(|end| (end.status, end.bytes) == (0, 9))
    }
}

/// Returns the errors of the run that this seed draws.
pub(crate) async fn server_wrongs(seed: u64) -> Vec<String> {
    LocalSet::new().run_until(wrongs(seed)).await
}

async fn wrongs(seed: u64) -> Vec<String> {
    let mut rng = Rng::with_seed(seed);
    let log = CapturedLog::default();
    let _guard = log.begin();
    let (tasks_at_first, mut wrong) = (tasks(), Vec::new());
    let here = Rc::new(VisitedServer::draw(&mut rng));
    let mut well_behaved = Vec::new();
    for number in 0..WELL_BEHAVED {
        let visitor = here.server.visit(here.address(0, number)).await;
        if !here.answers(&visitor).await {
            wrong.push(format!("client {number} is not let in"));
        }
        well_behaved.push(Rc::new(visitor));
    }
    let tasks_before = tasks();
    let mut running = Vec::new();
    for (number, visitor) in well_behaved.iter().enumerate() {
        let (here, rng) = (Rc::clone(&here), Rng::with_seed(rng.next_u64()));
        let visitor = Rc::clone(visitor);
        running.push(tokio::task::spawn_local(async move {
            stay(&here, &visitor, rng).await.map(|why| format!("client {number}: {why}"))
        }));
    }
    let mut crowds = 0;
    for number in 0..HOSTILE {
        let kind = HostileKind::draw(&mut rng, here.token.is_some());
        crowds += usize::from(kind == HostileKind::Crowd);
        let (here, mut rng) = (Rc::clone(&here), Rng::with_seed(rng.next_u64()));
        running.push(tokio::task::spawn_local(async move {
            sleep(Duration::from_millis(rng.u64(0..3_000_000))).await;
            let from = here.address(9, number);
            let wrong = come(&here, kind, from, &mut rng).await;
            here.busy.set(here.busy.get() - 1);
            wrong.map(|why| format!("{kind:?}: {why}"))
        }));
    }
    for ended in join_all(running).await {
        wrong.extend(ended.unwrap());
    }
    wrong.extend(recovered(&here, &well_behaved, tasks_before, crowds, &log).await);
    wrong.extend(ended_well(here, well_behaved).await);
    if tasks() != tasks_at_first {
        wrong.push(format!("{} tasks are left", tasks() - tasks_at_first));
    }
    if !wrong.is_empty() {
        wrong.push(log.text());
    }
    wrong
}

fn tasks() -> usize {
    Handle::current().metrics().num_alive_tasks()
}

/// Returns everything that differs from before the hostile clients came.
async fn recovered(
    here: &VisitedServer,
    well_behaved: &[Rc<Visitor>],
    tasks_before: usize,
    crowds: usize,
    log: &CapturedLog,
) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut expect = |holds: bool, what: &str| {
        if !holds {
            wrong.push(format!("after the hostile clients: {what}"));
        }
    };
    // The server may not yet have noticed the last client that disappeared.
    sleep(SECOND).await;
    expect(
        well_behaved.iter().all(|visitor| visitor.is_open()),
        "a well-behaved client's connection is closed",
    );
    expect(tasks() == tasks_before, &format!("{} tasks, {tasks_before} before", tasks()));
    expect(here.server.computing() == 0, "a computation goes on");
    let each = here.bounds.connections_each;
    for number in 0..HOSTILE {
        let from = here.address(9, number);
        let mut connections = Vec::new();
        for _ in 0..each {
            connections.push(here.server.visit(from).await);
            let is_served = here.answers(connections.last().unwrap()).await;
            expect(
                is_served,
                &format!("{from} is let in {} times of {each}", connections.len() - 1),
            );
        }
        let beyond = here.server.visit(from).await;
        expect(!here.answers(&beyond).await, &format!("{from} is let in beyond {each}"));
    }
    sleep(SECOND).await;
    let mut connections = Vec::new();
    for number in 0..=u8::try_from(here.bounds.connections).unwrap() {
        let connection = here.server.visit(here.address(8, number)).await;
        if here.answers(&connection).await {
            connections.push(connection);
        }
    }
    let places = here.bounds.connections - well_behaved.len();
    expect(connections.len() == places, &format!("{} of {places} places", connections.len()));
    drop(connections);
    // A request and a reply may take all bytes of the bound, but not one more.
    let Some(visitor) = well_behaved.first() else { return wrong };
    for (what, excess, status) in [("all bytes", 0, 0), ("a byte too many", 1, 8)] {
        let mut plan = CallPlan { reply: 0, ..here.plain() };
        plan.payload = here.bounds.held_bytes;
        plan.payload = here.bounds.held_bytes + excess - (plan.body().len() - plan.payload);
        let request = visitor.call(&plan).await.map(|end| end.status);
        let is_as_set = request.as_ref().is_ok_and(|code| *code == status);
        expect(is_as_set, &format!("{what} of a request: {request:?}"));
        let mut plan = here.plain();
        plan.reply = here.bounds.held_bytes + excess - REPLY_FRAMING;
        let reply = visitor.call(&plan).await.map(|end| (end.status, end.bytes));
        let is_whole = reply.as_ref().is_ok_and(|end| *end == (0, plan.reply));
        expect(is_whole == (excess == 0), &format!("{what} of a reply: {reply:?}"));
        sleep(SECOND).await;
    }
    // After this time a new line of the log counts the lines that were suppressed.
    sleep(2 * SECOND).await;
    let from = here.address(9, 0);
    let connections = join_all((0..=each).map(|_| here.server.visit(from))).await;
    sleep(SECOND).await;
    expect(
        connections.iter().filter(|connection| connection.is_open()).count() == each,
        "one was to be closed",
    );
    let crowded = crowds * super::hostile_clients::BEYOND + usize::from(HOSTILE) + 1;
    let logged = logged(&log.text(), "its address has reached its limit of connections");
    expect(logged == crowded, &format!("{crowded} were too many, the log says {logged}"));
    drop(connections);
    let blamed = (0..WELL_BEHAVED).map(|number| here.address(0, number));
    let blamed = blamed.filter(|from| {
        let peer = format!("peer={}", std::net::SocketAddr::from((*from, 4711)));
        // The first client may have two lines, because its request and its reply above were a byte
        // too long.
        let lines = log.text().lines().filter(|line| line.contains(&peer)).count();
        lines > 2 * usize::from(*from == here.address(0, 0))
    });
    expect(blamed.count() == 0, "a well-behaved client is blamed");
    wrong
}

/// Returns how many clients were rejected for this reason according to the log, with the suppressed
/// lines.
fn logged(log: &str, why: &str) -> usize {
    let lines = log.lines().filter(|line| line.contains(why));
    lines.map(|line| 1 + line.rsplit_once("others=").unwrap().1.parse::<usize>().unwrap()).sum()
}

/// Returns the errors that occur if the server stops while each well-behaved client has a call
/// under way.
async fn ended_well(here: Rc<VisitedServer>, well_behaved: Vec<Rc<Visitor>>) -> Vec<String> {
    let compute = here.bounds.idle + SECOND;
    let plan = CallPlan { compute, ..here.plain() };
    let calls: Vec<_> = well_behaved
        .into_iter()
        .map(|visitor| {
            let plan = plan.clone();
            tokio::task::spawn_local(async move { visitor.call(&plan).await })
        })
        .collect();
    sleep(SECOND).await;
    let Some(here) = Rc::into_inner(here) else { return vec!["somebody is still there".into()] };
    let mute = here.server.connect(here.address(7, 0));
    let ended = here.server.stop(compute + SECOND).await;
    let mut wrong = Vec::new();
    if ended.is_none_or(|took| took + 2 * SECOND < compute) {
        wrong.push(format!("the server ends its calls of {compute:?} after {ended:?}"));
    }
    for call in join_all(calls).await {
        match call.unwrap() {
            Ok(end) if (end.status, end.bytes) == (0, 9) => {}
            cut => wrong.push(format!("a call is cut at the end: {cut:?}")),
        }
    }
    drop(mute);
    sleep(SECOND).await;
    wrong
}
