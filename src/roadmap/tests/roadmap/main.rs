//! Maps of the project and of others: what is read from a drawing, what is refused, what is repaired, and grids.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

mod grid;
mod map_corpus;
mod maps;
mod repair;
