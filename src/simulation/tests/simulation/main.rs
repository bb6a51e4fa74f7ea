//! Runs in lockstep: the world, drivers and right of way on shipped and made maps, under noise and lag.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod city;
mod demand;
mod driving;
mod lost_link;
mod measures;
mod platoon;
mod robustness;
mod roundabout;
mod seen;
mod signals;
mod unseen;
mod workers;
mod world;
