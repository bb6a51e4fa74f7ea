//! Which model each body type has, and what of it goes to the GPU.

use super::VehicleMesh;
use crate::model::{Measures, Model, fitted, glb, shipped};
use crate::snapshot::{BodyType, Dimensions};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bodies without few faces of their own are simplified to within this.
const COARSENESS_M: f32 = 0.32;

/// Models of body types; what is not among them is drawn as a sedan.
#[derive(Clone, Debug)]
pub(in crate::render) struct Models {
    models: BTreeMap<BodyType, Arc<Model>>,
}

/// Meshes of a vehicle to its measures.
#[derive(Clone, Debug)]
pub(in crate::render) struct Build {
    pub(in crate::render) body: VehicleMesh,
    pub(in crate::render) wheel: VehicleMesh,
    pub(in crate::render) far_body: VehicleMesh,
    pub(in crate::render) far_wheel: VehicleMesh,
    /// From the middle of the vehicle to the middle of a wheel.
    pub(in crate::render) half_track_m: f32,
}

impl Default for Models {
    fn default() -> Self {
        let files = [
            (BodyType::Sedan, "sedan.glb"),
            (BodyType::Hatchback, "hatchback.glb"),
            (BodyType::Suv, "suv.glb"),
            (BodyType::Van, "van.glb"),
            (BodyType::Pickup, "pickup.glb"),
        ];
        // Tests see to it that the program's own files can be read.
        let load = |(body, file)| Some((body, Arc::new(glb::read(shipped(file)?).ok()?)));
        Self { models: files.into_iter().filter_map(load).collect() }
    }
}

impl Models {
    /// Draws a body type with a model.
    pub(in crate::render) fn insert(&mut self, body: BodyType, model: Arc<Model>) {
        self.models.insert(body, model);
    }

    pub(in crate::render) fn build(&self, body: BodyType, d: &Dimensions) -> Build {
        let Some(model) = self.models.get(&body).or_else(|| self.models.get(&BodyType::Sedan)) else {
            return Build::empty(d);
        };
        let measures = Measures {
            length: d.length_m as f32,
            width: d.width_m as f32,
            height: (d.height_m * body.height_factor()) as f32,
            wheelbase: d.wheelbase_m as f32,
            wheel_radius: d.wheel_radius_m as f32,
        };
        let fitted = fitted(model, &measures);
        let (body, wheel) = (VehicleMesh::new(&fitted.body), VehicleMesh::new(&fitted.wheel));
        Build {
            far_body: fitted
                .far_body
                .map_or_else(|| body.simplified(COARSENESS_M), |parts| VehicleMesh::new(&parts)),
            far_wheel: fitted
                .far_wheel
                .map_or_else(|| wheel.simplified(COARSENESS_M / 2.0), |parts| VehicleMesh::new(&parts)),
            half_track_m: fitted.half_track.unwrap_or(d.track_m as f32 / 2.0),
            body,
            wheel,
        }
    }
}

impl Build {
    fn empty(d: &Dimensions) -> Self {
        let mesh = VehicleMesh::default;
        let half_track_m = d.track_m as f32 / 2.0;
        Self { body: mesh(), wheel: mesh(), far_body: mesh(), far_wheel: mesh(), half_track_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn dimensions(height_m: f64) -> Dimensions {
        Dimensions {
            length_m: 5.0,
            width_m: 2.5,
            height_m,
            wheelbase_m: 3.0,
            track_m: 2.1,
            wheel_radius_m: 0.35,
        }
    }

    const BODIES: [BodyType; 5] =
        [BodyType::Sedan, BodyType::Hatchback, BodyType::Suv, BodyType::Van, BodyType::Pickup];

    #[test]
    fn bodies_fill_their_outline_and_face_outwards() {
        for kind in BODIES {
            let d = dimensions(1.5);
            let build = Models::default().build(kind, &d);
            for mesh in [&build.body, &build.far_body] {
                let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
                for v in &mesh.vertices {
                    (low, high) = (low.min(v.position.into()), high.max(v.position.into()));
                }
                let top = (1.5 * kind.height_factor()) as f32;
                assert!((high.x - 2.5).abs() < 0.03 && (low.x + 2.5).abs() < 0.03, "{kind:?} {low} {high}");
                assert!((high.y - 1.25).abs() < 0.03 && (low.y + 1.25).abs() < 0.03, "{kind:?} {low} {high}");
                assert!((high.z - top).abs() < 0.06 && low.z > 0.05, "{kind:?} {low} {high}");
            }
        }
    }

    #[test]
    fn far_bodies_have_few_faces_and_every_lamp() {
        for kind in BODIES {
            let build = Models::default().build(kind, &dimensions(1.5));
            let faces = build.far_body.indices.len() / 3;
            assert!(
                faces < 420 && faces * 2 < build.body.indices.len() / 3,
                "{kind:?}: {faces} of {}",
                build.body.indices.len() / 3
            );
            for lamp in 3..=6 {
                assert!(
                    build.far_body.vertices.iter().any(|v| v.material == lamp),
                    "{kind:?} without {lamp}"
                );
            }
        }
    }
}
