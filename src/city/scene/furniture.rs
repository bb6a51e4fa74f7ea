//! Benches, tables, lamps, bins and fuel pumps: copies of models that the program carries, or of the user's.

use super::mesh::{Class, Surface};
use super::{Object, models};
use crate::model::{Model, glb, shipped, street};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How far nodes for a distance lie from the others.
const FAR_ERRORS_M: [f32; 2] = [0.06, 0.16];

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Piece {
    Bench,
    PicnicTable,
    Lamp,
    Bin,
    FuelPump,
}

const FILES: [(Piece, &str, Class); 5] = [
    (Piece::Bench, street::BENCH, Class::Furniture),
    (Piece::PicnicTable, street::PICNIC_TABLE, Class::Furniture),
    (Piece::Lamp, street::LAMP, Class::Pole),
    (Piece::Bin, street::BIN, Class::Furniture),
    (Piece::FuelPump, street::FUEL_PUMP, Class::Furniture),
];

/// Each piece once, in its own frame, at all its levels of detail.
pub(super) struct Furniture {
    pieces: BTreeMap<Piece, Object>,
}

impl Furniture {
    /// Those of `models` that have the name of a piece, the program's own for all others.
    pub(super) fn new(models: &BTreeMap<String, Arc<Model>>) -> Self {
        let piece = |(piece, file, class): (Piece, &str, Class)| {
            // Tests see to it that the program's own files can be read.
            let own = || Some(Arc::new(glb::read(shipped(file)?).ok()?));
            let model = models.get(file).cloned().or_else(own)?;
            let mut object = models::object(&model, class, FAR_ERRORS_M);
            object.measure_corners();
            object.add_coarser_levels();
            Some((piece, object))
        };
        Self { pieces: FILES.into_iter().filter_map(piece).collect() }
    }

    /// A piece that stands at a place and looks along a direction.
    pub(super) fn place(&self, piece: Piece, at: Vec3, front: Vec2, scale: f32) -> Object {
        let here = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            Quat::from_rotation_z(front.to_angle()),
            at,
        );
        self.pieces.get(&piece).map_or_else(Object::default, |object| object.placed(here, |finish| finish))
    }

    /// How high a piece is.
    pub(super) fn height(&self, piece: Piece) -> Option<f32> {
        let level = self.pieces.get(&piece)?.levels.first()?;
        Some(level.mesh.bounds()[1].z).filter(|height| *height > 0.1)
    }
}

/// The middle of the lens of a lamp: of what shines, or the top of a lamp on which nothing does.
pub(super) fn lens(lamp: &Object) -> Option<Vec3> {
    let mesh = &lamp.levels.first()?.mesh;
    let shining: Vec<Vec3> =
        mesh.vertices.iter().filter(|v| v.finish.surface == Surface::Lantern).map(|v| v.position).collect();
    if shining.is_empty() {
        let [low, high] = mesh.bounds();
        return Some(((low + high) / 2.0).with_z(high.z));
    }
    Some(shining.iter().copied().sum::<Vec3>() / shining.len() as f32)
}
