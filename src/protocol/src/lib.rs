//! What the parts of a city tell each other: snapshots, commands and events inside of a process, and between processes
//! the messages of the UDP link and of ROS 2.

pub mod cdr;
pub mod ros2;
pub mod snapshot;
pub mod wire;
