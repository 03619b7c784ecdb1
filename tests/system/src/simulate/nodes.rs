//! The loop of the ROS 2 node in virtual time. The topics lose, delay, duplicate and reorder
//! messages, peers die and come back, and parameters are set meanwhile.
//!
//! In place of the middleware there are topics within the process.

mod checks;
mod draw;
mod facts;
mod play;
mod scenario;
mod shrink;

pub use checks::CHECKS;
pub use facts::KINDS;
pub use scenario::Scenario;
