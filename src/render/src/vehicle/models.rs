//! Models of body types, fitted to dimensions and simplified to levels of detail (LOD).

use super::{LampLens, VehicleMesh};
use city3d_models::{Measures, MeshPrimitive, Model, fitted, glb, shipped};
use city3d_protocol::snapshot::{BodyType, Dimensions};
use glam::Vec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Cell edges of vertex clustering for models without coarse meshes of their own; the second level includes the wheels.
const COARSENESS_M: [f32; 2] = [0.16, 0.4];
/// Least errors of the coarser levels: positions of lamps and windows.
const LEAST_ERRORS_M: [f32; 3] = [0.05, 0.12, 0.3];
/// What a camera behind the windscreen does not see of its own car: the inside of the roof and the doors, for it may be above
/// the lining of the roof.
const UNSEEN_FROM_INSIDE: &str = "lining";

/// Models of body types; others are drawn as a sedan.
#[derive(Clone, Debug)]
pub(crate) struct VehicleModels {
    models: BTreeMap<BodyType, Arc<Model>>,
}

/// Level of detail of a fitted vehicle.
#[derive(Clone, Debug)]
pub(crate) struct FittedLod {
    pub(crate) body: VehicleMesh,
    /// Empty if the body includes the wheels.
    pub(crate) wheel: VehicleMesh,
    /// Geometric error: largest distance of outline and features from those of the finest level, metres.
    pub(crate) error_m: f32,
}

/// Model fitted to the dimensions of a vehicle.
#[derive(Clone, Debug)]
pub(crate) struct FittedVehicle {
    /// Finer level for what is near, with an interior behind clear glass. Only for lighting per pixel.
    pub(crate) near: Option<FittedLod>,
    /// Levels of detail, the finest first.
    pub(crate) levels: Vec<FittedLod>,
    /// What a camera on the vehicle may see of its body: the near one without what lines the cabin, else the usual one.
    pub(crate) own_body: VehicleMesh,
    /// Lamps as light sources.
    pub(crate) lenses: Vec<LampLens>,
    /// From the centre line of the vehicle to the centre of a wheel.
    pub(crate) half_track_m: f32,
}

impl Default for VehicleModels {
    fn default() -> Self {
        // Tests make sure that the shipped files are readable.
        let load = |(name, body): (&str, BodyType)| {
            let bytes = shipped(&format!("{name}.glb"))?;
            Some((body, Arc::new(glb::read(bytes).ok()?)))
        };
        Self { models: BodyType::SHIPPED.into_iter().filter_map(load).collect() }
    }
}

impl VehicleModels {
    /// Sets the model of a body type.
    pub(crate) fn insert(&mut self, body: BodyType, model: Arc<Model>) {
        self.models.insert(body, model);
    }

    /// Fits the model of a body type to dimensions and makes its levels of detail.
    pub(crate) fn fit(&self, body: BodyType, d: &Dimensions) -> FittedVehicle {
        let Some(model) = self.models.get(&body).or_else(|| self.models.get(&BodyType::Sedan)) else {
            return FittedVehicle::empty(d);
        };
        let measures = Measures {
            length: d.length_m as f32,
            width: d.width_m as f32,
            height: body.height_m(d) as f32,
            wheelbase: d.wheelbase_m as f32,
            wheel_radius: d.wheel_radius_m as f32,
        };
        let fitted = fitted(model, &measures);
        let half_track_m = fitted.half_track.unwrap_or(d.track_m as f32 / 2.0);
        let (body, wheel) = (VehicleMesh::new(&fitted.body), VehicleMesh::new(&fitted.wheel));
        let axle_m = measures.wheelbase / 2.0;
        let whole = |body: &VehicleMesh, wheel: &VehicleMesh| {
            let mut whole = body.clone();
            for (x, side) in [(axle_m, 1.0), (axle_m, -1.0), (-axle_m, 1.0), (-axle_m, -1.0)] {
                let hub = Vec3::new(x, side * half_track_m, measures.wheel_radius);
                whole.append(wheel, hub, Vec3::new(side, side, 1.0));
            }
            whole
        };
        let finest = whole(&body, &wheel);
        let far_body = match &fitted.far_body {
            Some(parts) => VehicleMesh::new(parts),
            None => body.simplified(COARSENESS_M[0]),
        };
        let far_wheel = match &fitted.far_wheel {
            Some(parts) => VehicleMesh::new(parts),
            None => wheel.simplified(COARSENESS_M[0]),
        };
        let farther = match &fitted.farther_body {
            Some(parts) => VehicleMesh::new(parts),
            None => finest.simplified(COARSENESS_M[1]),
        };
        let near = fitted.near_body.as_ref().map(|parts| {
            let near_wheel = fitted.near_wheel.as_deref().map(VehicleMesh::new);
            let wheel = near_wheel.unwrap_or_else(|| wheel.clone());
            FittedLod { body: VehicleMesh::new(parts), wheel, error_m: 0.0 }
        });
        let own_body = match &fitted.near_body {
            Some(parts) => {
                let is_seen = |part: &&MeshPrimitive| part.material.name != UNSEEN_FROM_INSIDE;
                VehicleMesh::new(parts.iter().filter(is_seen))
            }
            None => body.clone(),
        };
        let lenses = body.lenses();
        let mut levels = vec![FittedLod { body, wheel, error_m: 0.0 }];
        let mut coarser = vec![(far_body, far_wheel), (farther, VehicleMesh::default())];
        coarser.extend(
            fitted.distant_body.as_ref().map(|parts| (VehicleMesh::new(parts), VehicleMesh::default())),
        );
        for ((body, wheel), least_m) in coarser.into_iter().zip(LEAST_ERRORS_M) {
            let before_m = levels.last().map_or(0.0, |level| level.error_m);
            let error_m = finest.outline_apart(&whole(&body, &wheel)).max(least_m).max(before_m);
            levels.push(FittedLod { body, wheel, error_m });
        }
        FittedVehicle { near, levels, own_body, lenses, half_track_m }
    }
}

impl FittedVehicle {
    fn empty(d: &Dimensions) -> Self {
        Self {
            near: None,
            levels: Vec::new(),
            own_body: VehicleMesh::default(),
            lenses: Vec::new(),
            half_track_m: d.track_m as f32 / 2.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{MOST_LENSES, VehiclePart};
    use super::*;
    use city3d_models::ModelNode;
    use glam::{Affine3A, DVec3};

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

    /// Each body with dimensions of its kind.
    fn bodies() -> impl Iterator<Item = (BodyType, Dimensions)> {
        let length = |body| match body {
            BodyType::Bus => [11.0, 2.9, 5.6, 0.48],
            BodyType::Truck => [6.9, 2.5, 3.9, 0.4],
            _ => [5.0, 2.5, 3.0, 0.35],
        };
        BodyType::SHIPPED.into_iter().map(move |(_, body)| {
            let [length_m, width_m, wheelbase_m, wheel_radius_m] = length(body);
            (body, Dimensions { length_m, width_m, wheelbase_m, wheel_radius_m, ..dimensions(1.5) })
        })
    }

    #[test]
    fn bodies_fill_their_outline_and_face_outwards() {
        for (kind, d) in bodies() {
            let fitted = VehicleModels::default().fit(kind, &d);
            for mesh in fitted.levels[..2].iter().map(|level| &level.body) {
                let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
                for v in &mesh.vertices {
                    (low, high) = (low.min(v.position.into()), high.max(v.position.into()));
                }
                let top = kind.height_m(&d) as f32;
                let [x, y] = [d.length_m, d.width_m].map(|m| m as f32 / 2.0);
                assert!((high.x - x).abs() < 0.03 && (low.x + x).abs() < 0.03, "{kind:?} {low} {high}");
                assert!((high.y - y).abs() < 0.03 && (low.y + y).abs() < 0.03, "{kind:?} {low} {high}");
                assert!((high.z - top).abs() < 0.06 && low.z > 0.05, "{kind:?} {low} {high}");
            }
        }
    }

    /// Triangles of a vehicle with its wheels.
    fn faces(level: &FittedLod) -> usize {
        (level.body.indices.len() + 4 * level.wheel.indices.len()) / 3
    }

    fn has(level: &FittedLod, part: VehiclePart) -> bool {
        level.body.indices.iter().any(|&k| level.body.vertices[k as usize].material & 0xff == part as u32)
    }

    const LAMPS: [VehiclePart; 4] =
        [VehiclePart::Head, VehiclePart::Tail, VehiclePart::IndicatorLeft, VehiclePart::IndicatorRight];

    #[test]
    fn far_bodies_have_few_faces_and_every_lamp() {
        for (kind, d) in bodies() {
            let fitted = VehicleModels::default().fit(kind, &d);
            let counts: Vec<usize> = fitted.levels.iter().map(faces).collect();
            let errors: Vec<f32> = fitted.levels.iter().map(|level| level.error_m).collect();
            assert_eq!(counts.len(), 4, "{kind:?}");
            let body = fitted.levels[1].body.indices.len() / 3;
            assert!(body < 420 && counts[1] * 2 < counts[0] && counts[2] < 160, "{kind:?}: {counts:?}");
            assert!(counts[3] < 60, "{kind:?}: {counts:?}");
            assert!(errors[1] < 0.08 && errors[2] < 0.25 && errors[3] < 0.4, "{kind:?}: {errors:?}");
            for level in &fitted.levels {
                for lamp in LAMPS {
                    assert!(has(level, lamp), "{kind:?} without {lamp:?} at {} m", level.error_m);
                }
            }
        }
    }

    /// From behind the windscreen nothing is in the way but the bonnet.
    #[test]
    fn the_windscreen_camera_is_behind_the_glass() {
        for (kind, d) in bodies() {
            let fitted = VehicleModels::default().fit(kind, &d);
            let [ahead, up] = kind.windscreen_shares();
            let eye = DVec3::new(ahead * d.length_m, 0.0, up * kind.height_m(&d)).as_vec3();
            let mesh = &fitted.levels[0].body;
            let corner = |k: u32| Vec3::from(mesh.vertices[k as usize].position);
            for t in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(corner);
                let faces_eye = (b - a).cross(c - a).dot(eye - a) > 0.0;
                let is_glass = mesh.vertices[t[0] as usize].material & 0xff == VehiclePart::Glass as u32;
                assert!(!(faces_eye && is_glass), "{kind:?}: glass at {a} faces the camera at {eye}");
            }
        }
    }

    /// Dashboard and wipers are seen from behind the windscreen, the lining of the roof is not.
    #[test]
    fn the_own_body_is_the_near_one_without_lining() {
        let faces = |mesh: &VehicleMesh| mesh.indices.len() / 3;
        for (kind, d) in bodies() {
            let models = VehicleModels::default();
            let fitted = models.fit(kind, &d);
            let near = fitted.near.expect("every shipped body has one");
            let model = &models.models[&kind];
            let node = model.node("near_body").unwrap();
            let [lined, wipers] = [UNSEEN_FROM_INSIDE, "wiper"].map(|name| {
                let parts = model.parts(node).iter().filter(|part| part.material.name == name);
                parts.map(|part| part.indices.len() / 3).sum::<usize>()
            });
            let told = format!("{kind:?}: {lined} and {wipers}");
            assert!(lined > 100 && wipers >= 8, "{told}");
            assert!(faces(&fitted.own_body) + lined == faces(&near.body), "{told}");
        }
    }

    /// A model of a user's need not have anything for a distance.
    #[test]
    fn lamps_outlast_simplification() {
        for (kind, d) in bodies() {
            let mut models = VehicleModels::default();
            let mut model = Model::clone(&models.models[&kind]);
            model.nodes.retain(|node| !city3d_models::is_other_lod(node));
            models.insert(kind, Arc::new(model));
            let fitted = models.fit(kind, &d);
            let counts: Vec<usize> = fitted.levels.iter().map(faces).collect();
            assert!(counts.len() == 3 && counts.is_sorted_by(|a, b| a > b), "{kind:?}: {counts:?}");
            for level in &fitted.levels {
                for lamp in LAMPS {
                    assert!(has(level, lamp), "{kind:?} without {lamp:?} at {} m", level.error_m);
                }
            }
        }
    }

    #[test]
    fn a_car_of_thousands_of_lamps_is_fitted() {
        let mut model = Model::default();
        let sedan = VehicleModels::default().models[&BodyType::Sedan].clone();
        let is_head = |part: &&MeshPrimitive| part.material.name == "head";
        let lamp = sedan.meshes.iter().flatten().find(is_head).unwrap().clone();
        model.meshes.push(vec![lamp]);
        model.nodes = (0..5000)
            .map(|k| ModelNode {
                name: format!("lamp_{k}"),
                mesh: 0,
                model_from_mesh: Affine3A::from_translation(Vec3::new(0.01 * k as f32, 0.0, 0.0)),
            })
            .collect();
        let mut models = VehicleModels::default();
        models.insert(BodyType::Own(0), Arc::new(model));
        let fitted = models.fit(BodyType::Own(0), &dimensions(1.5));
        assert_eq!(fitted.lenses.len(), MOST_LENSES);
    }
}
