//! The protocols of the laboratory in simulated time: served city, mainframe, testbed, watchers and guests, over networks
//! with faults, while each of them stops and comes back; and what ends do to a city that runs.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

mod answers;
mod compare;
mod decisions;
mod demand;
mod ends;
mod guest;
mod lab;
mod lockstep;
mod mixed;
mod motion;
mod pace;
mod person;
mod plans;
mod real_time;
mod restarts;
mod senders;
mod watcher;
