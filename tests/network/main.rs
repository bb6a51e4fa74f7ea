//! One city in several processes: the UDP link with loss and restarts, physical vehicles, and ROS with its own servers.

#[cfg(feature = "render")]
mod bench_link;
mod link;
mod link_faults;
mod physical;
mod restarts;
#[cfg(feature = "ros")]
mod ros;
#[cfg(feature = "ros")]
mod rosbridge;
#[path = "../support/mod.rs"]
mod support;
