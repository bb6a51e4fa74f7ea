//! Collision detection: overlapping outlines of vehicles and of static obstacles.

use super::neighbours::Neighbours;
use super::vehicle::SimVehicle;
use city3d_geometry::OrientedRect;
use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::{Event, EventKind, VehicleId};
use city3d_roadmap::{CityMap, Footprint, Scenery};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::cell::Cell;
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
        let radius = DVec2::splat(outline.radius());
        self.within(outline.centre, radius).find(|solid| outline.overlaps_polygon(&solid.polygon))
    }

    /// Those whose upright boxes meet one of half the size `half` around a point.
    fn within(&self, centre: DVec2, half: DVec2) -> impl Iterator<Item = &StaticObstacle> {
        let (low, high) = (centre - half, centre + half);
        let first = self.solids.partition_point(|solid| solid.low.x < low.x - self.widest_m);
        self.solids[first..]
            .iter()
            .take_while(move |solid| solid.low.x <= high.x)
            .filter(move |solid| high.cmpge(solid.low).all() && low.cmple(solid.high).all())
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
    neighbours: Neighbours,
}

/// Where a vehicle is after a step, and how far from it others may be that its body meets in the next one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    pub outline: OrientedRect,
    /// Of the outline.
    pub radius_m: f64,
    /// Around the outline's upright box.
    pub margin_m: f64,
    /// Whether others that run into it move it.
    pub gives_way: bool,
    /// Whether the physics has its body.
    pub is_held: bool,
    /// Whether its body needs the physics in the next step: it is near another or a solid. Before: whether it does in any case.
    pub is_near: bool,
}

impl Place {
    fn circle(&self) -> (DVec2, f64) {
        (self.outline.centre, self.radius_m + std::f64::consts::SQRT_2 * self.margin_m)
    }

    /// Half the size of the outline's upright box, with the margin.
    fn upright_half(&self) -> DVec2 {
        let (axis, half) = (self.outline.axis.abs(), self.outline.half);
        axis * half.x + DVec2::new(axis.y, axis.x) * half.y + self.margin_m
    }

    /// Whether the bodies of two vehicles may meet, as upright boxes: the physics has pairs of them long before they touch, and
    /// what it keeps of a pair depends on when it began.
    fn is_near(&self, other: &Self) -> bool {
        let apart = (self.outline.centre - other.outline.centre).abs();
        (self.gives_way || other.gives_way) && apart.cmple(self.upright_half() + other.upright_half()).all()
    }

    fn overlaps(&self, other: &Self) -> bool {
        let reach = self.radius_m + other.radius_m + ROUNDING_M;
        self.outline.centre.distance_squared(other.outline.centre) < reach * reach
            && self.outline.overlap(&other.outline).is_some()
    }
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
    /// Finds the contacts of a tick and adds an event for each that is new, and whose bodies are near others. `vehicles` are in
    /// id order, with a place for each.
    pub fn find(
        &mut self,
        (vehicles, places): (&[SimVehicle], &mut [Place]),
        solids: &StaticObstacles,
        time_s: f64,
        events: &mut Vec<Event>,
    ) {
        self.release(vehicles, places, solids);
        let mut found: Vec<(VehicleId, VehicleId)> = Vec::new();
        let seen = Cell::from_mut(&mut *places).as_slice_of_cells();
        self.neighbours.pairs(seen.iter().map(|place| place.get().circle()), |a, b| {
            let (one, other) = (seen[a].get(), seen[b].get());
            if one.is_near(&other) {
                seen[a].set(Place { is_near: true, ..one });
                seen[b].set(Place { is_near: true, ..other });
            }
            if one.overlaps(&other) {
                let (low, high) = (a.min(b), a.max(b));
                found.push((vehicles[low].state.id, vehicles[high].state.id));
            }
        });
        found.sort_unstable();
        for (vehicle, with) in found {
            if self.touching.insert((vehicle, with)) {
                events.push(Event { time_s, vehicle, kind: EventKind::Collision { with } });
            }
        }
        for (vehicle, place) in vehicles.iter().zip(places) {
            let half = place.upright_half().max(DVec2::splat(place.radius_m));
            if solids.within(place.outline.centre, half).next().is_none() {
                continue;
            }
            place.is_near |= place.gives_way;
            let id = vehicle.state.id;
            if let Some(solid) = solids.touching(&place.outline)
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

    fn release(&mut self, vehicles: &[SimVehicle], places: &[Place], solids: &StaticObstacles) {
        let grown = |id: VehicleId| {
            let index = vehicles.binary_search_by_key(&id, |vehicle| vehicle.state.id).ok()?;
            let outline = places[index].outline;
            Some(OrientedRect { half: outline.half + APART_M / 2.0, ..outline })
        };
        self.touching.retain(|&(a, b)| grown(a).zip(grown(b)).is_some_and(|(a, b)| a.overlap(&b).is_some()));
        self.touching_solid
            .retain(|&id| grown(id).is_some_and(|outline| solids.touching(&outline).is_some()));
    }
}
