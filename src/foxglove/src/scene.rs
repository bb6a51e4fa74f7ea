//! The scene for 3D panels: roads, vehicles and signals as primitives, and the transforms of vehicles. Frame `city`:
//! full-scale metres, x east, y north, z up; body frames have x forward and y left, and their origin in the middle of the
//! outline on the ground.

use city3d_protocol::snapshot::{Aspect, FrameSnapshot, Status, VehicleInfo, VehicleState};
use city3d_roadmap::Lane;
use city3d_simulation::scenario::Experiment;
use foxglove::messages::{
    Color, CubePrimitive, FrameTransform, FrameTransforms, KeyValuePair, Point3, Pose, Quaternion,
    SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive, TextPrimitive, Timestamp,
    TriangleListPrimitive, Vector3, scene_entity_deletion,
};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// The frame of the city.
pub(crate) const CITY_FRAME: &str = "city";
/// Largest distance between samples of a lane, metres.
const LANE_STEP_M: f64 = 3.0;
/// Vehicles that have left are deleted again and again for this long, in case that a slow client has missed it.
const DELETED_FOR_NS: u64 = 2_000_000_000;
/// Part of the height of a vehicle that its body takes; the cabin has the rest.
const BODY_PART: f64 = 0.6;
/// Signals hang this high, metres.
const SIGNAL_HEIGHT_M: f64 = 5.0;
const SIGNAL_SIZE_M: f64 = 1.0;
const LABEL_SIZE_M: f64 = 1.2;

const ASPHALT: Color = grey(0.30);
const WHITE: Color = grey(1.0);

const fn grey(level: f64) -> Color {
    Color { r: level, g: level, b: level, a: 1.0 }
}

/// Simulated nanoseconds as a stamp.
pub(crate) fn stamp(time_ns: u64) -> Option<Timestamp> {
    let seconds = u32::try_from(time_ns / 1_000_000_000).unwrap_or(u32::MAX);
    Some(Timestamp::new(seconds, (time_ns % 1_000_000_000) as u32))
}

pub(crate) fn vector(at: DVec3) -> Option<Vector3> {
    Some(Vector3 { x: at.x, y: at.y, z: at.z })
}

pub(crate) fn quaternion(turn: DQuat) -> Option<Quaternion> {
    Some(Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w })
}

fn pose(position: DVec3, orientation: DQuat) -> Option<Pose> {
    Some(Pose { position: vector(position), orientation: quaternion(orientation) })
}

fn entity(id: String, time_ns: u64) -> SceneEntity {
    SceneEntity { timestamp: stamp(time_ns), frame_id: CITY_FRAME.to_owned(), id, ..SceneEntity::default() }
}

/// The roads: one ribbon for each lane.
pub(crate) fn roads(experiment: &Experiment, time_ns: u64) -> SceneUpdate {
    let ribbon = |lane: &Lane| {
        let mut points = Vec::new();
        for (_, point) in lane.curve.sample(LANE_STEP_M) {
            for side in [0.5, -0.5] {
                let place = point.pose.point_at(0.0, side * lane.width_m);
                points.push(Point3 { x: place.x, y: place.y, z: 0.0 });
            }
        }
        // Two triangles from each pair of points to the next one.
        let pairs = (points.len() as u32 / 2).saturating_sub(1);
        let indices = (0..pairs).flat_map(|pair| {
            let first = 2 * pair;
            [first, first + 1, first + 2, first + 2, first + 1, first + 3]
        });
        let indices = indices.collect();
        let pose = pose(DVec3::ZERO, DQuat::IDENTITY);
        TriangleListPrimitive { pose, points, color: Some(ASPHALT), colors: Vec::new(), indices }
    };
    let triangles = experiment.city_map.lanes.iter().map(ribbon).collect();
    let roads = SceneEntity { triangles, ..entity("roads".to_owned(), time_ns) };
    SceneUpdate { deletions: Vec::new(), entities: vec![roads] }
}

/// Where the lamps of the signal heads are, by their numbers.
pub(crate) fn signal_places(experiment: &Experiment) -> Vec<DVec3> {
    let map = &experiment.city_map;
    let place = |at_m: f64, lane| map.lane(lane).curve.at(at_m).pose.position.extend(SIGNAL_HEIGHT_M);
    map.signals.iter().map(|head| place(head.at_m, head.lane)).collect()
}

/// Makes scenes of snapshots, and keeps in mind who has left.
#[derive(Debug, Default)]
pub(crate) struct SceneMaker {
    /// When each entity was there last.
    known: BTreeMap<String, u64>,
    last_ns: u64,
}

impl SceneMaker {
    /// The vehicles and the signals of a snapshot.
    pub(crate) fn scene(&mut self, snapshot: &FrameSnapshot, signals: &[DVec3], time_ns: u64) -> SceneUpdate {
        let mut deletions = Vec::new();
        if time_ns < self.last_ns || self.known.is_empty() {
            // Another run: nothing of the one before stays.
            self.known.clear();
            deletions.push(deletion(scene_entity_deletion::Type::All, String::new(), time_ns));
        }
        self.last_ns = time_ns;
        let mut entities: Vec<SceneEntity> =
            snapshot.iter().map(|(state, info)| vehicle(state, info, time_ns)).collect();
        for entity in &entities {
            self.known.insert(entity.id.clone(), time_ns);
        }
        self.known.retain(|_, seen_ns| time_ns - *seen_ns <= DELETED_FOR_NS);
        let gone = self.known.iter().filter(|(_, seen_ns)| **seen_ns < time_ns);
        deletions.extend(
            gone.map(|(id, _)| deletion(scene_entity_deletion::Type::MatchingId, id.clone(), time_ns)),
        );
        if !snapshot.signals.is_empty() {
            let lamps = signals.iter().zip(&snapshot.signals);
            let spheres = lamps.map(|(place, aspect)| lamp(*place, *aspect)).collect();
            entities.push(SceneEntity { spheres, ..entity("signals".to_owned(), time_ns) });
        }
        SceneUpdate { deletions, entities }
    }
}

fn deletion(kind: scene_entity_deletion::Type, id: String, time_ns: u64) -> SceneEntityDeletion {
    SceneEntityDeletion { timestamp: stamp(time_ns), r#type: kind.into(), id }
}

fn lamp(place: DVec3, aspect: Aspect) -> SpherePrimitive {
    let (r, g, b) = match aspect {
        Aspect::Dark => (0.15, 0.15, 0.15),
        Aspect::Red => (0.9, 0.1, 0.1),
        Aspect::Yellow => (0.95, 0.8, 0.1),
        Aspect::Green => (0.1, 0.8, 0.2),
    };
    SpherePrimitive {
        pose: pose(place, DQuat::IDENTITY),
        size: vector(DVec3::splat(SIGNAL_SIZE_M)),
        color: Some(Color { r, g, b, a: 1.0 }),
    }
}

/// A body with its cabin in the colour of the vehicle, its name, and its state as metadata.
fn vehicle(state: &VehicleState, info: &VehicleInfo, time_ns: u64) -> SceneEntity {
    let size = &info.dimensions;
    let [r, g, b] = info.appearance.colour.map(|level| f64::from(level) / 255.0);
    // A vehicle that is not measured is where it was seen last.
    let a = if state.status == Status::Unseen { 0.3 } else { 1.0 };
    let body_m = size.height_m * BODY_PART;
    let cube = |centre: DVec3, extent: DVec3, color: Color| CubePrimitive {
        pose: pose(state.position + state.orientation * centre, state.orientation),
        size: vector(extent),
        color: Some(color),
    };
    let body = cube(
        DVec3::new(0.0, 0.0, body_m / 2.0),
        DVec3::new(size.length_m, size.width_m, body_m),
        Color { r, g, b, a },
    );
    // Behind the middle, so that one sees where the front is.
    let cabin = cube(
        DVec3::new(-0.08 * size.length_m, 0.0, (size.height_m + body_m) / 2.0),
        DVec3::new(0.5 * size.length_m, 0.85 * size.width_m, size.height_m - body_m),
        Color { r: 0.1, g: 0.12, b: 0.15, a },
    );
    let label = TextPrimitive {
        pose: pose(state.position + DVec3::Z * (size.height_m + LABEL_SIZE_M), DQuat::IDENTITY),
        billboard: true,
        font_size: LABEL_SIZE_M,
        scale_invariant: false,
        color: Some(WHITE),
        text: info.name.clone(),
    };
    let pair = |key: &str, value: String| KeyValuePair { key: key.to_owned(), value };
    let metadata = vec![
        pair("id", state.id.to_string()),
        pair("status", state.status.label().to_owned()),
        pair("speed_mps", format!("{:.2}", state.speed_mps)),
    ];
    SceneEntity {
        metadata,
        cubes: vec![body, cabin],
        texts: vec![label],
        ..entity(info.name.clone(), time_ns)
    }
}

/// A transform from the city to a frame.
pub(crate) fn transform(child: &str, position: DVec3, orientation: DQuat, time_ns: u64) -> FrameTransform {
    FrameTransform {
        timestamp: stamp(time_ns),
        parent_frame_id: CITY_FRAME.to_owned(),
        child_frame_id: child.to_owned(),
        translation: vector(position),
        rotation: quaternion(orientation),
    }
}

/// The body frames of all vehicles, by their names.
pub(crate) fn transforms(snapshot: &FrameSnapshot, time_ns: u64) -> FrameTransforms {
    let of = |(state, info): (&VehicleState, &VehicleInfo)| {
        transform(&info.name, state.position, state.orientation, time_ns)
    };
    FrameTransforms { transforms: snapshot.iter().map(of).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{VehicleId, VehicleSpec};
    use std::sync::Arc;

    fn at(time_s: f64, ids: &[u32]) -> FrameSnapshot {
        let state = |id: &u32| VehicleState { id: VehicleId(*id), ..VehicleState::default() };
        let info = |id: &u32| {
            VehicleInfo::of(VehicleId(*id), &format!("car{id}"), Default::default(), &VehicleSpec::default())
        };
        FrameSnapshot {
            time_s,
            vehicles: ids.iter().map(state).collect(),
            roster: Arc::new(ids.iter().map(info).collect()),
            ..FrameSnapshot::default()
        }
    }

    #[test]
    fn who_has_left_is_deleted_for_a_while_and_a_new_run_deletes_all() {
        let mut maker = SceneMaker::default();
        let mut deleted = |time_s: f64, ids: &[u32]| -> Vec<String> {
            let scene = maker.scene(&at(time_s, ids), &[], (time_s * 1e9) as u64);
            assert_eq!(scene.entities.len(), ids.len());
            scene.deletions.into_iter().map(|deletion| deletion.id).collect()
        };
        assert_eq!(deleted(0.0, &[1, 2]), [""], "all of before");
        assert_eq!(deleted(1.0, &[1, 2]), [""; 0]);
        assert_eq!(deleted(1.1, &[1]), ["car2"]);
        assert_eq!(deleted(2.9, &[1]), ["car2"]);
        assert_eq!(deleted(3.1, &[1]), [""; 0]);
        assert_eq!(deleted(0.5, &[1]), [""]);
    }
}
