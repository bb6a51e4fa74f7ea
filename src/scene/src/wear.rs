//! Road wear: tyre tracks along the lanes, patches, manhole covers.

use super::ground_sheet::ASPHALT;
use super::lanes::LaneBoxIndex;
use super::mesh::{Class, Finish, Mesh, Surface};
use city3d_geometry::Pose2;
use city3d_roadmap::{CityMap, Lane, LaneKind};
use glam::Vec2;

/// Height of tracks above the asphalt, below the paint. Overlapping tracks differ by height steps to avoid
/// z-fighting.
const TRACKS_M: f32 = 0.002;
const STEP_M: f32 = 0.0004;
/// Largest number of steps: more would rise above the patches.
const STEPS: u32 = 13;
/// Overlap of tracks beyond the edges and ends of their lane.
const LAP_M: f64 = 0.02;
pub(super) const PATCH_M: f32 = 0.0075;
const COVER_M: f32 = 0.0085;
/// Size of visible wear detail, for its error.
pub(super) const SEEN_M: f32 = 0.35;
/// Half the longest patch.
const REPAIR_M: f64 = 1.9;
/// Texture repeat along a lane.
const REPEAT_M: f64 = 11.0;
/// Largest distance of a chord from its bend.
const CHORD_M: f64 = 0.03;

const TRACKS: Finish = Finish { surface: Surface::Lane, ..ASPHALT };
const PATCH: Finish = Finish { surface: Surface::Patch, ..ASPHALT };
const COVER: Finish = Finish::new(Surface::Manhole, [110, 110, 112], Class::Road);

fn worn(map: &CityMap) -> impl Iterator<Item = &Lane> {
    map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane)
}

/// Height step of each lane: a colouring of overlapping lanes with distinct steps.
fn steps(map: &CityMap, lanes: &LaneBoxIndex<'_>) -> Vec<u32> {
    let mut steps = vec![0; map.lanes.len()];
    for lane in worn(map) {
        let before = |other: &&Lane| other.kind == LaneKind::Lane && other.id < lane.id;
        let taken: Vec<u32> =
            lanes.near(lane, 0.5).filter(before).map(|other| steps[other.id.index()]).collect();
        steps[lane.id.index()] = (0..STEPS).find(|step| !taken.contains(step)).unwrap_or_default();
    }
    steps
}

pub(super) fn wear(map: &CityMap, lanes: &LaneBoxIndex<'_>) -> Mesh {
    let mut mesh = Mesh::default();
    let steps = steps(map, lanes);
    for lane in worn(map) {
        tracks(&mut mesh, lane, TRACKS_M + STEP_M * steps[lane.id.index()] as f32);
        let spot = |salt: u32| super::hash_to_unit(lane.id.0, salt);
        let length = lane.curve.length();
        let mut at = 4.0 + 22.0 * f64::from(spot(1));
        let mut count = 2;
        while at < length - 4.0 {
            // No patches where arrows are painted.
            let [from, to] = super::markings::arrow_room(lane);
            if (from - REPAIR_M..to + REPAIR_M).contains(&at) {
                at = to + REPAIR_M;
                continue;
            }
            let pose = lane.curve.at(at).pose;
            if spot(count) < 0.55 {
                patch(&mut mesh, pose, [spot(count + 1), spot(count + 2), spot(count + 3)]);
            } else {
                cover(&mut mesh, pose, spot(count + 1));
            }
            at += 14.0 + 30.0 * f64::from(spot(count + 4));
            count += 5;
        }
    }
    mesh
}

/// A ribbon as wide as the lane.
fn tracks(mesh: &mut Mesh, lane: &Lane, z: f32) {
    let half = lane.width_m / 2.0 + LAP_M;
    let start = f64::from(super::hash_to_unit(lane.id.0, 77)) * 8.0;
    for ends in poses(lane).windows(2) {
        let [(last, from), (pose, s)] = [ends[0], ends[1]];
        let corners = [
            last.point_at(0.0, -half),
            pose.point_at(0.0, -half),
            pose.point_at(0.0, half),
            last.point_at(0.0, half),
        ]
        .map(|p| p.as_vec2().extend(z));
        let (a, b) = (((start + from) / REPEAT_M) as f32, ((start + s) / REPEAT_M) as f32);
        let uvs = [Vec2::new(0.0, a), Vec2::new(0.0, b), Vec2::new(1.0, b), Vec2::new(1.0, a)];
        mesh.face(&corners, &uvs, TRACKS);
    }
}

/// Poses along a lane and a little beyond its ends, with their arc lengths: straight in between.
fn poses(lane: &Lane) -> Vec<(Pose2, f64)> {
    let beyond = |pose: Pose2, by: f64| Pose2::at(pose.point_at(by, 0.0), pose.yaw_rad);
    let mut poses = vec![(beyond(lane.curve.at(0.0).pose, -LAP_M), -LAP_M)];
    for (index, segment) in lane.curve.segments().iter().enumerate() {
        let chord = segment.radius().map_or(f64::INFINITY, |r| (8.0 * r * CHORD_M).sqrt());
        let pieces = (segment.length / chord).ceil().max(1.0) as usize;
        let station = lane.curve.station(index);
        for k in 1..=pieces {
            let along = segment.length * k as f64 / pieces as f64;
            poses.push((segment.pose_at(along), station + along));
        }
    }
    if let Some((pose, s)) = poses.last_mut() {
        (*pose, *s) = (beyond(*pose, LAP_M), *s + LAP_M);
    }
    poses
}

fn rectangle(mesh: &mut Mesh, pose: Pose2, [long, wide]: [f64; 2], z: f32, finish: Finish) {
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(x, y)| pose.point_at(x * long, y * wide).as_vec2().extend(z));
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    mesh.face(&corners, &uvs, finish);
}

fn patch(mesh: &mut Mesh, pose: Pose2, [long, wide, side]: [f32; 3]) {
    let size = [1.2 + 2.6 * f64::from(long), 0.9 + 0.9 * f64::from(wide)];
    let at = pose.point_at(0.0, (f64::from(side) - 0.5) * 1.6);
    let tone = 0.90 + 0.16 * long;
    rectangle(mesh, Pose2::at(at, pose.yaw_rad), size, PATCH_M, PATCH.shaded(tone));
}

fn cover(mesh: &mut Mesh, pose: Pose2, side: f32) {
    let at = pose.point_at(0.0, if side < 0.5 { 0.35 } else { -1.25 });
    rectangle(mesh, Pose2::at(at, pose.yaw_rad), [0.86, 0.86], COVER_M, COVER);
}
