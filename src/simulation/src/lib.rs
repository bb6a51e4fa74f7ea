//! The simulated city: scenarios, the world, the environment between it and its control framework, the emulated
//! testbed, and runs of all of them in lockstep.

pub mod environment;
pub mod runner;
pub mod scenario;
pub mod sim;
pub mod testbed;
