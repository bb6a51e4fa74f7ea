//! Compresses the notices of third-party software: in the program they take a fifth of the file.

use std::path::Path;
use std::{env, fs, io};

const NOTICES: &str = "../../THIRD-PARTY-NOTICES.txt";
/// Of zlib's levels.
const LEVEL: u8 = 9;

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed={NOTICES}");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set"))?;
    let compressed = miniz_oxide::deflate::compress_to_vec_zlib(&fs::read(NOTICES)?, LEVEL);
    fs::write(Path::new(&out).join("notices"), compressed)
}
