//! What years of traffic leave on asphalt: tyre tracks along the lanes, patches, iron covers.

use super::mesh::{Class, Finish, Mesh, Surface};
use super::roads::ASPHALT;
use crate::city::{CityMap, Lane, LaneKind};
use crate::geom::Pose2;
use glam::Vec2;

/// Heights over the asphalt, all under the paint.
const TRACKS_M: f32 = 0.003;
const PATCH_M: f32 = 0.006;
const COVER_M: f32 = 0.008;
/// What can be told apart of it.
pub(super) const SEEN_M: f32 = 0.35;
/// Length of one repeat of the lane's texture.
const REPEAT_M: f64 = 11.0;
/// Chords of bends leave them by no more than this.
const CHORD_M: f64 = 0.03;

const TRACKS: Finish = Finish { surface: Surface::Lane, ..ASPHALT };
const PATCH: Finish = Finish { surface: Surface::Patch, ..ASPHALT };
const COVER: Finish = Finish::new(Surface::Manhole, [110, 110, 112], Class::Road);

pub(super) fn wear(map: &CityMap) -> Mesh {
    let mut mesh = Mesh::default();
    for lane in map.lanes.iter().filter(|lane| lane.kind == LaneKind::Lane) {
        tracks(&mut mesh, lane);
        let spot = |salt: u32| super::dice(lane.id.0, salt);
        let length = lane.curve.length();
        let mut at = 4.0 + 22.0 * f64::from(spot(1));
        let mut count = 2;
        while at < length - 4.0 {
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
fn tracks(mesh: &mut Mesh, lane: &Lane) {
    let half = lane.width_m / 2.0 - 0.02;
    let start = f64::from(super::dice(lane.id.0, 77)) * 8.0;
    let mut before: Option<(Pose2, f64)> = None;
    let mut put = |pose: Pose2, s: f64| {
        if let Some((last, from)) = before {
            let corners = [
                last.point_at(0.0, -half),
                pose.point_at(0.0, -half),
                pose.point_at(0.0, half),
                last.point_at(0.0, half),
            ]
            .map(|p| p.as_vec2().extend(TRACKS_M));
            let (a, b) = (((start + from) / REPEAT_M) as f32, ((start + s) / REPEAT_M) as f32);
            let uvs = [Vec2::new(0.0, a), Vec2::new(0.0, b), Vec2::new(1.0, b), Vec2::new(1.0, a)];
            mesh.face(&corners, &uvs, TRACKS);
        }
        before = Some((pose, s));
    };
    put(lane.curve.at(0.0).pose, 0.0);
    for (index, segment) in lane.curve.segments().iter().enumerate() {
        let chord = segment.radius().map_or(f64::INFINITY, |r| (8.0 * r * CHORD_M).sqrt());
        let pieces = (segment.length / chord).ceil().max(1.0) as usize;
        let station = lane.curve.station(index);
        for k in 1..=pieces {
            let along = segment.length * k as f64 / pieces as f64;
            put(segment.pose_at(along), station + along);
        }
    }
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
    rectangle(mesh, Pose2 { position: at, ..pose }, size, PATCH_M, PATCH.shaded(tone));
}

fn cover(mesh: &mut Mesh, pose: Pose2, side: f32) {
    let at = pose.point_at(0.0, if side < 0.5 { 0.35 } else { -1.25 });
    rectangle(mesh, Pose2 { position: at, ..pose }, [0.86, 0.86], COVER_M, COVER);
}
