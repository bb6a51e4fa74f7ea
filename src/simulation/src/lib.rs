//! The simulated city: scenarios, the demand of their inflows, the world, the environment between it and its control
//! framework, the emulated testbed, runs of all of them in lockstep, measures of their traffic, and the parameter grids
//! of sweeps.

pub mod demand;
pub mod environment;
pub mod measures;
pub mod runner;
pub mod scenario;
pub mod sim;
pub mod sweep;
pub mod testbed;
