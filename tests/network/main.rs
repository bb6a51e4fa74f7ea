//! One city in several processes: the UDP link with loss and restarts, physical vehicles, and ROS with its own servers.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod bench_link;
mod link;
mod link_faults;
mod physical;
mod restarts;
mod ros;
mod ros2;
mod rosbridge;
#[path = "../support/mod.rs"]
mod support;
