//! What several tests share. Each test binary uses its own part of it.

#![allow(dead_code, reason = "each test binary uses its own part")]

pub mod bag;
#[cfg(feature = "render")]
pub mod drawing;
pub mod link;
pub mod live;
pub mod mixed;
#[cfg(feature = "ros")]
pub mod ros;
pub mod watch;
