//! People on pavements and benches, alone and in company. They are scenery: nothing collides with them, and they stay in
//! their pose.

mod body;
mod figure;
mod head;
mod loft;
mod look;

use super::bicycles;
use super::crossings::{Crossing, DEEP_M};
use super::ground_sheet::KERB_M;
use super::mesh::Mesh;
use super::places::{KerbRow, Places, along_kerb, is_island};
use super::{LodMesh, SceneObject, hash_to_unit};
use city3d_roadmap::{CityMap, SceneryKind};
use figure::{Model, POSES, Pose};
use glam::{Affine3A, DVec2, Quat, Vec3};
use look::{Look, Outfit};
use std::f32::consts::{PI, TAU};

/// Where people are along a kerb.
const ROW: KerbRow = KerbRow { spacing_m: 5.2, off_kerb_m: [0.85, 1.6], salt: 11 };
/// Radii of what people take of the pavement: who stands, who walks, a child, half a bicycle.
const STANDING_M: f64 = 0.36;
const WALKING_M: f64 = 0.48;
const CHILD_M: f64 = 0.28;
const WHEEL_M: f64 = 0.42;
/// Who walks side by side, and who talks face to face, from one to the other.
const ABREAST_M: f64 = 0.98;
const FACING_M: f64 = 0.92;
/// From who leads a child to the child, whose height is this share of that of a grown-up.
const LEADING_M: f64 = 0.66;
const CHILD: f32 = 0.66;
/// Share of the ends of crossings where somebody waits, and how far behind the kerb.
const WAITING: f32 = 0.45;
const WAITS_OFF_M: f64 = 0.75;
/// Seat of a bench, and where on it people sit, along it.
const SEAT_M: f32 = 0.58;
const SEATS_M: [f32; 2] = [-0.42, 0.40];
const SEATED: f32 = 0.35;
/// From which error on nobody is drawn: that is how tall people are.
const UNDRAWN_M: f32 = 1.75;

/// Who is at a place of the pavement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Company {
    Walker(Pose),
    Abreast,
    WithChild,
    Talking,
    Standing(Pose),
    WithBicycle,
}

impl Company {
    /// Drawn by shares of 100.
    fn drawn(seed: u32) -> Self {
        match (hash_to_unit(seed, 3) * 100.0) as u32 {
            0..17 => Self::Walker(Pose::Stride),
            17..32 => Self::Walker(Pose::Pass),
            32..43 => Self::Walker(Pose::Carry),
            43..54 => Self::Abreast,
            54..63 => Self::WithChild,
            63..77 => Self::Talking,
            77..85 => Self::Standing(Pose::Phone),
            85..90 => Self::Standing(Pose::Stand),
            90..94 => Self::Standing(Pose::Pockets),
            _ => Self::WithBicycle,
        }
    }
}

/// One of a company.
#[derive(Clone, Copy, Debug)]
struct Person {
    pose: Pose,
    /// On the ground.
    at: DVec2,
    yaw_rad: f32,
    /// As a share of the height of the models.
    tall: f32,
}

/// The people of a city so far.
struct Crowd {
    /// With loose hair, or with other.
    models: Vec<((Model, bool), SceneObject)>,
    has_close_ups: bool,
    bicycle: SceneObject,
    last_coat: usize,
    objects: Vec<SceneObject>,
}

impl Crowd {
    fn new(has_close_ups: bool) -> Self {
        let both = [false, true];
        let of = |pose| {
            let with = move |has_long_hair| both.map(|is_light| Model { pose, has_long_hair, is_light });
            both.into_iter().flat_map(with)
        };
        let models = POSES
            .into_iter()
            .flat_map(of)
            .flat_map(|model| both.map(|is_loose| ((model, is_loose), figure::object(model, is_loose))));
        Self {
            models: models.collect(),
            has_close_ups,
            bicycle: bicycles::bicycle(),
            last_coat: usize::MAX,
            objects: Vec::new(),
        }
    }

    fn add(&mut self, seed: u32, person: &Person, height_m: f32) {
        let [has_long_hair, is_light] =
            [(1, 0.5), (20, 0.45)].map(|(salt, share)| hash_to_unit(seed, salt) < share);
        let wanted = Model { pose: person.pose, has_long_hair, is_light };
        let look = Look::drawn(seed, wanted);
        let key = (wanted, look.cut.is_loose());
        let Some((_, model)) = self.models.iter().find(|(of, _)| *of == key) else { return };
        let outfit = Outfit::drawn(seed, look, &mut self.last_coat);
        let turn = Quat::from_rotation_z(person.yaw_rad);
        let at = person.at.as_vec2().extend(height_m);
        let here = Affine3A::from_scale_rotation_translation(Vec3::splat(person.tall), turn, at);
        let mut model = model.clone();
        if self.has_close_ups {
            model = model.with_close_up(figure::close_up(wanted, look));
        }
        let mut object = model.placed(here, |part| outfit.dressed(part));
        object.levels.push(LodMesh { mesh: Mesh::default(), error_m: UNDRAWN_M });
        self.objects.push(object);
        if person.pose == Pose::Wheel {
            let beside = Affine3A::from_rotation_translation(turn, at - turn * figure::WHEELS_M);
            self.objects.push(bicycles::painted(&self.bicycle, beside, seed));
        }
    }
}

/// A company around a place, and the discs that it takes; the direction is that of the kerb, which is to the left.
fn company(of: Company, seed: u32, at: DVec2, along: DVec2) -> (Vec<Person>, Vec<(DVec2, f64)>) {
    let draw = |salt: u32| hash_to_unit(seed, salt);
    let tall = |salt: u32| 0.93 + 0.12 * draw(salt);
    // Both ways, and not quite straight.
    let ahead = along * f64::from((draw(4) - 0.5).signum());
    let ahead = DVec2::from_angle(f64::from(0.2 * (draw(5) - 0.5))).rotate(ahead);
    let yaw_rad = ahead.as_vec2().to_angle();
    let one = |pose: Pose| Person { pose, at, yaw_rad, tall: tall(2) };
    match of {
        Company::Walker(Pose::Pass) => (vec![one(Pose::Pass)], vec![(at, STANDING_M)]),
        Company::Walker(pose) => (vec![one(pose)], vec![(at, WALKING_M)]),
        Company::Abreast => {
            let beside = at + ahead.perp() * ABREAST_M;
            let poses = if draw(6) < 0.5 { [Pose::Stride, Pose::Pass] } else { [Pose::Pass, Pose::Carry] };
            let other = Person { pose: poses[1], at: beside, yaw_rad, tall: tall(16) };
            (vec![one(poses[0]), other], vec![(at, WALKING_M), (beside, WALKING_M)])
        }
        Company::WithChild => {
            let child_at = at - ahead.perp() * LEADING_M;
            let child = Person { pose: Pose::Child, at: child_at, yaw_rad, tall: CHILD };
            let parent = Person { tall: 1.0, ..one(Pose::Lead) };
            // Their hands meet.
            (vec![parent, child], vec![(at, STANDING_M), (child_at, CHILD_M)])
        }
        Company::Talking => {
            let towards = DVec2::from_angle(f64::from(TAU * draw(6)));
            let other_at = at + towards * FACING_M;
            let facing = towards.as_vec2().to_angle();
            let listening = if draw(7) < 0.5 { Pose::Akimbo } else { Pose::Pockets };
            let speaker = Person { yaw_rad: facing, ..one(Pose::Talk) };
            let other = Person { pose: listening, at: other_at, yaw_rad: facing + PI, tall: tall(16) };
            (vec![speaker, other], vec![(at, STANDING_M), (other_at, STANDING_M)])
        }
        Company::Standing(pose) => {
            (vec![Person { yaw_rad: TAU * draw(6), ..one(pose) }], vec![(at, STANDING_M)])
        }
        Company::WithBicycle => {
            let middle = at - ahead.perp() * f64::from(figure::WHEELS_M.y);
            let half = ahead * 0.5;
            let person = Person { tall: 1.0, ..one(Pose::Wheel) };
            (vec![person], vec![(at, STANDING_M), (middle + half, WHEEL_M), (middle - half, WHEEL_M)])
        }
    }
}

/// People along the kerbs, whose rings have the road to their left, at crossings, and on benches.
pub(super) fn people(
    (map, has_close_ups): (&CityMap, bool),
    kerbs: &[Vec<DVec2>],
    crossings: &[Crossing],
    places: &mut Places<'_>,
) -> Vec<SceneObject> {
    let mut crowd = Crowd::new(has_close_ups);
    sit(map, places, &mut crowd);
    wait(crossings, places, &mut crowd);
    for (ring, seed) in kerbs.iter().zip(0..).filter(|(ring, _)| !is_island(ring)) {
        for (seed, at, along) in along_kerb(ring, seed, &ROW) {
            let drawn = Company::drawn(seed);
            // Where there is no room for a company, one may pass.
            let alone = Company::Walker(Pose::Pass);
            let mut companies = [drawn, alone].map(|of| company(of, seed, at, along)).into_iter();
            if let Some((people, _)) = companies.find(|(_, discs)| places.claim(discs)) {
                for (person, k) in people.iter().zip(0..) {
                    crowd.add(seed.wrapping_add(k * 0x9E37), person, KERB_M - 0.01);
                }
            }
        }
    }
    crowd.objects
}

/// Who waits at the ends of crossings and looks across the road.
fn wait(crossings: &[Crossing], places: &mut Places<'_>, crowd: &mut Crowd) {
    const POSED: [Pose; 4] = [Pose::Stand, Pose::Pockets, Pose::Akimbo, Pose::Phone];
    for ((end, outward, along), k) in crossings.iter().flat_map(Crossing::ends).zip(0_u32..) {
        for (aside, seed) in [(-0.5, 0), (0.45, 1)].map(|(aside, one)| (aside, 0x0c05_5000 + 2 * k + one)) {
            let draw = |salt: u32| hash_to_unit(seed, salt);
            let at = end + outward * WAITS_OFF_M + along * (aside * 0.5 * DEEP_M);
            if draw(6) < WAITING && places.claim(&[(at, STANDING_M)]) {
                let pose = POSED[(draw(7) * POSED.len() as f32) as usize % POSED.len()];
                let yaw_rad = (-outward).as_vec2().to_angle() + 0.5 * (draw(5) - 0.5);
                let person = Person { pose, at, yaw_rad, tall: 0.93 + 0.12 * draw(2) };
                crowd.add(seed, &person, KERB_M - 0.01);
            }
        }
    }
}

/// Who sits on benches.
fn sit(map: &CityMap, places: &mut Places<'_>, crowd: &mut Crowd) {
    let benches = map.scenery.iter().zip(0_u32..).filter(|(piece, _)| piece.kind == SceneryKind::Bench);
    for (piece, index) in benches {
        let (middle, front) = super::props::bench_place(piece);
        for (seat, part) in SEATS_M.into_iter().zip(0..) {
            let seed = index.wrapping_mul(2).wrapping_add(0x5eed_0000 + part);
            if hash_to_unit(seed, 6) < SEATED {
                let at = (middle + front.perp() * seat + front * 0.02).as_dvec2();
                let pose = if hash_to_unit(seed, 7) < 0.6 { Pose::Sit } else { Pose::SitWithPhone };
                let tall = 0.93 + 0.12 * hash_to_unit(seed, 2);
                crowd.add(seed, &Person { pose, at, yaw_rad: front.to_angle(), tall }, SEAT_M);
                // Its feet are in front.
                places.take((at + front.as_dvec2() * 0.4, STANDING_M));
            }
        }
    }
}

#[cfg(test)]
mod tests;
