//! Decides when a connection must be closed: it is silent, it reads nothing, or it cancels too many
//! calls.
//!
//! The task that serves the connection reports what the connection does. The server sets the
//! bounds.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use fuseline_engine::lock;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep};
use tonic::Status;

use crate::grpc::server::limits::{RejectReason, ServerLimits};

/// Records the connection's last activity, its calls under way, and the replies that it has not
/// read.
pub(crate) struct ConnectionWatch {
    pub(crate) limits: Arc<ServerLimits>,
    peer: SocketAddr,
    has_called: AtomicBool,
    under_way: AtomicUsize,
    activity: Mutex<Activity>,
    too_many: Notify,
}

/// The instant of the last activity, the unread replies, and the number of calls that were
/// cancelled in the current second.
struct Activity {
    moved: Instant,
    second: Instant,
    resets: u32,
    /// By the replies' numbers. Each has an instant of its own, so that a reply that is read does
    /// not hide one that is not.
    unread: HashMap<u64, UnreadReply>,
    replies: u64,
}

/// The number of a reply's bytes that the client has not taken, and the instant when it last took
/// any.
struct UnreadReply {
    bytes: usize,
    since: Instant,
}

impl ConnectionWatch {
    pub(crate) fn new(limits: Arc<ServerLimits>, peer: SocketAddr, now: Instant) -> Self {
        Self {
            limits,
            peer,
            has_called: AtomicBool::new(false),
            under_way: AtomicUsize::new(0),
            activity: Mutex::new(Activity {
                moved: now,
                second: now,
                resets: 0,
                unread: HashMap::new(),
                replies: 0,
            }),
            too_many: Notify::new(),
        }
    }

    /// Logs that a call was refused.
    pub(crate) fn refused(&self, status: Status) -> Status {
        self.limits.log(self.peer, &RejectReason::Call(status.message().to_owned()));
        status
    }

    /// Notes a reply of this many bytes that is ready to be sent. Returns the reply's number.
    pub(crate) fn reply_ready(&self, bytes: usize) -> u64 {
        let (mut activity, now) = (self.activity(), Instant::now());
        activity.replies += 1;
        let reply = activity.replies;
        activity.unread.insert(reply, UnreadReply { bytes, since: now });
        reply
    }

    /// Notes that this many of a reply's bytes were taken, or are no longer needed.
    pub(crate) fn paid(&self, reply: u64, bytes: usize) {
        let (mut activity, now) = (self.activity(), Instant::now());
        activity.moved = now;
        if let Some(unread) = activity.unread.get_mut(&reply) {
            unread.since = now;
            unread.bytes -= bytes;
            if unread.bytes == 0 {
                activity.unread.remove(&reply);
            }
        }
    }

    /// Notes that a call began.
    pub(crate) fn call_began(&self) {
        self.has_called.store(true, Ordering::Relaxed);
        self.under_way.fetch_add(1, Ordering::Relaxed);
        self.moved();
    }

    /// Notes that a call ended, perhaps before it was answered.
    pub(crate) fn call_ended(&self, is_answered: bool) {
        self.under_way.fetch_sub(1, Ordering::Relaxed);
        self.moved();
        if !is_answered {
            self.taken_back();
        }
    }

    fn moved(&self) {
        self.activity().moved = Instant::now();
    }

    fn activity(&self) -> MutexGuard<'_, Activity> {
        lock(&self.activity)
    }

    /// Notes that the client no longer wants a call that is not answered.
    pub(crate) fn taken_back(&self) {
        let mut activity = self.activity();
        let now = Instant::now();
        if now.duration_since(activity.second) >= Duration::from_secs(1) {
            (activity.second, activity.resets) = (now, 0);
        }
        activity.resets += 1;
        if activity.resets > self.limits.bounds.resets {
            self.too_many.notify_one();
        }
    }

    /// Waits until the connection must be closed. Returns the reason.
    pub(crate) async fn expired(&self) -> RejectReason {
        loop {
            let bounds = self.limits.bounds;
            let calls = self.under_way.load(Ordering::Relaxed) > 0;
            let (moved, unread) = {
                let activity = self.activity();
                (activity.moved, activity.unread.values().map(|reply| reply.since).min())
            };
            let (since, patience, why) = match (self.has_called.load(Ordering::Relaxed), unread) {
                (false, _) => (moved, bounds.greeting, RejectReason::Mute),
                (true, Some(since)) => (since, bounds.stall, RejectReason::Unread),
                (true, None) => (moved, bounds.idle, RejectReason::Idle),
            };
            let remaining = patience.saturating_sub(since.elapsed());
            if remaining.is_zero() && (unread.is_some() || !calls) {
                return why;
            }
            // Changes of calls and activity do not wake this task, so it looks again soon enough
            // for each bound.
            let soon = bounds.greeting.min(bounds.stall).min(bounds.idle);
            tokio::select! {
                () = sleep(if remaining.is_zero() { soon } else { remaining.min(soon) }) => {}
                () = self.too_many.notified() => return RejectReason::Resets,
            }
        }
    }
}
