//! What stands around a place: whether there is room for more.

use super::grounds::{covers, distance_to};
use super::roads::RoadField;
use crate::city::{CityMap, Scenery, SceneryKind, Shape};
use glam::Vec2;

/// Off the road, street furniture keeps so far from it and from what else stands there, metres.
const OFF_ROAD_M: f32 = 1.0;
const APART_M: f64 = 0.5;
/// Who comes through a door wants this much room to both sides, metres.
const WAY_M: f64 = 1.0;

/// The pieces of a map's scenery; one of them asks about all others.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    pub(super) map: &'a CityMap,
    pub(super) field: &'a RoadField,
}

impl Surroundings<'_> {
    fn others(&self, but: &Scenery) -> impl Iterator<Item = &Scenery> {
        self.map.scenery.iter().filter(move |piece| !std::ptr::eq(*piece, but))
    }

    /// Whether a place is off the road, and clear of all that stands but this piece.
    pub(super) fn is_free(&self, at: Vec2, but: &Scenery) -> bool {
        let at = at.as_dvec2();
        let stands = |piece: &&Scenery| {
            !matches!(piece.kind, SceneryKind::Grass | SceneryKind::Paving | SceneryKind::Tree)
        };
        self.field.distance.at(at) > OFF_ROAD_M
            && self.others(but).filter(stands).all(|piece| distance_to(&piece.shape, at) > APART_M)
    }

    /// Whether another building than this one stands there.
    pub(super) fn is_built(&self, at: Vec2, but: &Scenery) -> bool {
        let is_building = |piece: &&Scenery| piece.kind == SceneryKind::Building;
        self.others(but).filter(is_building).any(|piece| covers(&piece.shape, at.as_dvec2()))
    }

    /// Whether a trunk, a post, a hedge or a wall is in the way of who walks there.
    pub(super) fn bars_the_way(&self, at: Vec2) -> bool {
        let away = |piece: &Scenery| match (piece.kind, &piece.shape) {
            (SceneryKind::Tree | SceneryKind::Lamp, Shape::Circle { centre, .. }) => {
                centre.distance(at.as_dvec2())
            }
            (SceneryKind::Hedge | SceneryKind::Wall, shape) => distance_to(shape, at.as_dvec2()),
            _ => f64::INFINITY,
        };
        self.map.scenery.iter().any(|piece| away(piece) < WAY_M)
    }
}
