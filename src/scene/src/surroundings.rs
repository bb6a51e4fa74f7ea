//! Free-space queries around a point of the map.

use super::grounds::{covers, distance_to};
use super::places::box_of;
use super::roads::{RoadField, SHOULDER_M};
use super::trees;
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use glam::{DVec2, Vec2};

/// Clearance of street furniture from the road and from other objects, metres.
const OFF_ROAD_M: f32 = 1.0;
const APART_M: f64 = 0.5;
/// Clearance in front of a door to both sides, metres.
const WAY_M: f64 = 1.0;

/// The scenery of a map, queried by one item about all others.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    pub(super) map: &'a CityMap,
    pub(super) field: &'a RoadField,
}

impl Surroundings<'_> {
    fn others(&self, but: &Scenery) -> impl Iterator<Item = &Scenery> {
        self.map.scenery.iter().filter(move |piece| !std::ptr::eq(*piece, but))
    }

    /// Whether a point is off the road and clear of all other items.
    pub(super) fn is_free(&self, at: Vec2, but: &Scenery) -> bool {
        let at = at.as_dvec2();
        let stands = |piece: &&Scenery| {
            !matches!(piece.kind, SceneryKind::Grass | SceneryKind::Paving | SceneryKind::Tree)
        };
        self.field.distance.at(at) > OFF_ROAD_M
            && self.others(but).filter(stands).all(|piece| distance_to(&piece.shape, at) > APART_M)
    }

    /// Whether another building covers the point.
    pub(super) fn is_built(&self, at: Vec2, but: &Scenery) -> bool {
        let is_building = |piece: &&Scenery| piece.kind == SceneryKind::Building;
        self.others(but).filter(is_building).any(|piece| covers(&piece.shape, at.as_dvec2()))
    }

    /// Whether a trunk, post, hedge or wall blocks a pedestrian there.
    pub(super) fn bars_the_way(&self, at: Vec2) -> bool {
        let is_barrier = |piece: &&Scenery| matches!(piece.kind, SceneryKind::Hedge | SceneryKind::Wall);
        let mut barriers = self.map.scenery.iter().filter(is_barrier);
        self.has_post(at) || barriers.any(|piece| distance_to(&piece.shape, at.as_dvec2()) < WAY_M)
    }

    /// Where a hedge leaves a pavement before it, or at least does not wall up the houses behind.
    pub(super) fn room_for_hedge(&self, hedge: &Scenery) -> impl Fn(DVec2) -> bool {
        const OFF_KERB_M: f32 = 1.6;
        const OFF_HOUSES_M: f64 = 3.5;
        let [low, high] = box_of(hedge);
        let is_near = |home: &&Scenery| {
            let [from, to] = box_of(home);
            from.cmple(high + OFF_HOUSES_M).all() && to.cmpge(low - OFF_HOUSES_M).all()
        };
        let homes = self.map.scenery.iter().filter(|piece| piece.kind == SceneryKind::Building);
        let homes: Vec<&Scenery> = homes.filter(is_near).collect();
        let field = self.field;
        move |at| {
            field.distance.at(at) > SHOULDER_M + OFF_KERB_M
                || homes.iter().all(|home| distance_to(&home.shape, at) > OFF_HOUSES_M)
        }
    }

    /// Whether a crown, a post, or the traffic at a kerb is where an awning would reach, somewhat over its edge.
    pub(super) fn bars_an_awning(&self, at: Vec2) -> bool {
        const OVER_EDGE_M: f64 = 0.45;
        const OFF_KERB_M: f32 = 0.8;
        let is_there = |piece: &Scenery| {
            let reach_m = match piece.kind {
                SceneryKind::Tree => trees::REACH,
                SceneryKind::Lamp => 1.0,
                _ => return false,
            };
            match piece.shape {
                Footprint::Circle { centre, radius_m } => {
                    centre.distance(at.as_dvec2()) < f64::from(reach_m) * radius_m + OVER_EDGE_M
                }
                _ => false,
            }
        };
        self.field.distance.at(at.as_dvec2()) < SHOULDER_M + OFF_KERB_M
            || self.map.scenery.iter().any(is_there)
    }

    /// Whether a trunk or post does.
    pub(super) fn has_post(&self, at: Vec2) -> bool {
        self.map.scenery.iter().any(|piece| match (piece.kind, &piece.shape) {
            (SceneryKind::Tree | SceneryKind::Lamp, Footprint::Circle { centre, .. }) => {
                centre.distance(at.as_dvec2()) < WAY_M
            }
            _ => false,
        })
    }
}
