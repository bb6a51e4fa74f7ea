//! Compresses the font of figures: in the program it takes half of the file.

use std::path::Path;
use std::{env, fs, io};

/// Of zlib's levels.
const LEVEL: u8 = 9;

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set"))?;
    for (name, font) in [("regular", dejavu::sans::regular()), ("bold", dejavu::sans::bold())] {
        fs::write(Path::new(&out).join(name), miniz_oxide::deflate::compress_to_vec_zlib(font, LEVEL))?;
    }
    Ok(())
}
