//! Bounds on what clients may take from a server.

use std::time::Duration;

/// Bounds what clients may take from a server, whoever they are.
///
/// A client that reaches a bound is refused or its connection is closed, with a warning in the log.
/// The server goes on serving all others. The defaults accept some hundred vehicles and keep the
/// server under about 1 GB. One host alone cannot use up `connections`. Many hosts together can, so
/// use a firewall or certificates against them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Bounds {
    /// The greatest number of connections at once; 1024 by default. Further connections are closed
    /// as they come.
    pub connections: usize,
    /// The greatest number of connections from one address, or from one /64 of IPv6, at once; 64 by
    /// default.
    pub connections_each: usize,
    /// The greatest number of calls under way on one connection; 64 by default. A client must wait
    /// before it makes another call, or its connection is closed.
    pub calls: u32,
    /// The greatest number of calls that one connection may cancel in a second; 1000 by default.
    /// Operators cancel calls that are no longer wanted (F7). A connection that cancels more is
    /// closed.
    pub resets: u32,
    /// The greatest size of a call's headers, in bytes; 16 KiB by default. A call with more is
    /// answered with 431, and a client that keeps sending is disconnected.
    pub header_bytes: u32,
    /// The bytes of requests and replies that all connections together may hold at once; 512 MiB by
    /// default. A call that would need more fails with `RESOURCE_EXHAUSTED`, and a reply is cut
    /// off.
    pub held_bytes: usize,
    /// The time from a connection's first byte, TLS included, to its first accepted call; 10 s by
    /// default. After that it is closed.
    pub greeting: Duration,
    /// The time for a whole request to arrive, and for a client to take the next 64 KiB of a reply;
    /// 30 s by default. Then the request fails with `DEADLINE_EXCEEDED`, and the reply's connection
    /// is closed.
    pub stall: Duration,
    /// The time that a connection may be without a call; 5 minutes by default. After that it is
    /// closed. A [`Connection`] connects again by itself.
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
