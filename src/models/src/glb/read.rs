//! Reads GLB files: nodes with triangles, and materials by name and plain colour.

use super::accessor::{AccessorSpec, numbers};
use super::{MOST_TRIANGLES, MOST_VERTICES, from_file, srgb_from_linear};
use crate::{Material, MeshPrimitive, Model, ModelNode, ModelVertex};
use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3};
use gltf::mesh::{Mode, Semantic};
use thiserror::Error;

/// Largest distance from the origin: more is likely a wrong unit.
const FARTHEST_M: f32 = 1000.0;
/// Largest nesting depth of nodes.
const DEEPEST: usize = 64;
/// Most objects and elements of lists in the JSON chunk: some of few bytes take much memory.
const MOST_VALUES: usize = 2_000_000;

/// An unusable model file: place, finding and remedy.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{place}: {message}; {remedy}")]
pub struct ModelError {
    /// Place in the file: header, chunk, mesh, accessor or node.
    pub place: String,
    /// What is wrong there.
    pub message: String,
    /// What makes the file usable.
    pub remedy: &'static str,
}

fn fault(place: &str, message: impl Into<String>, remedy: &'static str) -> ModelError {
    ModelError { place: place.to_owned(), message: message.into(), remedy }
}

const DAMAGED: &str = "the file is damaged or cut off: export it again";
const SIMPLIFY: &str = "simplify the meshes";

/// The JSON and the binary chunk of a file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), ModelError> {
    let word =
        |at: usize| -> Option<u32> { Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    if !bytes.starts_with(b"glTF") {
        let what = if bytes.starts_with(b"{") { "glTF as text" } else { "not a glTF binary file" };
        return Err(fault("header", what, "save as .glb, with everything in one file"));
    }
    if word(4) != Some(2) {
        let message = word(4).map_or("cut off".to_owned(), |version| format!("glTF of version {version}"));
        return Err(fault("header", message, "export as glTF 2.0"));
    }
    let length = word(8).map_or(0, |length| length as usize);
    if length < 20 || length > bytes.len() {
        let message = format!("it states {length} bytes, the file has {}", bytes.len());
        return Err(fault("header", message, DAMAGED));
    }
    let chunk = |at: usize, kind: &[u8; 4]| -> Option<(&[u8], usize)> {
        let size = word(at)? as usize;
        let body = at.checked_add(8)?;
        let end = body.checked_add(size).filter(|&end| end <= length)?;
        (bytes.get(at + 4..body)? == kind).then(|| (&bytes[body..end], end))
    };
    let Some((text, end)) = chunk(12, b"JSON") else {
        return Err(fault("JSON chunk", "it is missing or longer than the file", DAMAGED));
    };
    if end >= length {
        return Ok((text, &[]));
    }
    match chunk(end, b"BIN\0") {
        Some((blob, _)) => Ok((text, blob)),
        None => Err(fault("BIN chunk", "it is missing or longer than the file", DAMAGED)),
    }
}

/// Reads a model.
///
/// # Errors
/// [`ModelError`] if the bytes are no usable GLB file.
pub fn read(bytes: &[u8]) -> Result<Model, ModelError> {
    let (text, blob) = chunks(bytes)?;
    let values = text.iter().filter(|&&byte| matches!(byte, b'{' | b',')).count();
    if values > MOST_VALUES {
        let message = format!("{values} values; at most {MOST_VALUES} are read");
        return Err(fault("JSON chunk", message, "join meshes and nodes before exporting"));
    }
    let json: gltf::json::Root = gltf::json::deserialize::from_slice(text)
        .map_err(|error| fault("JSON chunk", error.to_string(), DAMAGED))?;
    // The crate's validation reads this accessor before it checks that it exists.
    for (index, mesh) in json.meshes.iter().enumerate() {
        for wrong in mesh.primitives.iter().flat_map(|p| p.attributes.values()) {
            if wrong.value() >= json.accessors.len() {
                let message = format!("accessor {} of {}", wrong.value(), json.accessors.len());
                return Err(fault(&format!("mesh {index}, attributes"), message, DAMAGED));
            }
        }
    }
    let document = gltf::Document::from_json(json).map_err(|error| match error {
        gltf::Error::Validation(faults) => {
            let (place, message) = faults.first().map_or((String::new(), String::new()), |(path, error)| {
                (path.to_string(), error.to_string())
            });
            let remedy = if message.contains("nsupported") || place.contains("extensionsRequired") {
                "export without compression and extensions"
            } else {
                DAMAGED
            };
            fault(&place, message, remedy)
        }
        other => fault("JSON chunk", other.to_string(), DAMAGED),
    })?;
    let mut size = MeshSize::default();
    let meshes = document.meshes().map(|mesh| parts(&mesh, blob, &mut size));
    let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
    let mut scene_reader = SceneReader {
        most: document.nodes().count(),
        model: Model { meshes, nodes: Vec::new() },
        size: MeshSize::default(),
    };
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots: Vec<gltf::Node<'_>> = match scene {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().collect(),
    };
    for root in roots {
        scene_reader.add(&root, Mat4::IDENTITY, 0)?;
    }
    let model = scene_reader.model;
    let farthest = model.bounds(|_| true).map(|[low, high]| low.abs().max(high.abs()).max_element());
    match farthest.filter(|_| model.triangle_count() > 0) {
        None => Err(fault("scene", "it shows no triangles", "export at least one mesh")),
        Some(far) if !far.is_finite() || far > FARTHEST_M => {
            let message = format!("it reaches {far:.0} m from its origin");
            Err(fault("scene", message, "model in metres, near the origin"))
        }
        Some(_) => Ok(model),
    }
}

/// Vertices and triangles that were counted so far.
#[derive(Clone, Copy, Debug, Default)]
struct MeshSize {
    vertices: usize,
    indices: usize,
}

impl MeshSize {
    /// Counts further ones; the reason where they are too many.
    fn add(&mut self, vertices: usize, indices: usize) -> Result<(), String> {
        self.vertices = self.vertices.saturating_add(vertices);
        self.indices = self.indices.saturating_add(indices);
        let triangles = self.indices.div_ceil(3);
        if self.vertices > MOST_VERTICES {
            return Err(format!(
                "{} vertices up to here; a model has at most {MOST_VERTICES}",
                self.vertices
            ));
        }
        if triangles > MOST_TRIANGLES {
            return Err(format!("{triangles} triangles up to here; a model has at most {MOST_TRIANGLES}"));
        }
        Ok(())
    }
}

/// Adds nodes to a model.
struct SceneReader {
    model: Model,
    /// Nodes of the file.
    most: usize,
    /// That of all nodes added.
    size: MeshSize,
}

impl SceneReader {
    /// Adds a node and its descendants.
    fn add(&mut self, node: &gltf::Node<'_>, parent: Mat4, depth: usize) -> Result<(), ModelError> {
        let place = || format!("node {} ({})", node.index(), node.name().unwrap_or("without a name"));
        // Cyclic nodes would never end, and shared ones could take exponential time.
        if depth > DEEPEST || self.model.nodes.len() > self.most {
            return Err(fault(&place(), "the nodes form a cycle", DAMAGED));
        }
        let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        if !here.is_finite() {
            return Err(fault(&place(), "its transform is not finite", DAMAGED));
        }
        if let Some(mesh) = node.mesh() {
            for part in self.model.meshes.get(mesh.index()).into_iter().flatten() {
                let counted = self.size.add(part.vertices.len(), part.indices.len());
                counted.map_err(|message| fault(&place(), message, SIMPLIFY))?;
            }
            self.model.nodes.push(
                shown_mesh(node, mesh.index(), here)
                    .ok_or_else(|| fault(&place(), "its scale is 0", "apply the scale before exporting"))?,
            );
        }
        for child in node.children() {
            self.add(&child, here, depth + 1)?;
        }
        Ok(())
    }
}

/// The node that shows a mesh with a transform; `None` for a transform without volume.
fn shown_mesh(node: &gltf::Node<'_>, mesh: usize, here: Mat4) -> Option<ModelNode> {
    // Converts axes on both sides of the transform.
    let axes = Mat3::from_cols(Vec3::Y, Vec3::Z, Vec3::X);
    let linear = axes * Mat3::from_mat4(here) * axes.transpose();
    let translation = from_file(here.w_axis.truncate().to_array());
    (linear.determinant().abs() >= 1e-12).then(|| ModelNode {
        name: node.name().map_or_else(|| format!("node_{}", node.index()), str::to_owned),
        mesh,
        model_from_mesh: Affine3A::from_mat3_translation(linear, translation),
    })
}

fn parts(mesh: &gltf::Mesh<'_>, blob: &[u8], size: &mut MeshSize) -> Result<Vec<MeshPrimitive>, ModelError> {
    mesh.primitives()
        .map(|primitive| {
            part(&primitive, blob, size).map_err(|error| ModelError {
                place: format!(
                    "mesh {} ({}), primitive {}: {}",
                    mesh.index(),
                    mesh.name().unwrap_or("without a name"),
                    primitive.index(),
                    error.place
                ),
                ..error
            })
        })
        .collect()
}

fn part(
    primitive: &gltf::Primitive<'_>,
    blob: &[u8],
    size: &mut MeshSize,
) -> Result<MeshPrimitive, ModelError> {
    if primitive.mode() != Mode::Triangles {
        let message = format!("it is made of {:?}", primitive.mode());
        return Err(fault("mode", message, "export triangles"));
    }
    let attribute = |semantic: Semantic| primitive.get(&semantic);
    let Some(positions) = attribute(Semantic::Positions) else {
        return Err(fault("attributes", "POSITION is missing", "export positions"));
    };
    let [normals, colours, uvs] =
        [Semantic::Normals, Semantic::Colors(0), Semantic::TexCoords(0)].map(attribute);
    for (what, accessor) in [("NORMAL", &normals), ("COLOR_0", &colours), ("TEXCOORD_0", &uvs)] {
        if let Some(count) = accessor.as_ref().map(gltf::Accessor::count)
            && count != positions.count()
        {
            let message = format!("{} positions and {count} of {what}", positions.count());
            return Err(fault("attributes", message, DAMAGED));
        }
    }
    let corners = primitive.indices().map_or(positions.count(), |indices| indices.count());
    // Without normals each corner becomes a vertex.
    let vertices = if normals.is_some() { positions.count() } else { positions.count().max(corners) };
    size.add(vertices, corners).map_err(|message| fault("attributes", message, SIMPLIFY))?;
    let wanted =
        |what, least, most, whole_are_parts| AccessorSpec { what, numbers: [least, most], whole_are_parts };
    let positions = numbers::<3>(&positions, blob, wanted("POSITION", 3, 3, positions.normalized()))?;
    let of = |accessor: Option<gltf::Accessor<'_>>, what, least, most| {
        accessor.map(|a| numbers::<3>(&a, blob, wanted(what, least, most, true))).transpose()
    };
    let normals = of(normals, "NORMAL", 3, 3)?;
    let colours = of(colours, "COLOR_0", 3, 4)?;
    let uvs = of(uvs, "TEXCOORD_0", 2, 2)?;
    let indices: Vec<u32> = match primitive.indices() {
        // Whole numbers below 2^24 are exact as floats.
        Some(accessor) => numbers::<1>(&accessor, blob, wanted("indices", 1, 1, false))?
            .into_iter()
            .map(|[k]| k as u32)
            .collect(),
        None => (0..positions.len() as u32).collect(),
    };
    if !indices.len().is_multiple_of(3) {
        return Err(fault("indices", format!("{} of them make no triangles", indices.len()), DAMAGED));
    }
    if let Some(wrong) = indices.iter().find(|&&k| k as usize >= positions.len()) {
        let message = format!("vertex {wrong} of {}", positions.len());
        return Err(fault("indices", message, DAMAGED));
    }
    let vertex = |k: usize| ModelVertex {
        position: from_file(positions[k]),
        normal: normals.as_ref().map_or(Vec3::ZERO, |list| from_file(list[k]).normalize_or(Vec3::Z)),
        uv: uvs.as_ref().map_or(Vec2::ZERO, |list| Vec2::new(list[k][0], list[k][1])),
        openness: colours.as_ref().map_or(255, |list| {
            let [r, g, b] = list[k];
            ((0.21 * r + 0.72 * g + 0.07 * b).clamp(0.0, 1.0) * 255.0).round() as u8
        }),
    };
    let vertices: Vec<ModelVertex> = (0..positions.len()).map(vertex).collect();
    let mut part = MeshPrimitive { material: material(&primitive.material()), vertices, indices };
    if normals.is_none() {
        flatten(&mut part);
    }
    Ok(part)
}

/// Flat shading for files without normals.
fn flatten(part: &mut MeshPrimitive) {
    let mut vertices = Vec::with_capacity(part.indices.len());
    for corners in part.indices.chunks_exact(3) {
        let [a, b, c] = [corners[0], corners[1], corners[2]].map(|k| part.vertices[k as usize]);
        let normal = (b.position - a.position).cross(c.position - a.position).normalize_or(Vec3::Z);
        vertices.extend([a, b, c].map(|v| ModelVertex { normal, ..v }));
    }
    part.indices = (0..vertices.len() as u32).collect();
    part.vertices = vertices;
}

fn material(material: &gltf::Material<'_>) -> Material {
    let pbr = material.pbr_metallic_roughness();
    let [r, g, b, _] = pbr.base_color_factor();
    Material {
        name: material.name().unwrap_or_default().to_owned(),
        colour: [r, g, b].map(srgb_from_linear),
        metallic: pbr.metallic_factor(),
        roughness: pbr.roughness_factor(),
    }
}
