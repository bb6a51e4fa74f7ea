//! Aprons: paved ground from wide gates to the road, over a lowered kerb.

use super::grounds::covers;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::places::Disc;
use super::polygon::Region;
use super::roads::{PAVEMENT_M, RoadField, SHOULDER_M, level};
use city3d_roadmap::{CityMap, Footprint, SceneryKind};
use glam::{DVec2, Vec2};

const CONCRETE: Finish = Finish::new(Surface::Concrete, [150, 148, 142], Class::Pavement);
/// Over lawns, under steps.
const HEIGHT_M: f32 = 0.149;
const LONGEST_M: f64 = 18.0;
const LOOK_M: f64 = 0.2;
/// From the ends of a wall to the gates.
const INSET_M: f64 = 0.4;
/// Radius of the discs that nothing else may take, and from one to the next.
const DISC_M: f64 = 0.7;
const DISCS_APART_M: f64 = 1.0;

/// A wall with gates, seen from above: its ends, and the unit vector out of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gateway {
    pub(super) ends: [Vec2; 2],
    pub(super) out: Vec2,
}

/// The ground before gates.
pub(super) struct Apron {
    /// Two corners at the wall, and two at the face of the kerb.
    corners: [DVec2; 4],
    /// How far it is paved at its two sides, none where the map has paving.
    paved_m: Option<[f64; 2]>,
    out: DVec2,
}

impl Apron {
    /// That of gates, if nothing bars the way to a road.
    pub(super) fn new(gates: &Gateway, map: &CityMap, field: &RoadField) -> Option<Self> {
        let out = gates.out.as_dvec2();
        let [a, b] = gates.ends.map(|end| end.as_dvec2());
        let inset = (b - a).normalize_or_zero() * INSET_M;
        let ends = [a + inset, b - inset];
        let bars = |at: DVec2| {
            map.scenery.iter().any(|piece| {
                let may_bar = matches!(piece.kind, SceneryKind::Building | SceneryKind::Water);
                may_bar && covers(&piece.shape, at)
            })
        };
        let within = |from: DVec2, off_road_m: f32| {
            let looks = (1..).map(|k| f64::from(k) * LOOK_M).take_while(|&away| away < LONGEST_M);
            let mut looks = looks.take_while(|&away| !bars(from + out * away));
            looks.find(|&away| field.distance.at(from + out * away) < off_road_m)
        };
        let kerb = [within(ends[0], SHOULDER_M)?, within(ends[1], SHOULDER_M)?];
        let pavement = ends.map(|end| within(end, SHOULDER_M + PAVEMENT_M - 0.1).unwrap_or(0.0));
        let middle = (ends[0] + ends[1]) / 2.0 + out * (0.25 * (pavement[0] + pavement[1]));
        let is_paved = map.scenery.iter().any(|piece| {
            matches!(piece.kind, SceneryKind::Paving | SceneryKind::Parking) && covers(&piece.shape, middle)
        });
        Some(Self {
            corners: [ends[0], ends[1], ends[1] + out * kerb[1], ends[0] + out * kerb[0]],
            paved_m: (!is_paved).then_some(pavement),
            out,
        })
    }

    pub(super) fn lay(&self, mesh: &mut Mesh) {
        let Some([left_m, right_m]) = self.paved_m else { return };
        let [a, b, ..] = self.corners;
        let ring = [a, b, b + self.out * right_m, a + self.out * left_m];
        level(mesh, &Region::simple(&ring), HEIGHT_M, CONCRETE, 3.0);
    }

    /// Its outline, before which the kerb is lowered.
    pub(super) fn shape(&self) -> Footprint {
        Footprint::Polygon(self.corners.to_vec())
    }

    /// What nothing else may take.
    pub(super) fn discs(&self) -> Vec<Disc> {
        let [a, b, c, d] = self.corners;
        let count = |length_m: f64| (length_m / DISCS_APART_M).ceil().max(1.0) as u32;
        let (across, along) = (count(a.distance(b)), count(a.distance(d).max(b.distance(c))));
        let at = |x: u32, y: u32| {
            let [x, y] = [f64::from(x) / f64::from(across), f64::from(y) / f64::from(along)];
            a.lerp(b, x).lerp(d.lerp(c, x), y)
        };
        let rows = (0..=along).flat_map(|y| (0..=across).map(move |x| (x, y)));
        rows.map(|(x, y)| (at(x, y), DISC_M)).collect()
    }
}
