//! Places on the pavement along kerbs, and what is taken of them: one test for all that stands there beside the scenery of
//! the map.

use super::doorways::Way;
use super::grounds::{covers, distance_to};
use super::plants::HEDGE_WIDTH_M;
use super::polygon::{doubled_area, mitre};
use super::props::WALL_WIDTH_M;
use super::roads::{RoadField, SHOULDER_M};
use super::{SceneObject, hash_to_unit, special};
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

/// From a wall: steps, bay windows and pipes are before it.
const OFF_WALLS_M: f64 = 0.40;
/// Foot of a lamp, over its circle.
const LAMP_FOOT_M: f64 = 0.10;
/// Before a door, from the step on.
const BEFORE_DOOR_M: f64 = 0.80;

/// Smaller areas within kerbs are islands of roundabouts, square metres.
const LEAST_AREA_M2: f64 = 500.0;

/// Whether a kerb is that of a roundabout's island, to which nobody has a way.
pub(super) fn is_island(kerb: &[DVec2]) -> bool {
    doubled_area(kerb).abs() < 2.0 * LEAST_AREA_M2
}

/// A disc on the ground: its middle and radius, metres.
pub(super) type Disc = (DVec2, f64);

/// What is taken on the ground, and what is free.
pub(super) struct Places<'a> {
    /// The scenery with the boxes around it, as it is drawn.
    scenery: Vec<(&'a Scenery, [DVec2; 2])>,
    field: &'a RoadField,
    ways: &'a [Way],
    /// Boxes of signs, signals and what else stands along kerbs, seen from above.
    boxes: Vec<[Vec2; 2]>,
    /// Trees up to the height of heads, and whatever was placed.
    discs: Vec<Disc>,
}

impl<'a> Places<'a> {
    /// Those that are left beside these objects, as far as they are no wider than a bicycle is long, and these trees.
    pub(super) fn new(
        (map, field): (&'a CityMap, &'a RoadField),
        ways: &'a [Way],
        objects: &[SceneObject],
        trees: Vec<Disc>,
    ) -> Self {
        const MOST_M: f32 = 1.9;
        let boxes = objects.iter().filter_map(|object| Some(object.levels.first()?.mesh.bounds()));
        let flat = boxes.map(|corners| corners.map(Vec3::truncate));
        let boxes = flat.filter(|[low, high]| (*high - *low).max_element() < MOST_M).collect();
        let scenery = map.scenery.iter().map(|piece| (piece, box_of(piece))).collect();
        Self { scenery, field, ways, boxes, discs: trees }
    }

    /// Takes discs on the pavement if all of them are free.
    pub(super) fn claim(&mut self, discs: &[Disc]) -> bool {
        let is_free = discs.iter().all(|&disc| self.is_free(disc));
        if is_free {
            self.discs.extend(discs);
        }
        is_free
    }

    /// Whether things that stay there for good would be between a door and the kerb.
    pub(super) fn is_before_door(&self, (at, radius_m): Disc) -> bool {
        self.ways.iter().any(|way| way.off_approach_m(at) < BEFORE_DOOR_M + radius_m)
    }

    /// Takes a disc that is not on the pavement, such as a seat.
    pub(super) fn take(&mut self, disc: Disc) {
        self.discs.push(disc);
    }

    /// Whether a disc is off the road and clear of walls, doors, and what else stands there.
    pub(super) fn is_free(&self, (at, radius_m): Disc) -> bool {
        let clear = radius_m as f32;
        let off_road = self.field.distance.at(at) > SHOULDER_M + clear;
        let point = at.as_vec2();
        off_road
            && self.discs.iter().all(|(middle, taken_m)| middle.distance(at) > taken_m + radius_m)
            && !self
                .boxes
                .iter()
                .any(|[low, high]| point.cmpgt(*low - clear).all() && point.cmplt(*high + clear).all())
            && self.ways.iter().all(|way| way.threshold().distance(at) > BEFORE_DOOR_M + radius_m)
            && self.scenery.iter().all(|(piece, [low, high])| {
                let is_far = at.cmplt(*low - radius_m).any() || at.cmpgt(*high + radius_m).any();
                is_far || gap_m(piece, at) > radius_m
            })
    }
}

/// From a point to a piece of scenery as it is drawn. Trees are among the discs.
fn gap_m(piece: &Scenery, at: DVec2) -> f64 {
    if matches!(piece.kind, SceneryKind::Grass | SceneryKind::Paving | SceneryKind::Tree) {
        return f64::INFINITY;
    }
    let shape = &piece.shape;
    if covers(shape, at) { 0.0 } else { distance_to(shape, at) - over_m(piece) }
}

/// How far what is drawn reaches over a footprint.
fn over_m(piece: &Scenery) -> f64 {
    match (piece.kind, &piece.shape) {
        (SceneryKind::Hedge, Footprint::Polyline(_)) => f64::from(HEDGE_WIDTH_M) / 2.0,
        (SceneryKind::Wall, Footprint::Polyline(_)) => f64::from(WALL_WIDTH_M) / 2.0,
        (SceneryKind::Lamp, _) => LAMP_FOOT_M,
        (SceneryKind::Building, _) => OFF_WALLS_M + special::projection_m(&piece.name.to_lowercase()),
        _ => 0.0,
    }
}

/// The box around a piece of scenery as it is drawn.
pub(super) fn box_of(piece: &Scenery) -> [DVec2; 2] {
    let (corners, reach_m) = match &piece.shape {
        Footprint::Circle { centre, radius_m } => (std::slice::from_ref(centre), *radius_m),
        Footprint::Polygon(points) | Footprint::Polyline(points) => (points.as_slice(), 0.0),
    };
    let low = corners.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = corners.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let over_m = reach_m + over_m(piece);
    [low - over_m, high + over_m]
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
