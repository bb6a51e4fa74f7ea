//! Which model each body type has, and what of it goes to the GPU.

use super::VehicleMesh;
use crate::model::{Measures, Model, fitted, glb, shipped};
use crate::snapshot::{BodyType, Dimensions};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bodies without few faces of their own are simplified to within this.
const COARSENESS_M: f32 = 0.32;
/// Bodies of a few pixels are simplified to within this.
const COARSER_M: [f32; 2] = [0.5, 0.85];

/// How far the outline of a body of each level lies from the finest one's.
pub(in crate::render) const ERRORS_M: [f32; 5] = [0.0, 0.05, 0.12, 0.45, 0.75];

/// Models of body types; what is not among them is drawn as a sedan.
#[derive(Clone, Debug)]
pub(in crate::render) struct Models {
    models: BTreeMap<BodyType, Arc<Model>>,
}

/// Meshes of a vehicle to its measures.
#[derive(Clone, Debug)]
pub(in crate::render) struct Build {
    /// Body and wheel, the finest first; how far each may differ is in [`ERRORS_M`].
    pub(in crate::render) levels: Vec<(VehicleMesh, VehicleMesh)>,
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
        let far_body =
            fitted.far_body.map_or_else(|| body.simplified(COARSENESS_M), |parts| VehicleMesh::new(&parts));
        let far_wheel = fitted
            .far_wheel
            .map_or_else(|| wheel.simplified(COARSENESS_M / 2.0), |parts| VehicleMesh::new(&parts));
        let disc = far_wheel.simplified(COARSER_M[1] / 2.0);
        let coarser = COARSER_M.map(|edge_m| (far_body.simplified(edge_m), disc.clone()));
        let finer = [(body, wheel), (far_body.clone(), far_wheel), (far_body, disc)];
        Build {
            levels: finer.into_iter().chain(coarser).collect(),
            half_track_m: fitted.half_track.unwrap_or(d.track_m as f32 / 2.0),
        }
    }
}

impl Build {
    fn empty(d: &Dimensions) -> Self {
        Self { levels: Vec::new(), half_track_m: d.track_m as f32 / 2.0 }
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
            for mesh in [&build.levels[0].0, &build.levels[1].0] {
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
            let faces = build.levels[1].0.indices.len() / 3;
            assert!(
                faces < 420 && faces * 2 < build.levels[0].0.indices.len() / 3,
                "{kind:?}: {faces} of {}",
                build.levels[0].0.indices.len() / 3
            );
            for lamp in 3..=6 {
                assert!(
                    build.levels[1].0.vertices.iter().any(|v| v.material & 0xff == lamp),
                    "{kind:?} without {lamp}"
                );
            }
        }
    }
}
