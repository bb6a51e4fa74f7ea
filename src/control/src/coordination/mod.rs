//! Coordination of vehicles: what is planned for several of them at once. Laboratory metres throughout.
//!
//! All of it is pure: time is an argument, nothing draws, vehicles are in id order.

pub mod filter;
pub mod platoon;
pub mod predict;
pub mod queueing;
