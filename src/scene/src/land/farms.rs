//! Farms beside the roads of the land: a house, barns, a silo and a yard.

use super::super::buildings;
use super::super::lanes::LaneBoxIndex;
use super::super::mesh::{Class, Finish, Mesh, Surface};
use super::super::surroundings::Surroundings;
use super::super::{SceneObject, SeededScenery, hash_to_unit};
use super::country_roads::{CountryRoad, VERGE_M};
use super::relief::{Relief, Yard, seed_at};
use super::sheds::Shed;
use super::woods::Woods;
use city3d_roadmap::{Footprint, Scenery, SceneryKind};
use glam::{DVec2, Vec3};

const GROUND: Finish = Finish::new(Surface::Gravel, [176, 162, 138], Class::Pavement);
const BARNS: [Finish; 3] = [
    Finish::new(Surface::Wood, [124, 66, 50], Class::Building),
    Finish::new(Surface::Wood, [112, 96, 78], Class::Building),
    Finish::new(Surface::Brick, [196, 140, 112], Class::Building),
];
const ROOFS: [Finish; 3] = [
    Finish::new(Surface::RoofTiles, [150, 84, 64], Class::Building),
    Finish::new(Surface::RoofTiles, [104, 102, 106], Class::Building),
    Finish::new(Surface::Metal, [126, 132, 134], Class::Building),
];
const SILO: Finish = Finish::new(Surface::Metal, [172, 178, 176], Class::Building);
/// Radius of the level place, and how far its edge is from the road.
const YARD_M: f64 = 30.0;
const OFF_ROAD_M: f64 = 1.0;
/// Where farms lie along a road, and how far from each other.
const FROM_M: f64 = 150.0;
const TO_M: f64 = 1000.0;
const APART_M: f64 = 230.0;
const MOST: usize = 7;
/// The farm of a road is looked for at each of these steps.
const STEP_M: f64 = 35.0;

/// A farm: its yard, with the road to its right.
#[derive(Clone, Copy, Debug)]
pub(super) struct Farm {
    pub(super) yard: Yard,
    /// Direction of the road.
    along: DVec2,
    seed: u32,
}

/// Places for farms beside roads, off the woods.
pub(super) fn farms(relief: &Relief, roads: &[CountryRoad], woods: Woods<'_>) -> Vec<Farm> {
    let mut farms: Vec<Farm> = Vec::new();
    for road in roads {
        let mut gone_m = 0.0;
        let mut next_m = FROM_M;
        for pair in road.line.windows(2) {
            gone_m += pair[0].distance(pair[1]);
            if gone_m < next_m || gone_m > TO_M {
                continue;
            }
            next_m = gone_m + STEP_M;
            let seed = seed_at(pair[0].as_ivec2().to_array());
            let side = if hash_to_unit(seed, 91) < 0.5 { 1.0 } else { -1.0 };
            let along = (pair[1] - pair[0]).normalize_or(DVec2::X) * side;
            let at = pair[1] + along.perp() * (road.half_m + VERGE_M + OFF_ROAD_M + YARD_M);
            let is_clear = farms.iter().all(|farm| farm.yard.at.distance(at) > APART_M)
                && relief.away_m(at) > FROM_M
                && roads.iter().all(|road| road.clearance_m(at, YARD_M) > YARD_M)
                && (0..8).all(|k| {
                    let turn = std::f64::consts::TAU * f64::from(k) / 8.0;
                    woods.depth_at(at + DVec2::from_angle(turn) * YARD_M) < 0.0
                });
            if is_clear && farms.len() < MOST && hash_to_unit(seed, 92) < 0.7 {
                let height_m = relief.open_height_at(at.lerp(pair[1], 0.5));
                farms.push(Farm { yard: Yard { at, radius_m: YARD_M, height_m }, along, seed });
            }
        }
    }
    farms
}

impl Farm {
    /// A place in the frame of the yard: along the road, away from it.
    fn place(&self, along: f64, away: f64) -> DVec2 {
        self.yard.at + self.along * along + self.along.perp() * away
    }

    fn hash(&self, salt: u32) -> f32 {
        hash_to_unit(self.seed, salt)
    }

    /// The gravel of the yard, with the drive to the road.
    pub(super) fn ground(&self, mesh: &mut Mesh) {
        const OVER_GROUND_M: f64 = 0.05;
        let z = (self.yard.height_m + OVER_GROUND_M) as f32;
        let edge = -YARD_M - OFF_ROAD_M;
        for ring in [
            [(-17.0, -15.0), (17.0, -15.0), (17.0, 13.0), (-17.0, 13.0)],
            [(2.0, edge), (7.0, edge), (7.0, -15.0), (2.0, -15.0)],
        ] {
            let corners = ring.map(|(along, away)| self.place(along, away).as_vec2().extend(z));
            mesh.plate(&corners, GROUND, 3.0);
        }
    }

    /// Its buildings.
    pub(super) fn buildings(&self, lanes: &LaneBoxIndex<'_>, around: &Surroundings<'_>) -> Vec<SceneObject> {
        let up = Vec3::Z * self.yard.height_m as f32;
        let mut house = Mesh::default();
        let ring = [(-19.0, -12.0), (-8.0, -12.0), (-8.0, -4.0), (-19.0, -4.0)];
        let piece = Scenery {
            kind: SceneryKind::Building,
            name: "farm house".to_owned(),
            height_m: Some(8.2 + 1.6 * f64::from(self.hash(93))),
            front_rad: Some(self.along.to_angle()),
            shape: Footprint::Polygon(ring.map(|(along, away)| self.place(along, away)).to_vec()),
        };
        let place = SeededScenery { piece: &piece, seed: self.seed };
        // Too far away for gutters and the like.
        let mut trim = Mesh::default();
        buildings::building([&mut house, &mut trim], &place, lanes, around);
        house.vertices.iter_mut().for_each(|v| v.position += up);
        let mut barns = Mesh::default();
        let pick = |finishes: &[Finish; 3], salt| finishes[(self.hash(salt) * 3.0) as usize % 3];
        let (walls, roof) = (pick(&BARNS, 94), pick(&ROOFS, 95));
        let shed = |along: f64, away: f64, ridge: DVec2, size: [f32; 4]| {
            let [length_m, width_m, eaves_m, rise_m] = size;
            let at = self.place(along, away).as_vec2().extend(0.0) + up;
            Shed { at, along: ridge.as_vec2(), length_m, width_m, eaves_m, rise_m, walls, roof }
        };
        shed(2.0, 15.0, self.along, [24.0, 11.0, 4.6, 3.6]).draw(&mut barns);
        let cross =
            Shed { roof: pick(&ROOFS, 96), ..shed(19.0, 0.0, self.along.perp(), [15.0, 8.0, 3.4, 2.4]) };
        cross.draw(&mut barns);
        if self.hash(97) < 0.6 {
            let foot = self.place(-15.0, 14.0).as_vec2().extend(0.0) + up;
            barns.frustum(foot, [2.0, 2.0], 8.5, 10, SILO);
            barns.frustum(foot + Vec3::Z * 8.5, [2.0, 0.0], 1.1, 10, SILO.shaded(0.9));
        }
        [house, barns].map(SceneObject::of_one_level).to_vec()
    }

    /// Where trees of the farm stand, with the radius of their crowns.
    pub(super) fn trees(&self) -> impl Iterator<Item = (DVec2, f64)> {
        let places = [(-23.0, -6.0), (-20.0, 6.0), (-5.0, -17.0), (13.0, -18.0), (22.0, 14.0), (-8.0, 23.0)];
        places.into_iter().zip(0..).map(|((along, away), k)| {
            let sway = |salt| 3.0 * (f64::from(self.hash(salt + k)) - 0.5);
            (self.place(along + sway(100), away + sway(110)), 2.6 + 1.4 * f64::from(self.hash(120 + k)))
        })
    }

    /// Seed of its trees.
    pub(super) fn seed(&self) -> u32 {
        self.seed
    }
}
