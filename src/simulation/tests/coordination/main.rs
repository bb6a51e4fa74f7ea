//! Coordinated runs in lockstep: the roundabout, merges and intersections, in the ideal environment and under noise.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod crossed;
mod crossing;
mod disturbed;
mod roundabout;
mod studies;
mod support;
