//! Compresses the shipped models: as files they are open to every tool, in the program they take a third.

use std::path::Path;
use std::{env, fs, io};

const FOLDER: &str = "../../assets/models";
/// Of zlib's levels.
const LEVEL: u8 = 9;

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed={FOLDER}");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set"))?;
    for entry in fs::read_dir(FOLDER)? {
        let path = entry?.path();
        let Some(name) = path.file_name().filter(|_| path.extension().is_some_and(|ending| ending == "glb"))
        else {
            continue;
        };
        let compressed = miniz_oxide::deflate::compress_to_vec_zlib(&fs::read(&path)?, LEVEL);
        fs::write(Path::new(&out).join(name), compressed)?;
    }
    Ok(())
}
