//! A ROS 2 node that adds cloud assistance to a graph that is already there.

pub mod arguments;
pub mod key;
pub mod names;
pub mod parameters;
pub mod settings;
