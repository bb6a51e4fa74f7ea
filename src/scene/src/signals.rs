//! Traffic signals: a post behind the kerb at the line, and a head with three lenses towards the traffic that waits.
//! Heads of inner lanes hang from an arm over the lane.

use super::SceneObject;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::roads::RoadField;
use super::signs::at_line;
use city3d_roadmap::{CityMap, SignalHead};
use glam::{Vec2, Vec3};

const HOUSING: Finish = Finish::new(Surface::Metal, [30, 33, 34], Class::Sign);
const POST: Finish = Finish::new(Surface::Metal, [92, 98, 102], Class::Pole);
/// Lenses without light: red, yellow, green.
const DARK_LENSES: [Finish; 3] = [
    Finish::new(Surface::Metal, [70, 14, 12], Class::Sign),
    Finish::new(Surface::Metal, [74, 52, 10], Class::Sign),
    Finish::new(Surface::Metal, [10, 58, 38], Class::Sign),
];

/// Radius of a lens: those of main roads have 300 mm.
pub const LENS_RADIUS_M: f32 = 0.15;
/// Between the middles of two lenses.
const LENS_STEP_M: f32 = 0.36;
/// Housing: along the road, across it, and upwards.
const HOUSING_M: Vec3 = Vec3::new(0.20, 0.40, 1.12);
/// Height of the middle of a head beside the road, and over it.
const BESIDE_M: f32 = 3.0;
const OVERHEAD_M: f32 = 5.9;
/// The visor above a lens.
const VISOR_M: f32 = 0.20;

/// The lenses of a signal head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignalLenses {
    /// Middles of the red, the yellow and the green lens, city metres.
    pub middles: [Vec3; 3],
    /// Unit vector out of the lenses, towards the traffic.
    pub facing: Vec3,
}

/// Where a head stands or hangs.
struct Mount {
    /// Foot of the post.
    foot: Vec2,
    /// Middle of the head, seen from above.
    head: Vec2,
    /// Height of its middle.
    height_m: f32,
    /// Driving direction.
    towards: Vec2,
}

/// Objects and lenses of all signal heads, in the order of their ids.
pub(super) fn signals(map: &CityMap, field: &RoadField) -> Vec<(SceneObject, SignalLenses)> {
    map.signals.iter().map(|head| draw(&mount(map, field, head))).collect()
}

/// Heads of one arm: their lanes have about one direction, their lines are about beside one another, and they are as
/// many lane widths apart as a road may have lanes.
const SAME_WAY: f64 = 0.9;
const BESIDE_ONE_ANOTHER_M: f64 = 8.0;
const MOST_LANES: f64 = 5.5;

fn mount(map: &CityMap, field: &RoadField, head: &SignalHead) -> Mount {
    let pose_of = |head: &SignalHead| map.lane(head.lane).curve.at(head.at_m).pose;
    let pose = pose_of(head);
    let width_m = map.lane(head.lane).width_m;
    // How far a head is to the right of this one, if it is of the same arm.
    let right_of_this_m = |other: &SignalHead| {
        let there = pose_of(other);
        let offset = there.position - pose.position;
        let right_m = -offset.dot(pose.left());
        let is_of_arm = there.forward().dot(pose.forward()) > SAME_WAY
            && offset.dot(pose.forward()).abs() < BESIDE_ONE_ANOTHER_M
            && (0.5 * width_m..MOST_LANES * width_m).contains(&right_m);
        is_of_arm.then_some(right_m)
    };
    let others = map.signals.iter().filter_map(|other| Some((right_of_this_m(other)?, other)));
    let outer = others.max_by(|a, b| a.0.total_cmp(&b.0));
    let rightmost = outer.map_or(head, |(_, other)| other);
    let towards = pose.forward().as_vec2();
    let kerb = || pose_of(rightmost).point_at(0.0, -width_m / 2.0 - 0.7).as_vec2();
    let foot = at_line(map, field, map.lane(rightmost.lane), rightmost.at_m)
        .map_or_else(kerb, |(at, _)| at.as_vec2());
    if outer.is_none() {
        // The post stands behind the head.
        let head = foot - towards * (HOUSING_M.x / 2.0 + 0.08);
        return Mount { foot, head, height_m: BESIDE_M, towards };
    }
    // Over the lane, as far along the road as the post.
    let along = (foot - pose.position.as_vec2()).dot(towards);
    let head = pose.position.as_vec2() + towards * (along - HOUSING_M.x / 2.0 - 0.1);
    Mount { foot, head, height_m: OVERHEAD_M, towards }
}

fn draw(mount: &Mount) -> (SceneObject, SignalLenses) {
    let Mount { foot, head, height_m, towards } = *mount;
    let mut mesh = Mesh::default();
    let top_m = height_m + if height_m > BESIDE_M { 0.1 } else { HOUSING_M.z / 2.0 + 0.1 };
    let radius_m = if height_m > BESIDE_M { 0.09 } else { 0.055 };
    mesh.frustum(foot.extend(0.1), [radius_m, radius_m * 0.8], top_m - 0.1, 8, POST);
    if height_m > BESIDE_M {
        let end = head + towards * (HOUSING_M.x / 2.0 + 0.1);
        beam(&mut mesh, foot.extend(height_m), end.extend(height_m));
    }
    let facing = (-towards).extend(0.0);
    let middle = head.extend(height_m);
    housing(&mut mesh, middle, facing);
    let front = middle + facing * (HOUSING_M.x / 2.0);
    let middles = [1.0, 0.0, -1.0].map(|place: f32| front + Vec3::Z * (place * LENS_STEP_M));
    for (lens, finish) in middles.into_iter().zip(DARK_LENSES) {
        self::lens(&mut mesh, lens + facing * 0.004, facing, finish);
        visor(&mut mesh, lens, facing);
    }
    (SceneObject::of_one_level(mesh), SignalLenses { middles, facing })
}

/// A horizontal square beam.
fn beam(mesh: &mut Mesh, from: Vec3, to: Vec3) {
    let along = to - from;
    let size = Vec3::new(along.length(), 0.12, 0.12);
    let low = (from + to) / 2.0 - Vec3::Z * 0.06;
    closed_block(mesh, low, size, along.truncate().to_angle(), POST);
}

fn housing(mesh: &mut Mesh, middle: Vec3, facing: Vec3) {
    let low = middle - Vec3::Z * (HOUSING_M.z / 2.0);
    closed_block(mesh, low, HOUSING_M, facing.truncate().to_angle(), HOUSING);
}

/// A box with its bottom.
fn closed_block(mesh: &mut Mesh, low: Vec3, size: Vec3, yaw_rad: f32, finish: Finish) {
    mesh.block(low, size, yaw_rad, finish);
    let ahead = Vec2::from_angle(yaw_rad).extend(0.0);
    let (ahead, left) = (ahead * size.x / 2.0, Vec3::Z.cross(ahead) * size.y / 2.0);
    mesh.plate(
        &[low + ahead - left, low - ahead - left, low - ahead + left, low + ahead + left],
        finish,
        2.0,
    );
}

/// Corners of the rim of a lens, counter-clockwise for the traffic, from its right.
fn rim(facing: Vec3, radius_m: f32, count: usize) -> impl Iterator<Item = Vec3> {
    let right = Vec3::Z.cross(facing);
    (0..count).map(move |k| {
        let at = Vec2::from_angle(std::f32::consts::TAU * k as f32 / count as f32) * radius_m;
        right * at.x + Vec3::Z * at.y
    })
}

fn lens(mesh: &mut Mesh, middle: Vec3, facing: Vec3, finish: Finish) {
    let corners: Vec<Vec3> = rim(facing, LENS_RADIUS_M, 12).map(|at| middle + at).collect();
    mesh.plate(&corners, finish, 1.0);
}

/// A shade around the upper half of a lens, seen from both sides.
fn visor(mesh: &mut Mesh, middle: Vec3, facing: Vec3) {
    let half: Vec<Vec3> = rim(facing, LENS_RADIUS_M + 0.015, 12).take(7).map(|at| middle + at).collect();
    for pair in half.windows(2) {
        let out = facing * VISOR_M;
        let corners = [pair[0], pair[0] + out, pair[1] + out, pair[1]];
        mesh.plate(&corners, HOUSING, 1.0);
        let inside: Vec<Vec3> = corners.into_iter().rev().collect();
        mesh.plate(&inside, HOUSING, 1.0);
    }
}
