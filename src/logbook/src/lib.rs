//! Logs of runs: writing and reading them, simulating them again, and drawing their figures; tables and maps of sweeps.

#![allow(clippy::disallowed_types, reason = "reads and writes logs, on a thread of its own")]

pub mod figures;
pub mod measures;
pub mod record;
pub mod replay;
pub mod sweep;
pub mod verify;
