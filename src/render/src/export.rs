//! What another renderer needs to draw the same city: the light of an hour, the textures of surfaces, the triangles of
//! vehicles.

use super::Settings;
use super::fleet::wheels;
use super::textures::surface_texels;
use super::vehicle::{VehicleMesh, VehicleModels, VehiclePart};
use city3d_models::Model;
use city3d_models::glb::linear_from_srgb;
use city3d_protocol::snapshot::{BodyType, FrameSnapshot};
use glam::{Mat3, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Albedo of the whitest paint of a vehicle, as in `shaders/vehicle.wgsl`.
const PAINT_REFLECTS: f32 = 0.80;
/// Roughness of the clear coat over paint and of the covers of lamps, as in `shaders/light.wgsl`.
pub const LACQUER: f32 = 0.08;
/// Share of light that the cabin adds to window glass, as in `shaders/vehicle.wgsl`.
const CABIN: f32 = 0.02;

/// Light of an hour, as the shaders get it. Radiance of a white, matt surface unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneLight {
    /// Unit vector towards the sun, city frame.
    pub to_sun: Vec3,
    /// Of a surface that faces the sun, by the sun alone.
    pub sun: [f32; 3],
    /// Of level ground that sees the whole sky, by the sky alone.
    pub sky: [f32; 3],
    /// Factor on radiance before tone mapping.
    pub exposure: f32,
}

impl SceneLight {
    /// The light for these settings.
    pub fn new(settings: &Settings) -> Self {
        let light = settings.light();
        Self { to_sun: light.to_sun, sun: light.sun, sky: light.sky, exposure: light.exposure }
    }
}

/// Texture of a surface: the pattern that multiplies its colour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurfaceTexture {
    /// Texels along an edge.
    pub edge: u32,
    /// Red, green and blue in sRGB, and roughness from 0 to 255; row by row with v growing.
    pub rgba: Vec<u8>,
}

impl SurfaceTexture {
    /// The texture of a [`city3d_scene::Surface`] by its number.
    pub fn new(surface: u8) -> Self {
        let (edge, rgba) = surface_texels(surface);
        Self { edge, rgba }
    }
}

/// Corner of a triangle of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleVertex {
    /// City frame, metres.
    pub position: Vec3,
    /// Unit vector out of the surface.
    pub normal: Vec3,
    /// Linear light; of metal the reflectance at normal incidence.
    pub albedo: [f32; 3],
    /// 0 mirror-like to 1 matt.
    pub roughness: f32,
    /// 1 for bare metal.
    pub metallic: f32,
}

/// Triangles of all vehicles of a snapshot at the usual level of detail, three vertices each. `models` replace the
/// shipped ones.
pub fn vehicle_triangles(
    snapshot: &FrameSnapshot,
    models: &BTreeMap<BodyType, Arc<Model>>,
) -> Vec<VehicleVertex> {
    let mut known = VehicleModels::default();
    models.iter().for_each(|(&body, model)| known.insert(body, Arc::clone(model)));
    let mut triangles = Vec::new();
    for (state, info) in snapshot.iter() {
        let fitted = known.fit(info.appearance.body, &info.dimensions);
        let Some(usual) = fitted.levels.first() else { continue };
        let paint = info.appearance.colour.map(|channel| linear_from_srgb(channel) * PAINT_REFLECTS);
        let (turn, at) = (Mat3::from_quat(state.orientation.as_quat()), state.position.as_vec3());
        append(&mut triangles, &usual.body, paint, (turn, at));
        for [x, y, z] in wheels(state, info, fitted.half_track_m) {
            let turn = Mat3::from_cols_array_2d(&[0, 1, 2].map(|k| [x[k], y[k], z[k]]));
            append(&mut triangles, &usual.wheel, paint, (turn, Vec3::new(x[3], y[3], z[3])));
        }
    }
    triangles
}

/// Appends a mesh of a vehicle with this paint, turned and moved.
fn append(triangles: &mut Vec<VehicleVertex>, mesh: &VehicleMesh, paint: [f32; 3], (turn, at): (Mat3, Vec3)) {
    triangles.extend(mesh.indices.iter().map(|&k| {
        let vertex = &mesh.vertices[k as usize];
        let [part, roughness, metallic, _] = vertex.material.to_le_bytes();
        let part = u32::from(part);
        let is_lacquered =
            part == VehiclePart::Paint as u32 || VehiclePart::LAMPS.iter().any(|&lamp| lamp as u32 == part);
        let [r, g, b, _] = vertex.colour;
        let own = [r, g, b].map(linear_from_srgb);
        let albedo = [0, 1, 2].map(|channel| match part {
            p if p == VehiclePart::Paint as u32 => own[channel] * paint[channel],
            p if p == VehiclePart::Glass as u32 => own[channel] + CABIN,
            _ => own[channel],
        });
        let [x, y, z, _] = vertex.normal.map(f32::from);
        VehicleVertex {
            position: turn * Vec3::from(vertex.position) + at,
            normal: (turn * Vec3::new(x, y, z)).normalize_or(Vec3::Z),
            albedo,
            roughness: if is_lacquered { LACQUER } else { f32::from(roughness) / 255.0 },
            metallic: f32::from(metallic) / 255.0,
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_those_of_the_shaders() {
        let vehicle = include_str!("../../../shaders/vehicle.wgsl");
        let light = include_str!("../../../shaders/light.wgsl");
        assert!(vehicle.contains(&format!("const PAINT_REFLECTS: f32 = {PAINT_REFLECTS:.2};")));
        assert!(vehicle.contains(&format!("select(0.0, {CABIN:.2}, part == GLASS)")));
        assert!(light.contains(&format!("const LACQUER: f32 = {LACQUER:.2};")));
    }
}
