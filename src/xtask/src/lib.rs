//! Tasks of the project's own, which the program does not need: generators of the files of `assets/`, a
//! benchmark beside other engines, a check of ground truth, and a soak test.
//!
//! `cargo xtask --help` lists them.

#![allow(clippy::disallowed_types, reason = "writes files")]
#![allow(missing_docs, reason = "tasks of the project, not a library")]

pub mod generate;
pub mod ground_truth;
pub mod models;
pub mod neutral;
pub mod notices;
pub mod reference;
pub mod soak;
