//! Logs of runs: writing and reading them, simulating them again, and drawing their figures.

#![allow(clippy::disallowed_types, reason = "reads and writes logs, on a thread of its own")]

pub mod figures;
pub mod record;
pub mod replay;
