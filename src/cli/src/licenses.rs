//! `city3d licenses`: prints the notices of third-party software.

use super::Failure;
use super::say::say;
use miniz_oxide::inflate::decompress_to_vec_zlib;

/// What `cargo xtask generate notices` has written, compressed by `build.rs`.
static NOTICES: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/notices"));

pub fn licenses() -> Result<(), Failure> {
    // A test makes sure that they can be decompressed.
    let notices = decompress_to_vec_zlib(NOTICES).unwrap_or_default();
    say(String::from_utf8_lossy(&notices).trim_end())
}
