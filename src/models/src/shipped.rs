//! The embedded models, written by `cargo xtask generate models`.

use miniz_oxide::inflate::decompress_to_vec_zlib;
use std::sync::OnceLock;

/// File names of street furniture.
pub const BENCH: &str = "bench.glb";
/// File name of the table with two benches.
pub const PICNIC_TABLE: &str = "picnic_table.glb";
/// File name of the street lamp.
pub const LAMP: &str = "lamp.glb";
/// File name of the litter bin.
pub const BIN: &str = "bin.glb";
/// File name of the pump of a filling station.
pub const FUEL_PUMP: &str = "fuel_pump.glb";
/// File names of all street furniture.
pub const FURNITURE: [&str; 5] = [BENCH, PICNIC_TABLE, LAMP, BIN, FUEL_PUMP];

macro_rules! compressed {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name)).as_slice()
    };
}

/// Names of the files.
pub const SHIPPED: [&str; 14] = [
    "sedan.glb",
    "hatchback.glb",
    "suv.glb",
    "van.glb",
    "pickup.glb",
    "bus.glb",
    "truck.glb",
    "taxi.glb",
    "estate.glb",
    BENCH,
    PICNIC_TABLE,
    LAMP,
    BIN,
    FUEL_PUMP,
];

/// The files in the order of `SHIPPED`, compressed by `build.rs`. A static, for each crate that uses a constant gets a copy of it.
static COMPRESSED: [&[u8]; SHIPPED.len()] = [
    compressed!("sedan.glb"),
    compressed!("hatchback.glb"),
    compressed!("suv.glb"),
    compressed!("van.glb"),
    compressed!("pickup.glb"),
    compressed!("bus.glb"),
    compressed!("truck.glb"),
    compressed!("taxi.glb"),
    compressed!("estate.glb"),
    compressed!("bench.glb"),
    compressed!("picnic_table.glb"),
    compressed!("lamp.glb"),
    compressed!("bin.glb"),
    compressed!("fuel_pump.glb"),
];

/// The bytes of a model by its file's name. They are decompressed once, when they are first asked for.
pub fn shipped(name: &str) -> Option<&'static [u8]> {
    static FILES: [OnceLock<Vec<u8>>; SHIPPED.len()] = [const { OnceLock::new() }; SHIPPED.len()];
    let index = SHIPPED.iter().position(|shipped| *shipped == name)?;
    // A test makes sure that they can be decompressed.
    Some(FILES[index].get_or_init(|| decompress_to_vec_zlib(COMPRESSED[index]).unwrap_or_default()))
}
