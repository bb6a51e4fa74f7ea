//! What several tests share. Each test binary uses its own part of it.

#![allow(dead_code, reason = "each test binary uses its own part")]

pub mod bag;
pub mod described;
pub mod drawing;
pub mod golden;
pub mod link;
pub mod live;
pub mod mixed;
pub mod ros;
pub mod watch;
