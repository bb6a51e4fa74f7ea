//! Triangle meshes with finishes: plain data for any renderer.

use glam::{IVec3, Vec2, Vec3};
use rustc_hash::FxHashMap;
use std::hash::Hash;

/// The surface type of a face. Its texture is a grey or natural pattern, tinted by the vertex colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Surface {
    /// Uniform, fully matt.
    #[default]
    Plain,
    /// Grain, stains and fine cracks.
    Asphalt,
    /// Lawns and verges.
    Grass,
    /// Paving slabs with joints.
    Slabs,
    /// Concrete, render and cut stone.
    Concrete,
    /// Worn paint on asphalt.
    Paint,
    /// Courses of brick with mortar joints.
    Brick,
    /// A bay of a rendered wall with a window; u counts bays, v storeys.
    Windows,
    /// A bay of an office wall, mostly glass.
    Glazing,
    /// A bay of a shop front: window down to the pavement.
    Shopfront,
    /// Rows of overlapping tiles.
    RoofTiles,
    /// Loose stones, as on flat roofs.
    Gravel,
    /// Foliage of broad-leaved trees and hedges.
    Leaves,
    /// Boards and bark.
    Wood,
    /// Rippled surface of a pond.
    Water,
    /// Sand of playgrounds and shores.
    Sand,
    /// Flowers among leaves, in clumps of one colour.
    Flowers,
    /// Dark, smooth window glass.
    Glass,
    /// Painted or bare metal, less rough than [`Self::Plain`].
    Metal,
    /// A lane from its right edge (u 0) to its left one, with the tracks of tyres.
    Lane,
    /// A painted line on asphalt: u metres from its middle, v half its width. It has no layer of its own:
    /// how much of a pixel it covers is computed.
    Line,
    /// Asphalt laid later, with sealed edges.
    Patch,
    /// An iron cover in asphalt.
    Manhole,
    /// A bay of a brick wall with a sash window.
    Sash,
    /// A bay of a rendered wall with a window between shutters.
    Shutters,
    /// A bay of a modern block with a balcony.
    Balcony,
    /// A house door.
    Door,
    /// A wide door of panels.
    Gate,
    /// Letters and digits, light on dark, in cells: see `lettering`.
    Letters,
    /// Faces of road signs, in cells: see `signs`.
    Signs,
    /// Small stones laid in rows.
    Setts,
    /// Needles of conifers.
    Needles,
    /// Stripes of cloth.
    Awning,
    /// Lacquered sheet metal.
    CarPaint,
    /// The lens of a street lamp.
    Lantern,
    /// [`Self::Shopfront`] with clothes behind it.
    Boutique,
    /// [`Self::Shopfront`] with tables behind it.
    Tearoom,
    /// The digits on the number plate of a vehicle, in texture coordinates that count squares of the lettering: they are
    /// computed, and its layer is plain.
    Number,
}

impl Surface {
    /// Number of surfaces: layers of the texture array.
    pub const COUNT: usize = Self::Number as usize + 1;

    /// Whether it is a shop-front bay of any kind.
    pub fn is_shopfront(self) -> bool {
        matches!(self, Self::Shopfront | Self::Boutique | Self::Tearoom)
    }

    /// Whether its pattern shows distinct objects, which are missed also from afar, rather than a material.
    pub fn is_figured(self) -> bool {
        matches!(
            self,
            Self::Windows
                | Self::Glazing
                | Self::Shopfront
                | Self::Boutique
                | Self::Tearoom
                | Self::Sash
                | Self::Shutters
                | Self::Balcony
                | Self::Door
                | Self::Gate
                | Self::Letters
                | Self::Signs
                | Self::Awning
        )
    }
}

/// Class of a pixel for semantic segmentation. The numbers are written to the images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Class {
    /// Pixels that no object covers.
    #[default]
    Sky = 0,
    /// Asphalt of roads, car parks and country roads, with manhole covers.
    Road = 1,
    /// Paint on asphalt: lines, arrows, parking bays.
    Marking = 2,
    /// Pavements, kerbs, paved squares, garden paths, the gravel of yards and the sand of playgrounds.
    Pavement = 3,
    /// Lawns, verges, fields, and banks and shores of ponds.
    Grass = 4,
    /// Buildings with all their parts; model files too, unless their materials are of another class.
    Building = 5,
    /// Free-standing walls, fences, and stone edges of car parks and grounds.
    Wall = 6,
    /// Trees, hedges, hedgerows, flower beds, reeds and woods.
    Vegetation = 7,
    /// Street lamps, bollards, and posts of signs, street names and traffic signals.
    Pole = 8,
    /// Benches, picnic tables, bins, fuel pumps, playground equipment, post boxes, cabinets and bicycle stands.
    Furniture = 9,
    /// Ponds.
    Water = 10,
    /// Vehicles with glass, lamps and wheels, parked cars and bicycles.
    Vehicle = 11,
    /// Faces of road signs, names of streets and heads of traffic signals; their poles are poles.
    Sign = 12,
    /// Pedestrians, and people who sit.
    Person = 13,
}

/// The finish of a face: surface, colour and class.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Finish {
    /// Selects the texture.
    pub surface: Surface,
    /// sRGB, multiplied with the surface's texture.
    pub colour: [u8; 3],
    /// What its pixels count as in semantic segmentation.
    pub class: Class,
}

impl Finish {
    /// The finish of a surface with an sRGB tint.
    pub const fn new(surface: Surface, colour: [u8; 3], class: Class) -> Self {
        Self { surface, colour, class }
    }

    /// The finish scaled in brightness by `factor`.
    pub fn shaded(self, factor: f32) -> Self {
        Self { colour: self.colour.map(|c| (f32::from(c) * factor).clamp(0.0, 255.0) as u8), ..self }
    }
}

/// A corner of triangles with its shading attributes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Metres, relative to the origin of the mesh's owner.
    pub position: Vec3,
    /// Unit vector out of the surface.
    pub normal: Vec3,
    /// In texture repeats.
    pub uv: Vec2,
    /// Finish of the triangles that meet here.
    pub finish: Finish,
    /// Ambient openness: the share of the sky that is visible, 255 for all.
    pub openness: u8,
}

/// Mesh simplification by vertex clustering (Rossignac and Borrel 1993): vertices within a cube of an edge
/// move to their mean, and those of one kind there merge. `position` and `moved` read and set the position of
/// a vertex. All kinds share the cell positions, so no gap opens. The largest displacement comes last.
pub fn clustered<V, K: Eq + Hash>(
    (vertices, indices): (&[V], &[u32]),
    edge_m: f32,
    (position, moved): (impl Fn(&V) -> Vec3, impl Fn(&V, Vec3) -> V),
    kind: impl Fn(&V) -> K,
) -> (Vec<V>, Vec<u32>, f32) {
    let cube = |v: &V| (position(v) / edge_m).round().as_ivec3();
    let mut places: FxHashMap<IVec3, (Vec3, f32)> = FxHashMap::default();
    for vertex in vertices {
        let place = places.entry(cube(vertex)).or_default();
        *place = (place.0 + position(vertex), place.1 + 1.0);
    }
    let mut known = FxHashMap::default();
    let (mut kept, mut corners_kept) = (Vec::new(), Vec::new());
    for triangle in indices.chunks_exact(3) {
        let corners = [0, 1, 2].map(|k| &vertices[triangle[k] as usize]);
        let cubes = corners.map(&cube);
        if cubes[0] == cubes[1] || cubes[1] == cubes[2] || cubes[2] == cubes[0] {
            continue;
        }
        for (vertex, cube) in corners.into_iter().zip(cubes) {
            let slot = *known.entry((cube, kind(vertex))).or_insert_with(|| {
                let (sum, count) = places[&cube];
                kept.push(moved(vertex, sum / count));
                kept.len() as u32 - 1
            });
            corners_kept.push(slot);
        }
    }
    let moved_m = |v: &V| {
        let (sum, count) = places[&cube(v)];
        position(v).distance(sum / count)
    };
    let most_m = vertices.iter().map(moved_m).fold(0.0, f32::max);
    (kept, corners_kept, most_m)
}

/// Support function of a point set in 34 directions: level ones 22.5 degrees apart, up, down, and diagonals.
pub fn reach(points: impl Iterator<Item = Vec3>) -> [f32; 34] {
    const SLANT: f32 = std::f32::consts::FRAC_1_SQRT_2;
    // Sine and cosine of 22.5 degrees.
    const S: f32 = 0.382_683_43;
    const C: f32 = 0.923_879_5;
    points.fold([f32::NEG_INFINITY; 34], |mut reach, p| {
        let q = p * SLANT;
        let level = [p.x, p.y, q.x + q.y, q.x - q.y];
        let between = [C * p.x + S * p.y, S * p.x + C * p.y, C * p.x - S * p.y, S * p.x - C * p.y];
        let (sum, difference) = ((p.x + p.y) / 2.0, (p.x - p.y) / 2.0);
        let slanted = [q.z + sum, q.z - sum, q.z + difference, q.z - difference];
        let upward = [p.z, q.y + q.z, q.y - q.z, q.x + q.z, q.x - q.z];
        for (k, along) in level.into_iter().chain(between).chain(upward).chain(slanted).enumerate() {
            reach[2 * k] = reach[2 * k].max(along);
            reach[2 * k + 1] = reach[2 * k + 1].max(-along);
        }
        reach
    })
}

/// The closest point on a triangle (Ericson, *Real-Time Collision Detection*, 5.1.5).
fn nearest_on([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (vc, vb, va) = (d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let scale = 1.0 / (va + vb + vc);
    a + ab * (vb * scale) + ac * (vc * scale)
}

/// Largest height of the foot of a wall or post.
const LOW_M: f32 = 0.35;
const FOOT_OPENNESS: u8 = 140;

/// Indexed triangles, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners that the triangles refer to by index.
    pub vertices: Vec<Vertex>,
    /// Three for each triangle.
    pub indices: Vec<u32>,
}

impl Mesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// Whether it has no triangles; unused vertices do not count.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Adds the triangles of another.
    pub fn append(&mut self, other: &Self) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.indices.extend(other.indices.iter().map(|k| k + base));
    }

    /// Adds a vertex and returns its index.
    pub fn vertex(&mut self, vertex: Vertex) -> u32 {
        self.vertices.push(vertex);
        self.vertices.len() as u32 - 1
    }

    /// Adds a flat convex face with uv per corner, corners counter-clockwise seen from outside.
    pub fn face(&mut self, corners: &[Vec3], uvs: &[Vec2], finish: Finish) {
        self.shaded_face(corners, uvs, finish, &vec![255; corners.len()]);
    }

    /// Adds a flat convex face with an openness per corner.
    pub fn shaded_face(&mut self, corners: &[Vec3], uvs: &[Vec2], finish: Finish, openness: &[u8]) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        debug_assert!(uvs.len() == corners.len() && openness.len() == corners.len());
        let base = self.vertices.len() as u32;
        for ((&position, &uv), &openness) in corners.iter().zip(uvs).zip(openness.iter()) {
            self.vertices.push(Vertex { position, normal, uv, finish, openness });
        }
        for k in 2..corners.len() as u32 {
            self.indices.extend([base, base + k - 1, base + k]);
        }
    }

    /// Adds a flat convex face with planar texture coordinates in metres along its own axes.
    pub fn plate(&mut self, corners: &[Vec3], finish: Finish, metres_per_repeat: f32) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        let across = if normal.z.abs() > 0.9 { Vec3::X } else { Vec3::Z.cross(normal).normalize_or(Vec3::X) };
        let up = normal.cross(across);
        let uvs: Vec<Vec2> =
            corners.iter().map(|c| Vec2::new(c.dot(across), c.dot(up)) / metres_per_repeat).collect();
        self.face(corners, &uvs, finish);
    }

    /// Adds a box without its bottom, rotated about z. `centre` is the middle of its bottom.
    pub fn block(&mut self, centre: Vec3, size: Vec3, yaw_rad: f32, finish: Finish) {
        let (sin, cos) = yaw_rad.sin_cos();
        let (ahead, left) =
            (Vec3::new(cos, sin, 0.0) * size.x / 2.0, Vec3::new(-sin, cos, 0.0) * size.y / 2.0);
        let ring =
            [centre + ahead + left, centre - ahead + left, centre - ahead - left, centre + ahead - left];
        self.prism(&ring, size.z, finish, finish);
    }

    /// Adds vertical walls on a counter-clockwise ring and a lid (the ring is convex).
    pub fn prism(&mut self, ring: &[Vec3], height: f32, side: Finish, lid: Finish) {
        let up = Vec3::Z * height;
        for (k, &a) in ring.iter().enumerate() {
            let b = ring[(k + 1) % ring.len()];
            let first = self.vertices.len();
            self.plate(&[a, b, b + up, a + up], side, 2.0);
            self.shade_foot(first);
        }
        let top: Vec<Vec3> = ring.iter().map(|&p| p + up).collect();
        self.plate(&top, lid, 2.0);
    }

    /// Darkens vertices from `first` on that are low above the ground, which hides half of their surroundings
    /// (baked ambient occlusion).
    fn shade_foot(&mut self, first: usize) {
        for vertex in self.vertices[first..].iter_mut().filter(|v| v.position.z < LOW_M) {
            vertex.openness = vertex.openness.min(FOOT_OPENNESS);
        }
    }

    /// Sets the openness of the vertices from `first` on.
    pub fn set_openness(&mut self, first: usize, openness: u8) {
        self.vertices[first..].iter_mut().for_each(|vertex| vertex.openness = openness);
    }

    /// Adds an upright cone frustum, smooth around, with a lid if the top has a radius.
    pub fn frustum(&mut self, foot: Vec3, radii: [f32; 2], height: f32, sides: u32, finish: Finish) {
        let base = self.vertices.len() as u32;
        let slope = (radii[0] - radii[1]) / height.max(1e-3);
        for k in 0..=sides {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / sides as f32).sin_cos();
            let normal = Vec3::new(cos, sin, slope).normalize_or(Vec3::Z);
            for (radius, z) in [(radii[0], 0.0), (radii[1], height)] {
                let position = foot + Vec3::new(cos * radius, sin * radius, z);
                let uv = Vec2::new(k as f32 / sides as f32 * 2.0, z / 2.0);
                self.vertices.push(Vertex { position, normal, uv, finish, openness: 255 });
            }
        }
        self.shade_foot(base as usize);
        for k in 0..sides {
            let a = base + 2 * k;
            self.indices.extend([a, a + 2, a + 3]);
            if radii[1] > 0.0 {
                self.indices.extend([a, a + 3, a + 1]);
            }
        }
        if radii[1] > 0.02 {
            let top: Vec<Vec3> = (0..sides)
                .map(|k| {
                    let (sin, cos) = (std::f32::consts::TAU * k as f32 / sides as f32).sin_cos();
                    foot + Vec3::new(cos * radii[1], sin * radii[1], height)
                })
                .collect();
            self.plate(&top, finish, 2.0);
        }
    }

    /// Merges bitwise equal vertices.
    pub fn weld(&mut self) {
        let mut seen = FxHashMap::default();
        seen.reserve(self.vertices.len());
        let mut kept = Vec::with_capacity(self.vertices.len());
        let slot: Vec<u32> = self
            .vertices
            .iter()
            .map(|v| {
                let key = (
                    v.position.to_array().map(f32::to_bits),
                    v.normal.to_array().map(|x| (x * 512.0).round() as i32),
                    v.uv.to_array().map(f32::to_bits),
                    (v.finish.surface, v.finish.colour, v.finish.class, v.openness),
                );
                *seen.entry(key).or_insert_with(|| {
                    kept.push(*v);
                    kept.len() as u32 - 1
                })
            })
            .collect();
        self.vertices = kept;
        for index in &mut self.indices {
            *index = slot[*index as usize];
        }
    }

    /// Simplified by [`clustered`]. Faces keep their finish, orientation and texture coordinates. Also
    /// returns the largest displacement of a vertex.
    pub fn simplified(&self, edge_m: f32) -> (Self, f32) {
        let figure = |v: &Vertex| v.finish.surface.is_figured().then(|| (v.uv * 16.0).round().as_ivec2());
        let kind = |v: &Vertex| (v.finish, (v.normal * 2.0).round().as_ivec3(), figure(v));
        let place = (|v: &Vertex| v.position, |v: &Vertex, position| Vertex { position, ..*v });
        let (vertices, indices, moved_m) = clustered((&self.vertices, &self.indices), edge_m, place, kind);
        (Self { vertices, indices }, moved_m)
    }

    /// Largest difference between the silhouettes of two meshes along the directions of [`reach`].
    pub fn outline_apart(&self, other: &Self) -> f32 {
        self.outline_from(&other.reach())
    }

    /// [`Self::outline_apart`] from the [`reach`] of another mesh.
    pub fn outline_from(&self, other: &[f32; 34]) -> f32 {
        self.reach().iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// See [`reach`].
    pub fn reach(&self) -> [f32; 34] {
        reach(self.vertices.iter().map(|v| v.position))
    }

    /// Distance from a point to the nearest triangle, by linear search.
    pub fn distance_to(&self, point: Vec3) -> f32 {
        let corner = |k: u32| self.vertices[k as usize].position;
        let triangles = self.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(corner));
        triangles.map(|t| nearest_on(t, point).distance(point)).fold(f32::INFINITY, f32::min)
    }

    /// The bounding box of all vertices.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.vertices.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], v| {
            [low.min(v.position), high.max(v.position)]
        })
    }
}
