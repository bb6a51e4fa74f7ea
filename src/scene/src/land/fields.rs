//! The patchwork of fields: quadrilaterals between the nodes of a bent lattice, some of them joined, each with a crop.

use super::super::mesh::{Class, Finish, Surface};
use super::relief::{Relief, hash_at, noise};
use city3d_geometry::point_in_polygon;
use glam::{DVec2, IVec2};

/// Mean edge of a field, and of one on the hills beyond, where one stands for several.
const FIELD_M: f64 = 118.0;
const FAR_FIELD_M: f64 = 360.0;
/// The lattice is turned out of the axes of the map, bent, and its nodes lie off their places by this share.
const TURN_RAD: f64 = 0.42;
const BENT_M: f64 = 70.0;
const BEND_M: f64 = 640.0;
const JITTER: f64 = 0.42;
/// Fields reach so far around the closed ground.
pub(super) const REACH_M: f64 = 1650.0;
/// Distances within which those on the hills lie.
const FAR_M: [f64; 2] = [REACH_M + 40.0, 4200.0];
/// Mean width of the common land between the town and its fields, and how far its edge is off that.
pub(super) const COMMON_M: f64 = 22.0;
const COMMON_SWAY_M: f64 = 20.0;
/// Share of the edges that have no boundary: the fields on both sides are one.
const JOINED: f32 = 0.15;

/// A crop: its finish, and metres in which its pattern repeats along and across the rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crop {
    pub(super) finish: Finish,
    pub(super) repeat_m: [f32; 2],
}

const fn crop(surface: Surface, colour: [u8; 3], repeat_m: [f32; 2]) -> Crop {
    Crop { finish: Finish::new(surface, colour, Class::Grass), repeat_m }
}

const CROPS: [Crop; 10] = [
    crop(Surface::Grass, [98, 114, 68], [7.0, 7.0]),
    crop(Surface::Grass, [112, 124, 72], [8.0, 8.0]),
    crop(Surface::Grass, [126, 130, 80], [7.0, 7.0]),
    // Barley and wheat in rows.
    crop(Surface::Grass, [178, 160, 102], [26.0, 4.0]),
    crop(Surface::Grass, [158, 148, 90], [24.0, 4.0]),
    // Stubble.
    crop(Surface::Wood, [178, 158, 112], [40.0, 4.4]),
    // Beet and maize.
    crop(Surface::Grass, [86, 106, 58], [22.0, 3.4]),
    // Ploughed.
    crop(Surface::Wood, [118, 98, 78], [40.0, 3.4]),
    crop(Surface::Grass, [106, 120, 64], [8.0, 8.0]),
    crop(Surface::Grass, [92, 110, 64], [9.0, 9.0]),
];

/// A field, by the node of the lattice at its south-west corner.
pub(super) type FieldId = [i32; 2];

/// The patchwork around a town, or the coarser one on the hills around that.
pub(super) struct Fields<'a> {
    relief: &'a Relief,
    edge_m: f64,
    /// Distances from the closed ground within which it lies.
    range_m: [f64; 2],
    middle: DVec2,
    /// Nodes in each direction from the middle.
    count: i32,
    /// Places of the nodes, column by column.
    places: Vec<DVec2>,
}

impl<'a> Fields<'a> {
    pub(super) fn new(relief: &'a Relief) -> Self {
        Self::of(relief, FIELD_M, [0.0, REACH_M])
    }

    /// Those on the hills.
    pub(super) fn far(relief: &'a Relief) -> Self {
        Self::of(relief, FAR_FIELD_M, FAR_M)
    }

    fn of(relief: &'a Relief, edge_m: f64, range_m: [f64; 2]) -> Self {
        let [low, high] = relief.town;
        let half = (high - low).max_element() / 2.0 + range_m[1];
        let count = (half / edge_m).ceil() as i32 + 2;
        let middle = (low + high) / 2.0;
        let mut fields = Self { relief, edge_m, range_m, middle, count, places: Vec::new() };
        fields.places = fields.nodes().map(|node| fields.place_of(node)).collect();
        fields
    }

    /// Place of a node of the lattice; of one beyond its edge, the nearest one.
    fn node(&self, node: [i32; 2]) -> DVec2 {
        let [x, y] = node.map(|k| (k.clamp(-self.count, self.count) + self.count) as usize);
        self.places[x * (2 * self.count as usize + 1) + y]
    }

    fn place_of(&self, [x, y]: [i32; 2]) -> DVec2 {
        let jitter = |salt| f64::from(hash_at([x, y], salt)) - 0.5;
        let at =
            DVec2::new(f64::from(x) + JITTER * jitter(31), f64::from(y) + JITTER * jitter(32)) * self.edge_m;
        let bend = |salt| BENT_M * (noise(at / BEND_M, salt) - 0.5) * 2.0;
        self.middle + DVec2::from_angle(TURN_RAD).rotate(at + DVec2::new(bend(33), bend(34)))
    }

    /// How far a place lies outside of the common land.
    pub(super) fn off_common_m(&self, at: DVec2) -> f64 {
        let sway = COMMON_SWAY_M * (2.0 * noise(at / 61.0, 37) - 1.0);
        self.relief.away_m(at) - COMMON_M - sway
    }

    /// The edge of the common land, a ring.
    pub(super) fn common_edge(&self) -> Vec<DVec2> {
        const CORNERS: u32 = 72;
        let [low, high] = self.relief.town;
        let reach = (high - low).length() + COMMON_M + COMMON_SWAY_M;
        let corner = |k: u32| {
            let ahead = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS));
            let (mut inside, mut outside) = (0.0, reach);
            for _ in 0..24 {
                let between = (inside + outside) / 2.0;
                let is_out = self.off_common_m(self.middle + ahead * between) > 0.0;
                *(if is_out { &mut outside } else { &mut inside }) = between;
            }
            self.middle + ahead * outside
        };
        (0..CORNERS).map(corner).collect()
    }

    /// All nodes of the lattice.
    fn nodes(&self) -> impl Iterator<Item = [i32; 2]> + use<> {
        let count = self.count;
        (-count..=count).flat_map(move |x| (-count..=count).map(move |y| [x, y]))
    }

    fn corners(&self, [x, y]: FieldId) -> [DVec2; 4] {
        [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(|node| self.node(node))
    }

    /// The field that a field is part of: the one to its south, to its west, or none. Also says along which axis the
    /// boundary between the two would run.
    fn joined_with([x, y]: FieldId) -> Option<(FieldId, usize)> {
        if hash_at([x, y], 35) < JOINED {
            return Some(([x, y - 1], 0));
        }
        (hash_at([x, y], 36) < JOINED).then_some(([x - 1, y], 1))
    }

    /// Boundaries between fields within their reach: ends, and a seed.
    pub(super) fn boundaries(&self) -> Vec<([DVec2; 2], u32)> {
        let in_reach = |at: DVec2| self.is_in_range(at);
        let edges = self.nodes().flat_map(|node| {
            let [x, y] = node;
            [(0, [x + 1, y]), (1, [x, y + 1])].map(|(axis, next)| (node, axis, next))
        });
        edges
            .filter(|&(node, axis, _)| Self::joined_with(node).is_none_or(|(_, without)| without != axis))
            .map(|(node, axis, next)| {
                ([self.node(node), self.node(next)], super::relief::seed_at(node) ^ axis as u32)
            })
            .filter(|([a, b], _)| in_reach(*a) && in_reach(*b))
            .collect()
    }

    /// The middle of each field within reach.
    pub(super) fn middles(&self) -> impl Iterator<Item = DVec2> {
        let middle = |id: FieldId| self.corners(id).iter().sum::<DVec2>() / 4.0;
        self.nodes().map(middle).filter(|at| self.is_in_range(*at))
    }

    fn is_in_range(&self, at: DVec2) -> bool {
        let [from_m, to_m] = self.range_m;
        (from_m..to_m).contains(&self.relief.away_m(at))
    }

    /// The field at a place; nothing on the common land and beyond the patchwork.
    pub(super) fn at(&self, at: DVec2) -> Option<FieldId> {
        if self.off_common_m(at) < 0.0 || self.relief.away_m(at) > self.range_m[1] {
            return None;
        }
        let guess = (DVec2::from_angle(-TURN_RAD).rotate(at - self.middle) / self.edge_m).floor().as_ivec2();
        // Nodes lie off their places by less than two cells.
        let near = (0..5 * 5).map(|k| guess + IVec2::new(k % 5, k / 5) - 2);
        let found = near.map(|cell| cell.to_array()).find(|&id| point_in_polygon(at, &self.corners(id)))?;
        Some(Self::joined(found))
    }

    /// Joined fields go by the last one to the south and west.
    fn joined(mut id: FieldId) -> FieldId {
        while let Some((other, _)) = Self::joined_with(id) {
            id = other;
        }
        id
    }

    /// What grows on a field.
    pub(super) fn crop_of(&self, id: FieldId) -> Crop {
        let drawn = hash_at(id, 41) * CROPS.len() as f32;
        let Crop { finish, repeat_m } = CROPS[drawn as usize % CROPS.len()];
        Crop { finish: finish.shaded(0.92 + 0.16 * hash_at(id, 42)), repeat_m }
    }

    /// Whether a field on the hills is a wood: those lie together, with fields among them.
    pub(super) fn is_wood(&self, id: FieldId) -> bool {
        const WAVE_M: f64 = 700.0;
        0.66 * noise(self.node(id) / WAVE_M, 61) + 0.34 * f64::from(hash_at(id, 43)) > 0.60
    }

    /// Direction of its rows: along its longer side.
    pub(super) fn rows_of(&self, id: FieldId) -> DVec2 {
        let [a, b, _, d] = self.corners(id);
        let (along, across) = (b - a, d - a);
        let longer = if along.length_squared() > across.length_squared() { along } else { across };
        longer.normalize_or(DVec2::X)
    }
}
