//! `city3d licenses`: prints the notices of third-party software.

use super::Failure;
use super::say::say;

/// Written by `cargo xtask generate notices`.
const NOTICES: &str = include_str!("../../../THIRD-PARTY-NOTICES.txt");

pub fn licenses() -> Result<(), Failure> {
    say(NOTICES.trim_end())
}
