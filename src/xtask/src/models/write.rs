//! Writes models as deterministic GLB files.

use city3d_models::glb::linear_from_srgb;
use city3d_models::{Material, MeshPrimitive, Model};
use glam::{Mat3, Quat, Vec3};
use serde_json::{Value, json};

const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Files have y up and z forward (Khronos, glTF 2.0, section 3.4); models have z up and x forward.
fn to_file(v: Vec3) -> [f32; 3] {
    [v.y, v.z, v.x]
}

#[derive(Default)]
struct GlbWriter {
    blob: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Material>,
}

/// Rounded to a thousandth of a millimetre, so that last digits do not differ between machines.
fn rounded(value: f32) -> f32 {
    let value = (f64::from(value) * 1e6).round() / 1e6;
    // No negative zero.
    value as f32 + 0.0
}

impl GlbWriter {
    fn accessor(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        let offset = self.blob.len();
        self.blob.extend_from_slice(bytes);
        while !self.blob.len().is_multiple_of(4) {
            self.blob.push(0);
        }
        self.views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": bytes.len(), "target": target
        }));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn vectors(&mut self, vectors: &[Vec3], with_bounds: bool) -> usize {
        let numbers: Vec<[f32; 3]> = vectors.iter().map(|&v| to_file(v).map(rounded)).collect();
        let bytes: Vec<u8> = numbers.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let mut accessor = json!({ "componentType": FLOAT, "count": vectors.len(), "type": "VEC3" });
        if with_bounds {
            let bound = |pick: fn(f32, f32) -> f32, start: f32| -> [f32; 3] {
                std::array::from_fn(|axis| numbers.iter().map(|v| v[axis]).fold(start, pick))
            };
            accessor["min"] = json!(bound(f32::min, f32::INFINITY));
            accessor["max"] = json!(bound(f32::max, f32::NEG_INFINITY));
        }
        self.accessor(&bytes, ARRAY_BUFFER, accessor)
    }

    fn primitive(&mut self, part: &MeshPrimitive) -> Value {
        let count = part.vertices.len();
        let positions: Vec<Vec3> = part.vertices.iter().map(|v| v.position).collect();
        let normals: Vec<Vec3> = part.vertices.iter().map(|v| v.normal).collect();
        let shades: Vec<u8> =
            part.vertices.iter().flat_map(|v| [v.openness, v.openness, v.openness, 255]).collect();
        let position = self.vectors(&positions, true);
        let normal = self.vectors(&normals, false);
        let shade =
            json!({ "componentType": UNSIGNED_BYTE, "normalized": true, "count": count, "type": "VEC4" });
        let shade = self.accessor(&shades, ARRAY_BUFFER, shade);
        let mut attributes = json!({ "POSITION": position, "NORMAL": normal, "COLOR_0": shade });
        if part.vertices.iter().any(|v| v.uv != glam::Vec2::ZERO) {
            let bytes: Vec<u8> = part
                .vertices
                .iter()
                .flat_map(|v| v.uv.to_array())
                .flat_map(|x| rounded(x).to_le_bytes())
                .collect();
            let accessor = json!({ "componentType": FLOAT, "count": count, "type": "VEC2" });
            attributes["TEXCOORD_0"] = json!(self.accessor(&bytes, ARRAY_BUFFER, accessor));
        }
        let (bytes, component): (Vec<u8>, u32) = if count <= usize::from(u16::MAX) {
            (part.indices.iter().flat_map(|&k| (k as u16).to_le_bytes()).collect(), UNSIGNED_SHORT)
        } else {
            (part.indices.iter().flat_map(|k| k.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        let accessor = json!({ "componentType": component, "count": part.indices.len(), "type": "SCALAR" });
        let indices = self.accessor(&bytes, ELEMENT_ARRAY_BUFFER, accessor);
        let known = self.materials.iter().position(|known| *known == part.material);
        let material = known.unwrap_or_else(|| {
            self.materials.push(part.material.clone());
            self.materials.len() - 1
        });
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }
}

fn material(material: &Material) -> Value {
    let [r, g, b] = material.colour.map(|c| rounded(linear_from_srgb(c)));
    json!({
        "name": material.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    })
}

/// Encodes a model. Scale and shear of nodes are dropped: the project's models have none.
pub fn write(model: &Model) -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let meshes: Vec<Value> = model
        .meshes
        .iter()
        .enumerate()
        .map(|(index, parts)| {
            let user = model.nodes.iter().find(|node| node.mesh == index);
            let name = user.map_or_else(|| format!("mesh_{index}"), |node| node.name.clone());
            let primitives: Vec<Value> = parts.iter().map(|part| writer.primitive(part)).collect();
            json!({ "name": name, "primitives": primitives })
        })
        .collect();
    let nodes: Vec<Value> = model
        .nodes
        .iter()
        .map(|node| {
            let mut value = json!({ "name": node.name, "mesh": node.mesh });
            let translation: Vec3 = node.model_from_mesh.translation.into();
            if translation != Vec3::ZERO {
                value["translation"] = json!(to_file(translation).map(rounded));
            }
            let turn = Quat::from_mat3(&Mat3::from(node.model_from_mesh.matrix3));
            if turn.angle_between(Quat::IDENTITY) > 1e-4 {
                let [x, y, z] = to_file(Vec3::new(turn.x, turn.y, turn.z)).map(rounded);
                value["rotation"] = json!([x, y, z, rounded(turn.w)]);
            }
            value
        })
        .collect();
    let document = json!({
        "asset": { "version": "2.0", "generator": "city3d generate models" },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": writer.materials.iter().map(material).collect::<Vec<_>>(),
        "accessors": writer.accessors,
        "bufferViews": writer.views,
        "buffers": [{ "byteLength": writer.blob.len() }],
    });
    let mut text = document.to_string().into_bytes();
    while !text.len().is_multiple_of(4) {
        text.push(b' ');
    }
    let total = 12 + 8 + text.len() + 8 + writer.blob.len();
    let mut bytes = Vec::with_capacity(total);
    bytes.extend(b"glTF");
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend((writer.blob.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(writer.blob);
    bytes
}
