//! The embedded models, written by `cargo xtask generate models`.

use super::{Model, car, street};

/// Names of files and their bytes.
pub const SHIPPED: [(&str, &[u8]); 10] = [
    ("sedan.glb", include_bytes!("../../../assets/models/sedan.glb")),
    ("hatchback.glb", include_bytes!("../../../assets/models/hatchback.glb")),
    ("suv.glb", include_bytes!("../../../assets/models/suv.glb")),
    ("van.glb", include_bytes!("../../../assets/models/van.glb")),
    ("pickup.glb", include_bytes!("../../../assets/models/pickup.glb")),
    (street::BENCH, include_bytes!("../../../assets/models/bench.glb")),
    (street::PICNIC_TABLE, include_bytes!("../../../assets/models/picnic_table.glb")),
    (street::LAMP, include_bytes!("../../../assets/models/lamp.glb")),
    (street::BIN, include_bytes!("../../../assets/models/bin.glb")),
    (street::FUEL_PUMP, include_bytes!("../../../assets/models/fuel_pump.glb")),
];

/// The bytes of a model by its file's name.
pub fn shipped(name: &str) -> Option<&'static [u8]> {
    SHIPPED.iter().find(|(shipped, _)| *shipped == name).map(|(_, bytes)| *bytes)
}

/// All models made in code, by file name.
pub fn made() -> Vec<(String, Model)> {
    let cars = [car::SEDAN, car::HATCHBACK, car::SUV, car::VAN, car::PICKUP];
    let cars = cars.iter().map(|shape| (format!("{}.glb", shape.name), car::model(shape)));
    let street = street::models().into_iter().map(|(name, model)| (name.to_owned(), model));
    cars.chain(street).collect()
}
