//! Models made in code, and the writer of their files: cars and street furniture.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod car;
mod street;
mod write;

pub use write::write;

use city3d_models::{Material, MeshPrimitive, Model, ModelVertex};
use glam::{Vec2, Vec3};

/// All models by file name.
pub fn made() -> Vec<(String, Model)> {
    let cars = [car::SEDAN, car::HATCHBACK, car::SUV, car::VAN, car::PICKUP, car::TAXI, car::ESTATE];
    let cars = cars.iter().map(|shape| (format!("{}.glb", shape.name), car::model(shape)));
    let heavy = [car::BUS, car::TRUCK];
    let heavy = heavy.iter().map(|shape| (format!("{}.glb", shape.name), car::heavy_model(shape)));
    let street = street::models().into_iter().map(|(name, model)| (name.to_owned(), model));
    cars.chain(heavy).chain(street).collect()
}

/// A constant material for faces made in code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticMaterial {
    pub name: &'static str,
    pub colour: [u8; 3],
    pub metallic: f32,
    pub roughness: f32,
}

impl StaticMaterial {
    pub const fn new(name: &'static str, colour: [u8; 3]) -> Self {
        Self { name, colour, metallic: 0.0, roughness: 0.9 }
    }

    pub const fn rough(self, roughness: f32) -> Self {
        Self { roughness, ..self }
    }

    pub const fn metal(self) -> Self {
        Self { metallic: 1.0, ..self }
    }
}

/// Builds mesh primitives, one per material.
#[derive(Clone, Debug, Default)]
pub struct PrimitiveBuilder {
    parts: Vec<MeshPrimitive>,
}

impl PrimitiveBuilder {
    pub fn finish(self) -> Vec<MeshPrimitive> {
        self.parts
    }

    fn part(&mut self, face_material: StaticMaterial) -> &mut MeshPrimitive {
        let known = self.parts.iter().position(|part| part.material.name == face_material.name);
        let index = known.unwrap_or_else(|| {
            let StaticMaterial { name, colour, metallic, roughness } = face_material;
            let material = Material { name: name.to_owned(), colour, metallic, roughness };
            self.parts.push(MeshPrimitive { material, vertices: Vec::new(), indices: Vec::new() });
            self.parts.len() - 1
        });
        &mut self.parts[index]
    }

    pub fn vertex(
        &mut self,
        face_material: StaticMaterial,
        position: Vec3,
        normal: Vec3,
        openness: u8,
    ) -> u32 {
        let part = self.part(face_material);
        part.vertices.push(ModelVertex { position, normal, uv: Vec2::ZERO, openness });
        part.vertices.len() as u32 - 1
    }

    pub fn triangle(&mut self, face_material: StaticMaterial, corners: [u32; 3]) {
        self.part(face_material).indices.extend(corners);
    }

    /// Adds a flat convex face, corners counter-clockwise seen from outside.
    pub fn plate(&mut self, corners: &[Vec3], face_material: StaticMaterial, openness: u8) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        let first = corners.iter().map(|&corner| self.vertex(face_material, corner, normal, openness)).min();
        for k in 2..corners.len() as u32 {
            let base = first.unwrap_or_default();
            self.triangle(face_material, [base, base + k - 1, base + k]);
        }
    }

    /// Adds a flat face like [`Self::plate`], with texture coordinates.
    pub fn mapped_plate(&mut self, corners: [(Vec3, Vec2); 4], face_material: StaticMaterial, openness: u8) {
        self.plate(&corners.map(|(position, _)| position), face_material, openness);
        let added = self.part(face_material).vertices.iter_mut().rev().take(corners.len());
        added.zip(corners.iter().rev()).for_each(|(vertex, (_, uv))| vertex.uv = *uv);
    }

    /// Adds a closed box.
    pub fn block(&mut self, low: Vec3, high: Vec3, face_material: StaticMaterial, openness: u8) {
        let at = |k: usize| {
            Vec3::new(
                if k & 1 == 0 { low.x } else { high.x },
                if k & 2 == 0 { low.y } else { high.y },
                if k & 4 == 0 { low.z } else { high.z },
            )
        };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.plate(&face.map(at), face_material, openness);
        }
    }

    /// Adds a grid of points as a smooth surface. Rows of `points` have equal length. The face between rows
    /// r, r + 1 and columns c, c + 1 has the given material, or is left out where it is `None`. It faces
    /// along (next column) x (next row).
    pub fn grid(
        &mut self,
        points: &[Vec<Vec3>],
        openness: impl Fn(Vec3) -> u8,
        face_material: impl Fn(usize, usize) -> Option<StaticMaterial>,
    ) {
        let (rows, columns) = (points.len(), points.first().map_or(0, Vec::len));
        let at = |r: usize, c: usize| points[r][c];
        // Area-weighted mean normal of the four adjacent faces: degenerate ones have no weight.
        let normal = |r: usize, c: usize| {
            let mut sum = Vec3::ZERO;
            for (dr, dc) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (Some(r), Some(c)) = ((r + dr).checked_sub(1), (c + dc).checked_sub(1)) else { continue };
                if r + 1 < rows && c + 1 < columns {
                    sum += (at(r + 1, c + 1) - at(r, c)).cross(at(r + 1, c) - at(r, c + 1));
                }
            }
            sum.normalize_or(Vec3::Z)
        };
        let mut slots: std::collections::BTreeMap<(usize, usize, &'static str), u32> = Default::default();
        for r in 0..rows.saturating_sub(1) {
            for c in 0..columns.saturating_sub(1) {
                let Some(face_material) = face_material(r, c) else { continue };
                let corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)];
                let place = corners.map(|(r, c)| at(r, c));
                let [p, q, s, t] = corners.map(|(r, c)| {
                    *slots.entry((r, c, face_material.name)).or_insert_with(|| {
                        self.vertex(face_material, at(r, c), normal(r, c), openness(at(r, c)))
                    })
                });
                let flat = |a: usize, b: usize, c: usize| {
                    (place[b] - place[a]).cross(place[c] - place[a]).length_squared() < 1e-10
                };
                if !flat(0, 1, 2) {
                    self.triangle(face_material, [p, q, s]);
                }
                if !flat(0, 2, 3) {
                    self.triangle(face_material, [p, s, t]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_models::{SHIPPED, glb, shipped};

    #[test]
    fn the_shipped_files_are_what_is_made_here() {
        for (name, model) in made() {
            assert!(
                shipped(&name) == Some(write(&model).as_slice()),
                "run: cargo xtask generate models ({name})"
            );
        }
        assert_eq!(made().len(), SHIPPED.len());
    }

    #[test]
    fn what_is_written_is_read_back() {
        let model = car::model(&car::SUV);
        let back = glb::read(&write(&model)).expect("our own file");
        assert_eq!(back.nodes.len(), model.nodes.len());
        assert_eq!(back.triangle_count(), model.triangle_count());
        for (a, b) in model.nodes.iter().zip(&back.nodes) {
            assert_eq!(a.name, b.name);
            for (p, q) in model.parts(a).iter().zip(back.parts(b)) {
                assert_eq!(p.material.name, q.material.name);
                assert_eq!(p.material.colour, q.material.colour);
                assert_eq!(p.indices, q.indices);
                for (v, w) in p.vertices.iter().zip(&q.vertices) {
                    let (v_at, w_at) = (
                        a.model_from_mesh.transform_point3(v.position),
                        b.model_from_mesh.transform_point3(w.position),
                    );
                    assert!(v_at.distance(w_at) < 1e-5 && v.normal.distance(w.normal) < 1e-2);
                    assert_eq!(v.openness, w.openness);
                }
            }
        }
    }
}
