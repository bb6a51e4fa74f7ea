//! Street furniture: instances of shipped or user models of benches, tables, lamps, bins and fuel pumps.

use super::mesh::{Class, Surface};
use super::{SceneObject, models};
use city3d_models::{BENCH, BIN, FUEL_PUMP, LAMP, Model, PICNIC_TABLE, glb, shipped};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Errors of the distant levels of detail.
const FAR_ERRORS_M: [f32; 2] = [0.06, 0.16];

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum FurnitureKind {
    Bench,
    PicnicTable,
    Lamp,
    Bin,
    FuelPump,
}

const FILES: [(FurnitureKind, &str, Class); 5] = [
    (FurnitureKind::Bench, BENCH, Class::Furniture),
    (FurnitureKind::PicnicTable, PICNIC_TABLE, Class::Furniture),
    (FurnitureKind::Lamp, LAMP, Class::Pole),
    (FurnitureKind::Bin, BIN, Class::Furniture),
    (FurnitureKind::FuelPump, FUEL_PUMP, Class::Furniture),
];

/// Prototypes of all furniture at all levels of detail.
pub(super) struct Furniture {
    pieces: BTreeMap<FurnitureKind, SceneObject>,
}

impl Furniture {
    /// Uses the models of `models` that have the name of a prototype, and the shipped ones otherwise.
    pub(super) fn new(models: &BTreeMap<String, Arc<Model>>) -> Self {
        let piece = |(piece, file, class): (FurnitureKind, &str, Class)| {
            // Tests guarantee that the shipped files can be read.
            let own = || Some(Arc::new(glb::read(shipped(file)?).ok()?));
            let model = models.get(file).cloned().or_else(own)?;
            let mut object = models::object(&model, class, FAR_ERRORS_M);
            object.measure_corners();
            object.add_coarser_levels();
            Some((piece, object))
        };
        Self { pieces: FILES.into_iter().filter_map(piece).collect() }
    }

    /// An instance at a position, facing along a direction.
    pub(super) fn place(&self, piece: FurnitureKind, at: Vec3, front: Vec2, scale: f32) -> SceneObject {
        let here = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            Quat::from_rotation_z(front.to_angle()),
            at,
        );
        self.pieces
            .get(&piece)
            .map_or_else(SceneObject::default, |object| object.placed(here, |finish| finish))
    }

    /// The height of a prototype.
    pub(super) fn height(&self, piece: FurnitureKind) -> Option<f32> {
        let level = self.pieces.get(&piece)?.levels.first()?;
        Some(level.mesh.bounds()[1].z).filter(|height| *height > 0.1)
    }
}

/// Centre of a lamp's lens: the mean of its emissive vertices, or the top of the lamp if it has none.
pub(super) fn lens(lamp: &SceneObject) -> Option<Vec3> {
    let mesh = &lamp.levels.first()?.mesh;
    let shining: Vec<Vec3> =
        mesh.vertices.iter().filter(|v| v.finish.surface == Surface::Lantern).map(|v| v.position).collect();
    if shining.is_empty() {
        let [low, high] = mesh.bounds();
        return Some(((low + high) / 2.0).with_z(high.z));
    }
    Some(shining.iter().copied().sum::<Vec3>() / shining.len() as f32)
}
