//! The models that the program carries: what `city3d generate models` wrote.

use super::{Model, car};

/// Names of files and their bytes.
pub const SHIPPED: [(&str, &[u8]); 5] = [
    ("sedan.glb", include_bytes!("../../assets/models/sedan.glb")),
    ("hatchback.glb", include_bytes!("../../assets/models/hatchback.glb")),
    ("suv.glb", include_bytes!("../../assets/models/suv.glb")),
    ("van.glb", include_bytes!("../../assets/models/van.glb")),
    ("pickup.glb", include_bytes!("../../assets/models/pickup.glb")),
];

/// The bytes of a model by its file's name.
pub fn shipped(name: &str) -> Option<&'static [u8]> {
    SHIPPED.iter().find(|(shipped, _)| *shipped == name).map(|(_, bytes)| *bytes)
}

/// All models as they are made in code, by the names of their files.
pub fn made() -> Vec<(String, Model)> {
    let cars = [car::SEDAN, car::HATCHBACK, car::SUV, car::VAN, car::PICKUP];
    cars.iter().map(|shape| (format!("{}.glb", shape.name), car::model(shape))).collect()
}
