//! Tasks of the project's own, which the program does not need: generators of the files of `assets/`.
//!
//! `cargo xtask --help` lists them.

#![allow(clippy::disallowed_types, reason = "writes files")]

pub mod generate;
