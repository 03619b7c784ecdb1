//! Collects all tests that need no process of their own into one program, which is linked once and
//! runs them in parallel.

#[path = "support/floor.rs"]
mod drawn_floor;
#[path = "support/graph.rs"]
mod graph;
#[cfg(feature = "grpc")]
#[path = "support/hosts.rs"]
mod hosts;
#[path = "support/link.rs"]
mod link;
mod support;

mod behaviour;
mod connections;
mod deadlines;
mod ends;
mod floor;
mod graphs;
mod grpc;
mod interfaces;
mod lineage;
mod messages;
mod outcomes;
mod pipeline;
mod progressive;
mod recovery;
mod side;
mod timers;
mod tower;
