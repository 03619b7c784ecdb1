//! What clients may take of a server.

use std::time::Duration;

/// What clients may take of a server, whoever they are.
///
/// A client that reaches a bound is refused or its connection closed, with a warning in the log; the others are served
/// on. The defaults accept some hundred vehicles, and hold the server under about 1 GB. One host cannot use up `connections`, a
/// crowd of hosts can: that is the work of a firewall, or of certificates.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Bounds {
    /// Connections at once; 1024 by default. More are closed as they come.
    pub connections: usize,
    /// Connections at once from one address, or from one /64 of IPv6; 64 by default.
    pub connections_each: usize,
    /// Calls under way on one connection; 64 by default. A client waits before it makes more; one that does not is closed.
    pub calls: u32,
    /// Calls that one connection may cancel in a second; 1000 by default. Operators cancel those that are
    /// no longer wanted (F7). A connection that cancels more is closed.
    pub resets: u32,
    /// Bytes of a call's headers; 16 KiB by default. A call with more gets 431, and one that goes on is closed.
    pub header_bytes: u32,
    /// Bytes of requests and replies that all connections together hold at once; 512 MiB by default.
    /// A call that would need more fails with `RESOURCE_EXHAUSTED`, a reply is cut off.
    pub held_bytes: usize,
    /// How long a connection may take from the first byte, TLS included, to the first call that is accepted;
    /// 10 s by default. After that it is closed.
    pub greeting: Duration,
    /// How long a request may take to come whole, and a reply may wait until its next 64 KiB are taken;
    /// 30 s by default. Then the request fails with `DEADLINE_EXCEEDED`, and the connection of the reply is closed.
    pub stall: Duration,
    /// How long a connection may be without a call; 5 minutes by default. After that it is closed;
    /// a [`Connection`] connects again by itself.
    ///
    /// [`Connection`]: crate::grpc::Connection
    pub idle: Duration,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            connections: 1024,
            connections_each: 64,
            calls: 64,
            resets: 1000,
            header_bytes: 16 * 1024,
            held_bytes: 512 * 1024 * 1024,
            greeting: Duration::from_secs(10),
            stall: Duration::from_secs(30),
            idle: Duration::from_secs(300),
        }
    }
}
