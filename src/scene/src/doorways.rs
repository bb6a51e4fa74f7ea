//! Doors of houses and the ways to them: a garden path from the pavement, and openings in what would bar it.

use super::grounds::{covers, distance_to};
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::Region;
use super::roads::{PAVEMENT_M, RoadField, SHOULDER_M, level};
use city3d_roadmap::{CityMap, Footprint, Scenery, SceneryKind};
use glam::{DVec2, Vec2};

const PATH: Finish = Finish::new(Surface::Slabs, [182, 174, 160], Class::Pavement);
/// Over lawns, under steps of doors and paths of the map.
const HEIGHT_M: f32 = 0.150;
const HALF_M: f64 = 0.65;
/// The step before a door, at whose edge the path begins.
const STEP_M: f64 = 0.55;
/// Longest way to a door, and how much of it stays open where there is none.
const LONGEST_M: f64 = 16.0;
const BEFORE_DOOR_M: f64 = 2.6;
/// Where a path turns that cannot go straight on, and by how much.
const TURN_AT_M: f64 = 1.4;
const TURNS_RAD: [f64; 6] = [0.5, -0.5, 0.9, -0.9, 1.25, -1.25];
/// Trunks and posts keep this far from the middle of a path, other things from its edges.
const OFF_POSTS_M: f64 = 0.85;
const LOOK_M: f64 = 0.25;
/// From the middle of a path to the middle of the end of a hedge or a wall beside it.
const OPEN_M: f64 = 1.2;
const ONTO_PAVEMENT_M: f64 = 1.0;
/// Shorter remains of hedges and walls are left out.
const REMAINS_M: f64 = 0.7;

/// A door, seen from above.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doorway {
    /// Foot of the wall in the middle of the door.
    pub(super) at: Vec2,
    /// Unit vector out of the house.
    pub(super) out: Vec2,
}

/// What is kept free before a door.
#[derive(Clone, Debug)]
pub(super) struct Way {
    /// From the foot of the door outwards, straight or with one turn.
    line: Vec<DVec2>,
    /// Whether it has come to paved ground.
    is_whole: bool,
    /// Whether it begins at a back door, before which a garden may be.
    is_back: bool,
}

/// What may be in the way of a path, and where it may end.
struct Ground<'a> {
    near: Vec<&'a Scenery>,
    field: &'a RoadField,
}

impl Ground<'_> {
    fn is_paved(&self, at: DVec2) -> bool {
        let is_paving = |piece: &Scenery| matches!(piece.kind, SceneryKind::Paving | SceneryKind::Parking);
        self.field.distance.at(at) < SHOULDER_M + PAVEMENT_M
            || self.near.iter().any(|piece| is_paving(piece) && covers(&piece.shape, at))
    }

    /// Whether something stands there through which no opening is made.
    fn is_barred(&self, at: DVec2) -> bool {
        self.near.iter().any(|piece| match (piece.kind, &piece.shape) {
            (SceneryKind::Tree | SceneryKind::Lamp, Footprint::Circle { centre, .. }) => {
                centre.distance(at) < OFF_POSTS_M
            }
            (SceneryKind::Building, shape) => covers(shape, at),
            (
                SceneryKind::Hedge
                | SceneryKind::Wall
                | SceneryKind::Grass
                | SceneryKind::Paving
                | SceneryKind::Parking
                | SceneryKind::Tree,
                _,
            ) => false,
            (_, shape) => distance_to(shape, at) < HALF_M,
        })
    }

    /// The first paved place on a straight way, unless something bars it.
    fn paved_ahead(&self, from: DVec2, ahead: DVec2) -> Option<DVec2> {
        let looks = (1..).map(|k| f64::from(k) * LOOK_M).take_while(|&away| away < LONGEST_M);
        let mut places = looks.map(|away| from + ahead * away);
        places.find(|&at| self.is_paved(at) || self.is_barred(at)).filter(|&at| self.is_paved(at))
    }
}

impl Way {
    /// The way from a door to the pavement, or a few steps of it.
    pub(super) fn new(door: &Doorway, map: &CityMap, field: &RoadField) -> Self {
        let (from, out) = (door.at.as_dvec2(), door.out.as_dvec2());
        let is_near = |piece: &&Scenery| distance_to(&piece.shape, from) < TURN_AT_M + LONGEST_M;
        let ground = Ground { near: map.scenery.iter().filter(is_near).collect(), field };
        if let Some(to) = ground.paved_ahead(from, out) {
            return Self { line: vec![from, to], is_whole: true, is_back: false };
        }
        let elbow = from + out * TURN_AT_M;
        let is_open = [0.4, 0.7, 1.0].iter().all(|&share| !ground.is_barred(from.lerp(elbow, share)));
        let mut turned = TURNS_RAD.map(|turn| DVec2::from_angle(turn).rotate(out)).into_iter();
        match turned.find_map(|ahead| ground.paved_ahead(elbow, ahead)).filter(|_| is_open) {
            Some(to) => Self { line: vec![from, elbow, to], is_whole: true, is_back: false },
            None => Self { is_back: false, ..Self::back(door) },
        }
    }

    /// A few steps from a back door.
    pub(super) fn back(door: &Doorway) -> Self {
        let (from, out) = (door.at.as_dvec2(), door.out.as_dvec2());
        Self { line: vec![from, from + out * BEFORE_DOOR_M], is_whole: false, is_back: true }
    }

    /// Foot of the door, if it is a back door.
    pub(super) fn back_door(&self) -> Option<DVec2> {
        self.is_back.then(|| self.line[0])
    }

    /// The path, where there is lawn between the door and the pavement.
    pub(super) fn lay(&self, mesh: &mut Mesh) {
        let last = self.line.len() - 1;
        if !self.is_whole || self.line[0].distance(self.line[last]) < STEP_M + LOOK_M {
            return;
        }
        let along: Vec<DVec2> =
            self.line.windows(2).map(|pair| (pair[1] - pair[0]).normalize_or(DVec2::X)).collect();
        let mut line = self.line.clone();
        line[0] += along[0] * STEP_M;
        line[last] += along[last - 1] * 0.1;
        let half = |k: usize| {
            let [before, after] = [along[k.saturating_sub(1)], along[k.min(last - 1)]];
            (before + after).perp() * (HALF_M / (1.0 + before.dot(after)))
        };
        for k in 0..last {
            let [a, b] = [k, k + 1].map(|k| [line[k] - half(k), line[k] + half(k)]);
            level(mesh, &Region::simple(&[a[0], b[0], b[1], a[1]]), HEIGHT_M, PATH, 1.9);
        }
    }

    /// The place before the step: no garden may contain it.
    pub(super) fn threshold(&self) -> DVec2 {
        self.line[0] + (self.line[1] - self.line[0]).clamp_length_max(STEP_M)
    }

    /// Distance from the line straight out of the door, over the pavement to the kerb.
    pub(super) fn off_approach_m(&self, at: DVec2) -> f64 {
        const TO_KERB_M: f64 = 3.4;
        let out = (self.line[1] - self.line[0]).normalize_or_zero();
        distance_to(&Footprint::Polyline(vec![self.line[0], self.line[0] + out * TO_KERB_M]), at)
    }

    /// Distance from its line, which goes on a little: hedges stand on the edges of pavements too.
    fn distance_m(&self, at: DVec2) -> f64 {
        let mut line = self.line.clone();
        let last = line.len() - 1;
        let onto = (line[last] - line[last - 1]).normalize_or_zero() * ONTO_PAVEMENT_M;
        line[last] += onto;
        distance_to(&Footprint::Polyline(line), at)
    }
}

/// What is left of a hedge or a wall with openings at all ways that it crosses, and where it has no room.
pub(super) fn opened(line: &[DVec2], ways: &[Way], has_room: &dyn Fn(DVec2) -> bool) -> Vec<Vec<DVec2>> {
    /// Length of the pieces of which each stays or goes as a whole.
    const PIECE_M: f64 = 0.1;
    let touches = |way: &&Way| {
        let last = way.line[way.line.len() - 1];
        let reach = OPEN_M + ONTO_PAVEMENT_M + TURN_AT_M + way.line[0].distance(last);
        distance_to(&Footprint::Polyline(line.to_vec()), way.line[0]) < reach
    };
    let ways: Vec<&Way> = ways.iter().filter(touches).collect();
    let is_open = |at: DVec2| !has_room(at) || ways.iter().any(|way| way.distance_m(at) < OPEN_M);
    let mut runs: Vec<Vec<DVec2>> = Vec::new();
    let mut run: Vec<DVec2> = Vec::new();
    for pair in line.windows(2) {
        let count = (pair[0].distance(pair[1]) / PIECE_M).ceil().max(1.0) as u32;
        for k in 0..=count {
            let at = pair[0].lerp(pair[1], f64::from(k) / f64::from(count));
            if is_open(at) {
                runs.push(std::mem::take(&mut run));
                continue;
            }
            // Between corners only the last place counts.
            if k > 1 && run.len() > 1 {
                run.pop();
            }
            if run.last() != Some(&at) {
                run.push(at);
            }
        }
    }
    runs.push(run);
    let length_m = |run: &[DVec2]| run.windows(2).map(|pair| pair[0].distance(pair[1])).sum::<f64>();
    runs.retain(|run| length_m(run) > REMAINS_M);
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hedge_has_an_opening_at_each_way_and_keeps_its_corners() {
        let way = |x: f64| Way {
            line: vec![DVec2::new(x, 0.0), DVec2::new(x, 6.0)],
            is_whole: true,
            is_back: false,
        };
        let line = [DVec2::new(-8.0, 3.0), DVec2::new(8.0, 3.0), DVec2::new(8.0, 20.0)];
        assert_eq!(opened(&line, &[way(40.0)], &|_| true), [line.to_vec()]);
        let left = opened(&line, &[way(0.0)], &|_| true);
        assert_eq!(left.len(), 2, "{left:?}");
        assert!(left[0][1].x < -OPEN_M + 1e-9 && left[0][1].x > -OPEN_M - 0.2, "{left:?}");
        assert_eq!(left[1][1..], line[1..]);
        // Nothing is left between two doors side by side.
        assert_eq!(opened(&line, &[way(-1.0), way(1.5)], &|_| true).len(), 2);
    }
}
