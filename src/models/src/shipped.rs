//! The embedded models, written by `cargo xtask generate models`.

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

/// Names of files and their bytes.
pub const SHIPPED: [(&str, &[u8]); 14] = [
    ("sedan.glb", include_bytes!("../../../assets/models/sedan.glb")),
    ("hatchback.glb", include_bytes!("../../../assets/models/hatchback.glb")),
    ("suv.glb", include_bytes!("../../../assets/models/suv.glb")),
    ("van.glb", include_bytes!("../../../assets/models/van.glb")),
    ("pickup.glb", include_bytes!("../../../assets/models/pickup.glb")),
    ("bus.glb", include_bytes!("../../../assets/models/bus.glb")),
    ("truck.glb", include_bytes!("../../../assets/models/truck.glb")),
    ("taxi.glb", include_bytes!("../../../assets/models/taxi.glb")),
    ("estate.glb", include_bytes!("../../../assets/models/estate.glb")),
    (BENCH, include_bytes!("../../../assets/models/bench.glb")),
    (PICNIC_TABLE, include_bytes!("../../../assets/models/picnic_table.glb")),
    (LAMP, include_bytes!("../../../assets/models/lamp.glb")),
    (BIN, include_bytes!("../../../assets/models/bin.glb")),
    (FUEL_PUMP, include_bytes!("../../../assets/models/fuel_pump.glb")),
];

/// The bytes of a model by its file's name.
pub fn shipped(name: &str) -> Option<&'static [u8]> {
    SHIPPED.iter().find(|(shipped, _)| *shipped == name).map(|(_, bytes)| *bytes)
}
