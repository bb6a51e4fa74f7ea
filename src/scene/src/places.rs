//! Places on the pavement along kerbs, and whether there is room.

use super::SceneObject;
use super::grounds::{covers, distance_to};
use super::hash_to_unit;
use super::polygon::mitre;
use super::roads::{RoadField, SHOULDER_M};
use city3d_roadmap::{CityMap, Footprint, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

/// Where nobody may stand besides the scenery: boxes of signs, signals and what else stands along kerbs.
pub(super) struct Posts(Vec<[Vec2; 2]>);

impl Posts {
    /// Of the objects that are no wider than a bicycle is long.
    pub(super) fn of(objects: &[SceneObject]) -> Self {
        const MOST_M: f32 = 1.9;
        let boxes = objects.iter().filter_map(|object| Some(object.levels.first()?.mesh.bounds()));
        let flat = boxes.map(|corners| corners.map(Vec3::truncate));
        Self(flat.filter(|[low, high]| (*high - *low).max_element() < MOST_M).collect())
    }

    fn are_clear_of(&self, at: Vec2, clear: f32) -> bool {
        !self.0.iter().any(|[low, high]| at.cmpgt(*low - clear).all() && at.cmplt(*high + clear).all())
    }
}

/// A row of places along kerbs.
pub(super) struct KerbRow {
    /// Mean spacing, metres.
    pub(super) spacing_m: f64,
    /// Range of distances behind the face of the kerb, metres; on the road if negative.
    pub(super) off_kerb_m: [f64; 2],
    /// Tells the draws of rows apart.
    pub(super) salt: u32,
}

/// Places along a kerb, whose ring has the road to its left, with their seeds and the direction of the ring.
pub(super) fn along_kerb<'a>(
    ring: &'a [DVec2],
    number: u32,
    row: &'a KerbRow,
) -> impl Iterator<Item = (u32, DVec2, DVec2)> + 'a {
    let KerbRow { spacing_m, off_kerb_m: [near, far], salt } = *row;
    let mut next = spacing_m * f64::from(hash_to_unit(number, salt));
    let (mut start, mut count) = (0.0, 0);
    (0..ring.len()).flat_map(move |k| {
        let (from, to) = (ring[k], ring[(k + 1) % ring.len()]);
        let length = from.distance(to);
        let along = (to - from).try_normalize().unwrap_or(DVec2::X);
        let mut found = Vec::new();
        while next < start + length {
            let seed = number.wrapping_mul(4099).wrapping_add(count);
            let out = near + (far - near) * f64::from(hash_to_unit(seed, salt + 1));
            let outward = if next - start < 0.5 { mitre(ring, k) } else { -along.perp() };
            found.push((seed, from + along * (next - start) + outward * out, along));
            next += spacing_m * (0.4 + 1.2 * f64::from(hash_to_unit(seed, salt + 2)));
            count += 1;
        }
        start += length;
        found
    })
}

/// Whether a place is so far off the road, walls, and what else is there.
pub(super) fn has_room(map: &CityMap, field: &RoadField, posts: &Posts, (at, clear_m): (DVec2, f64)) -> bool {
    let off_road = f64::from(field.distance.at(at)) > f64::from(SHOULDER_M) + clear_m;
    let is_clear = map.scenery.iter().all(|piece| match (piece.kind, &piece.shape) {
        (SceneryKind::Grass | SceneryKind::Paving, _) => true,
        (SceneryKind::Tree, Footprint::Circle { centre, .. }) => centre.distance(at) > clear_m,
        (_, shape) => distance_to(shape, at) > clear_m && !covers(shape, at),
    });
    off_road && is_clear && posts.are_clear_of(at.as_vec2(), clear_m as f32)
}
