//! Collision detection: overlapping outlines of vehicles and of static obstacles (sweep and prune).

use super::outline_of;
use super::vehicle::SimVehicle;
use city3d_geometry::OrientedRect;
use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::{Event, EventKind, VehicleId};
use city3d_roadmap::{CityMap, Footprint, Scenery};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A static obstacle.
#[derive(Clone, Debug)]
pub struct StaticObstacle {
    /// Name in the map, or the kind of scenery where it has none.
    pub name: String,
    /// Corners in order.
    pub polygon: Vec<DVec2>,
    /// Above the ground, city metres.
    pub height_m: f64,
    low: DVec2,
    high: DVec2,
}

/// All static obstacles, sorted for spatial look-up.
#[derive(Clone, Debug, Default)]
pub struct StaticObstacles {
    /// Sorted by west end.
    solids: Vec<StaticObstacle>,
    widest_m: f64,
}

/// Thickness of walls and hedges drawn as lines, and default heights.
const WALL_THICKNESS_M: f64 = 0.3;
const WALL_HEIGHT_M: f64 = 1.0;
const BUILDING_HEIGHT_M: f64 = 8.0;

impl StaticObstacles {
    /// Obstacles from the buildings, walls and hedges of a map.
    pub fn of(map: &CityMap) -> Self {
        let mut solids: Vec<StaticObstacle> =
            map.scenery.iter().filter(|s| s.kind.is_solid()).flat_map(solids_of).collect();
        solids.sort_by(|a, b| a.low.x.total_cmp(&b.low.x).then(a.low.y.total_cmp(&b.low.y)));
        let widest_m = solids.iter().map(|solid| solid.high.x - solid.low.x).fold(0.0, f64::max);
        Self { solids, widest_m }
    }

    /// Obstacles from west to east.
    pub fn iter(&self) -> impl Iterator<Item = &StaticObstacle> {
        self.solids.iter()
    }

    fn touching(&self, outline: &OrientedRect) -> Option<&StaticObstacle> {
        let (radius, centre) = (outline.radius(), outline.centre);
        let first = self.solids.partition_point(|solid| solid.low.x < centre.x - radius - self.widest_m);
        self.solids[first..]
            .iter()
            .take_while(|solid| solid.low.x <= centre.x + radius)
            .filter(|solid| {
                (centre + radius).cmpge(solid.low).all() && (centre - radius).cmple(solid.high).all()
            })
            .find(|solid| outline.overlaps_polygon(&solid.polygon))
    }
}

fn solids_of(scenery: &Scenery) -> Vec<StaticObstacle> {
    let solid = |polygon: Vec<DVec2>, height_m: f64| {
        let low = polygon.iter().copied().fold(DVec2::splat(f64::INFINITY), DVec2::min);
        let high = polygon.iter().copied().fold(DVec2::splat(f64::NEG_INFINITY), DVec2::max);
        let kind = format!("{:?}", scenery.kind).to_lowercase();
        let name = if scenery.name.is_empty() { kind } else { scenery.name.clone() };
        StaticObstacle { name, polygon, height_m: scenery.height_m.unwrap_or(height_m), low, high }
    };
    match &scenery.shape {
        Footprint::Polygon(polygon) => vec![solid(polygon.clone(), BUILDING_HEIGHT_M)],
        Footprint::Polyline(points) => points
            .windows(2)
            .filter_map(|pair| {
                let side = (pair[1] - pair[0]).try_normalize()?.perp() * (WALL_THICKNESS_M / 2.0);
                let corners = vec![pair[0] + side, pair[0] - side, pair[1] - side, pair[1] + side];
                Some(solid(corners, WALL_HEIGHT_M))
            })
            .collect(),
        Footprint::Circle { centre, radius_m } => {
            let corner = |k: i32| {
                let (sin, cos) = city3d_geometry::trig::sin_cos(f64::from(k) * std::f64::consts::TAU / 12.0);
                *centre + DVec2::new(cos, sin) * *radius_m
            };
            vec![solid((0..12).map(corner).collect(), BUILDING_HEIGHT_M)]
        }
    }
}

/// Pairs in contact. A collision is reported when two outlines first overlap, and again only after they have
/// been clear of each other.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Collisions {
    touching: BTreeSet<(VehicleId, VehicleId)>,
    touching_solid: BTreeSet<VehicleId>,
    #[serde(skip)]
    by_west_end: Vec<(f64, usize)>,
    #[serde(skip)]
    outlines: Vec<OrientedRect>,
}

/// More than distances are rounded by.
const ROUNDING_M: f64 = 1e-6;

/// Outlines that have collided are clear when they no longer overlap, enlarged by this.
const APART_M: f64 = 1.0;

impl Digest for Collisions {
    fn digest(&self, hash: &mut StateHash) {
        for (a, b) in &self.touching {
            hash.word(u64::from(a.0) << 32 | u64::from(b.0));
        }
        self.touching_solid.iter().for_each(|vehicle| hash.word(u64::from(vehicle.0)));
    }
}

impl Collisions {
    /// Finds the contacts of a tick and adds an event for each that is new; `vehicles` are in id order.
    pub fn find(
        &mut self,
        vehicles: &[SimVehicle],
        solids: &StaticObstacles,
        time_s: f64,
        events: &mut Vec<Event>,
    ) {
        self.outlines.clear();
        self.outlines.extend(vehicles.iter().map(|vehicle| outline_of(&vehicle.state, vehicle)));
        self.release(vehicles, solids);
        self.sweep();
        let mut found: Vec<(VehicleId, VehicleId)> = Vec::new();
        for (place, &(west, a)) in self.by_west_end.iter().enumerate() {
            let (outline, radius) = (&self.outlines[a], self.outlines[a].radius());
            let east = west + 2.0 * radius;
            for &(other_west, b) in &self.by_west_end[place + 1..] {
                if other_west > east {
                    break;
                }
                // In a grid of streets most that share their east and west are far to the north or south.
                let other = &self.outlines[b];
                let apart_m = (outline.centre.y - other.centre.y).abs();
                if apart_m < radius + other.radius() + ROUNDING_M && outline.overlap(other).is_some() {
                    let (low, high) = (a.min(b), a.max(b));
                    found.push((vehicles[low].state.id, vehicles[high].state.id));
                }
            }
        }
        found.sort_unstable();
        for (vehicle, with) in found {
            if self.touching.insert((vehicle, with)) {
                events.push(Event { time_s, vehicle, kind: EventKind::Collision { with } });
            }
        }
        for (vehicle, outline) in vehicles.iter().zip(&self.outlines) {
            let id = vehicle.state.id;
            if let Some(solid) = solids.touching(outline)
                && self.touching_solid.insert(id)
            {
                let kind = EventKind::CollisionStatic { with: solid.name.clone() };
                events.push(Event { time_s, vehicle: id, kind });
            }
        }
    }

    /// Whether a vehicle touches another one or a solid, or has not been clear of it since.
    pub fn hold(&self, id: VehicleId) -> bool {
        self.touching_solid.contains(&id) || self.touching.iter().any(|(a, b)| *a == id || *b == id)
    }

    fn sweep(&mut self) {
        let outlines = &self.outlines;
        let west = |index: usize| outlines[index].centre.x - outlines[index].radius();
        if self.by_west_end.len() == outlines.len() {
            self.by_west_end.iter_mut().for_each(|entry| entry.0 = west(entry.1));
        } else {
            self.by_west_end = (0..outlines.len()).map(|index| (west(index), index)).collect();
        }
        // Nearly sorted since the last tick: the stable sort is linear then.
        self.by_west_end.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    fn release(&mut self, vehicles: &[SimVehicle], solids: &StaticObstacles) {
        let outlines = &self.outlines;
        let grown = |id: VehicleId| {
            let index = vehicles.binary_search_by_key(&id, |vehicle| vehicle.state.id).ok()?;
            let outline = outlines[index];
            Some(OrientedRect { half: outline.half + APART_M / 2.0, ..outline })
        };
        self.touching.retain(|&(a, b)| grown(a).zip(grown(b)).is_some_and(|(a, b)| a.overlap(&b).is_some()));
        self.touching_solid
            .retain(|&id| grown(id).is_some_and(|outline| solids.touching(&outline).is_some()));
    }
}
