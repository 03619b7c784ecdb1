//! The state that all connections of a server share: the counts of connections and bytes, and the
//! log of rejected clients.

use std::collections::HashMap;
use std::io;
use std::mem::{Discriminant, discriminant};
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::lock;
use thiserror::Error;
use tokio::time::Instant;
use tracing::warn;

use crate::grpc::server::bounds::Bounds;

/// The least time between two lines of the log with the same reason.
const EVERY: Duration = Duration::from_secs(1);

/// The state that all connections share (D8 bounded).
pub(crate) struct ServerLimits {
    pub(crate) bounds: Bounds,
    by_address: Mutex<HashMap<IpAddr, usize>>,
    connections_open: AtomicUsize,
    held: AtomicUsize,
    reported: Mutex<HashMap<Discriminant<RejectReason>, SuppressedLog>>,
}

/// The instant at which a reason was last logged, and the number of lines that were suppressed
/// since then.
struct SuppressedLog {
    at: Instant,
    suppressed: u64,
}

/// The reason why a client was rejected.
#[derive(Debug, Error)]
pub(crate) enum RejectReason {
    #[error("the server has reached its limit of connections")]
    Full,
    #[error("its address has reached its limit of connections")]
    Crowd,
    #[error("its TLS handshake failed: {0}")]
    Tls(io::Error),
    #[error("it made no call in time")]
    Mute,
    #[error("it has made no call for too long")]
    Idle,
    #[error("it does not read its replies")]
    Unread,
    #[error("it cancels calls faster than it is allowed to")]
    Resets,
    #[error("its HTTP/2 connection failed: {0}")]
    Protocol(String),
    #[error("its call failed: {0}")]
    Call(String),
}

impl ServerLimits {
    pub(crate) fn new(bounds: Bounds) -> Self {
        Self {
            bounds,
            by_address: Mutex::default(),
            connections_open: AtomicUsize::new(0),
            held: AtomicUsize::new(0),
            reported: Mutex::default(),
        }
    }

    /// Returns a permit for one more connection from this address.
    pub(crate) fn permit(
        self: &Arc<Self>,
        address: IpAddr,
    ) -> Result<ConnectionPermit, RejectReason> {
        let from = network(address);
        let mut by_address = lock(&self.by_address);
        if self.connections_open.load(Ordering::Relaxed) >= self.bounds.connections {
            return Err(RejectReason::Full);
        }
        if by_address.get(&from).map_or(0, |count| *count) >= self.bounds.connections_each {
            return Err(RejectReason::Crowd);
        }
        *by_address.entry(from).or_default() += 1;
        self.connections_open.fetch_add(1, Ordering::Relaxed);
        Ok(ConnectionPermit { limits: Arc::clone(self), from })
    }

    /// Reserves this many more bytes, which must be given back later. Returns `false` if they
    /// exceed the bound.
    pub(crate) fn take(&self, bytes: usize) -> bool {
        let total = self.held.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        let has_room = total <= self.bounds.held_bytes;
        if !has_room {
            self.give_back(bytes);
        }
        has_room
    }

    pub(crate) fn give_back(&self, bytes: usize) {
        self.held.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Logs who was rejected and why, at most once a second for each reason.
    pub(crate) fn log(&self, peer: SocketAddr, why: &RejectReason) {
        let (mut reported, now) = (lock(&self.reported), Instant::now());
        let others = match reported.get_mut(&discriminant(why)) {
            Some(last) if now.duration_since(last.at) < EVERY => {
                last.suppressed += 1;
                return;
            }
            Some(last) => {
                std::mem::replace(last, SuppressedLog { at: now, suppressed: 0 }).suppressed
            }
            None => {
                reported.insert(discriminant(why), SuppressedLog { at: now, suppressed: 0 });
                0
            }
        };
        drop(reported);
        warn!(%peer, why = %why, others, "a client was rejected");
    }
}

/// A connection's permit, given back when it is dropped.
pub(crate) struct ConnectionPermit {
    limits: Arc<ServerLimits>,
    from: IpAddr,
}

impl Drop for ConnectionPermit {
    fn drop(&mut self) {
        let mut by_address = lock(&self.limits.by_address);
        self.limits.connections_open.fetch_sub(1, Ordering::Relaxed);
        if let Some(count) = by_address.get_mut(&self.from) {
            *count -= 1;
            if *count == 0 {
                by_address.remove(&self.from);
            }
        }
    }
}

/// Returns the IPv4 address or the IPv6 /64 network, since one host can choose any address of its
/// /64.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An address whose connections have ended leaves nothing behind, however many addresses there
    /// are (D8).
    #[test]
    fn after_its_last_connection_nothing_of_an_address_is_left() {
        let limits = Arc::new(ServerLimits::new(Bounds { connections: 3, ..Bounds::default() }));
        for host in 0..10_000_u32 {
            let address = IpAddr::from(host.to_be_bytes());
            let permits = [(); 3].map(|()| limits.permit(address).expect("there is room"));
            let full = limits.permit(IpAddr::from([9, 9, 9, 9])).err().map(|why| why.to_string());
            assert_eq!(full.as_deref(), Some("the server has reached its limit of connections"));
            drop(permits);
        }
        assert!(lock(&limits.by_address).is_empty());
    }

    /// An address that was never admitted leaves nothing behind either (D8).
    #[test]
    fn an_address_that_may_have_no_connection_leaves_nothing() {
        let bounds = Bounds { connections_each: 0, ..Bounds::default() };
        let limits = Arc::new(ServerLimits::new(bounds));
        let refused = limits.permit(IpAddr::from([10, 0, 0, 1])).err().map(|why| why.to_string());
        assert_eq!(refused.as_deref(), Some("its address has reached its limit of connections"));
        assert!(lock(&limits.by_address).is_empty());
    }
}
