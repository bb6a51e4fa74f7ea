//! Trajectories from `trajectory_msgs/MultiDOFJointTrajectory`: of front-axle centres, in laboratory metres.

use city3d_geometry::{Lab, Pose2, trig};
use city3d_network::link::exchange::{ReceivedTrajectory, TrajectoryExchange};
use city3d_protocol::cdr::CdrReader;
use city3d_protocol::ros2::{MultiDofTrajectory, Pose, read_trajectory};
use city3d_protocol::snapshot::{Indicator, Trajectory, TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{MAX_COORDINATE_M, MAX_POINTS, MAX_SPEED_MPS, UNIT_NORM};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Topic of the trajectories of all vehicles; its messages name them as joints.
pub const TRAJECTORY_TOPIC: &str = "/city3d/trajectory";
/// Bounded queue of received trajectories; the oldest are dropped (load shedding).
const CAPACITY: usize = 1024;
/// Latest point after the stamp.
const MAX_AHEAD_S: f64 = 3600.0;

/// The queue of received trajectories.
#[derive(Clone, Debug, Default)]
pub struct ReceivedTrajectories(Arc<TrajectoryQueue>);

#[derive(Debug, Default)]
struct TrajectoryQueue {
    waiting: Mutex<VecDeque<ReceivedTrajectory>>,
    received: AtomicU64,
    dropped: AtomicU64,
    invalid: AtomicU64,
}

impl ReceivedTrajectories {
    /// Queues the trajectories of a message, which has no header any more, or counts it as invalid.
    pub(crate) fn take(&self, message: &[u8], driven: &BTreeMap<String, VehicleId>) {
        let read = read_trajectory(&mut CdrReader::of_body(message));
        let Some(trajectories) = read.and_then(|read| trajectories_of(&read, driven)) else {
            return self.refuse();
        };
        self.0.received.fetch_add(trajectories.len() as u64, Ordering::Relaxed);
        let mut waiting = self.0.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.extend(trajectories);
        let excess = waiting.len().saturating_sub(CAPACITY);
        waiting.drain(..excess);
        self.0.dropped.fetch_add(excess as u64, Ordering::Relaxed);
    }

    /// Counts a message that is none.
    pub(crate) fn refuse(&self) {
        self.0.invalid.fetch_add(1, Ordering::Relaxed);
    }

    /// Numbers of trajectories that have come and that the full queue has dropped, and of invalid messages.
    pub fn counters(&self) -> (u64, u64, u64) {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        (of(&self.0.received), of(&self.0.dropped), of(&self.0.invalid))
    }
}

impl TrajectoryExchange for ReceivedTrajectories {
    fn next(&self) -> Option<ReceivedTrajectory> {
        self.0.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }
}

/// The trajectories of the vehicles that a message names; `None` where one is impossible, or none is of a vehicle here.
fn trajectories_of(
    message: &MultiDofTrajectory,
    driven: &BTreeMap<String, VehicleId>,
) -> Option<Vec<ReceivedTrajectory>> {
    let stamp_s = message.stamp.seconds();
    let named = message.joints.iter().enumerate();
    let known = named.filter_map(|(joint, name)| Some((joint, *driven.get(name)?)));
    let trajectories = known
        .map(|(joint, vehicle)| {
            let points = points_of(message, joint)?;
            let is_over = points.len() == 1 && points[0].speed_mps == 0.0;
            let trajectory = Trajectory {
                vehicle,
                sequence: 0,
                points,
                yielding: false,
                finished: is_over,
                indicator: Indicator::Off,
            };
            Some(ReceivedTrajectory { stamp_s, trajectory })
        })
        .collect::<Option<Vec<_>>>()?;
    (!trajectories.is_empty()).then_some(trajectories)
}

/// The points of a body, in order of time, at most [`MAX_POINTS`] of them.
fn points_of(message: &MultiDofTrajectory, joint: usize) -> Option<Vec<TrajectoryPoint<Lab>>> {
    let mut points: Vec<TrajectoryPoint<Lab>> = Vec::new();
    for k in thinned(message.points.len()) {
        let point = &message.points[k];
        let before = points.last();
        let is_later = before.is_none_or(|before| before.time_s < point.time_s);
        if !is_later || !(0.0..=MAX_AHEAD_S).contains(&point.time_s) {
            return None;
        }
        let mut pose = pose_on_floor(point.poses.get(joint)?)?;
        if let Some(before) = before {
            // Headings have no jumps.
            pose.yaw_rad = before.pose.yaw_rad + trig::wrap_angle(pose.yaw_rad - before.pose.yaw_rad);
        }
        let velocity = match point.velocities.is_empty() {
            true => average_velocity(message, joint, k)?,
            false => *point.velocities.get(joint)?,
        };
        let (sin, cos) = trig::sin_cos(pose.yaw_rad);
        let along_mps = velocity.truncate().dot(DVec2::new(cos, sin));
        // NaN is not in the range.
        if !(-MAX_SPEED_MPS..=MAX_SPEED_MPS).contains(&along_mps) {
            return None;
        }
        let speed_mps = along_mps.max(0.0);
        points.push(TrajectoryPoint { time_s: point.time_s, pose, speed_mps });
    }
    (!points.is_empty()).then_some(points)
}

/// Indices of at most [`MAX_POINTS`] points of so many, evenly, with the first and the last.
fn thinned(count: usize) -> impl Iterator<Item = usize> {
    let kept = count.min(MAX_POINTS);
    (0..kept).map(move |k| if kept < 2 { k } else { k * (count - 1) / (kept - 1) })
}

fn pose_on_floor(pose: &Pose) -> Option<Pose2<Lab>> {
    let is_valid = pose.position.abs().max_element() <= MAX_COORDINATE_M
        && !pose.position.is_nan()
        && UNIT_NORM.contains(&pose.orientation.length());
    let forward = pose.orientation * DVec3::X;
    is_valid.then(|| Pose2::at(pose.position.truncate(), trig::atan2(forward.y, forward.x)))
}

/// Velocity from a point to the next one, and at the last one from the one before.
fn average_velocity(message: &MultiDofTrajectory, joint: usize, k: usize) -> Option<DVec3> {
    let last = message.points.len() - 1;
    if last == 0 {
        return Some(DVec3::ZERO);
    }
    let from = k.min(last - 1);
    let (from, to) = (&message.points[from], &message.points[from + 1]);
    let way = to.poses.get(joint)?.position - from.poses.get(joint)?.position;
    Some(way / (to.time_s - from.time_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::ros2::{MultiDofPoint, Stamp};
    use glam::DQuat;

    fn driven() -> BTreeMap<String, VehicleId> {
        [("a".to_owned(), VehicleId(1)), ("b".to_owned(), VehicleId(2))].into()
    }

    fn rotated(yaw_rad: f64) -> DQuat {
        let (sin, cos) = trig::sin_cos(yaw_rad / 2.0);
        DQuat::from_xyzw(0.0, 0.0, sin, cos)
    }

    /// A car that turns left through west at 0.2 m/s, with a point each tenth of a second.
    fn message(points: usize) -> MultiDofTrajectory {
        let point = |k: usize| {
            let yaw_rad = 3.0 + 0.05 * k as f64;
            let orientation = rotated(yaw_rad);
            let pose = Pose { position: DVec3::new(1.0 - 0.02 * k as f64, 2.0, 0.0), orientation };
            let velocities = vec![orientation * DVec3::new(0.2, 0.0, 0.0)];
            MultiDofPoint { time_s: 0.1 * k as f64, poses: vec![pose], velocities }
        };
        let stamp = Stamp { sec: 7, nanosec: 0 };
        MultiDofTrajectory { stamp, joints: vec!["b".to_owned()], points: (0..points).map(point).collect() }
    }

    #[test]
    fn a_message_becomes_the_trajectories_of_the_vehicles_that_it_names() {
        let [received] = &trajectories_of(&message(10), &driven()).unwrap()[..] else { panic!() };
        assert_eq!((received.stamp_s, received.trajectory.vehicle), (7.0, VehicleId(2)));
        let points = &received.trajectory.points;
        assert_eq!(points.len(), 10);
        assert!(points.iter().all(|point| (point.speed_mps - 0.2).abs() < 1e-9), "{points:?}");
        // No jump where the heading passes west.
        assert!(
            points.windows(2).all(|pair| (pair[1].pose.yaw_rad - pair[0].pose.yaw_rad - 0.05).abs() < 1e-9)
        );
    }

    #[test]
    fn long_trajectories_keep_their_first_and_last_points() {
        let long = &trajectories_of(&message(100), &driven()).unwrap()[0].trajectory.points;
        assert_eq!(long.len(), MAX_POINTS);
        assert_eq!((long[0].time_s, long[MAX_POINTS - 1].time_s), (0.0, 0.1 * 99.0));
    }

    #[test]
    fn without_velocities_speeds_come_from_the_way() {
        let mut told = message(10);
        told.points.iter_mut().for_each(|point| point.velocities.clear());
        let points = &trajectories_of(&told, &driven()).unwrap()[0].trajectory.points;
        assert!(points.iter().all(|point| (point.speed_mps - 0.2).abs() < 0.01), "{points:?}");
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let refused = |change: fn(&mut MultiDofTrajectory)| {
            let mut told = message(3);
            change(&mut told);
            assert_eq!(trajectories_of(&told, &driven()), None, "{told:?}");
        };
        refused(|told| told.joints[0] = "stranger".to_owned());
        refused(|told| told.points.clear());
        refused(|told| told.points[1].time_s = 0.0);
        refused(|told| told.points[2].time_s = f64::NAN);
        refused(|told| told.points[0].time_s = -1.0);
        refused(|told| told.points[1].poses.clear());
        refused(|told| told.points[1].poses[0].position.x = f64::NAN);
        refused(|told| told.points[1].poses[0].orientation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0));
        refused(|told| told.points[1].velocities[0] = DVec3::splat(f64::INFINITY));
        refused(|told| told.joints.insert(0, "a".to_owned()));
    }

    #[test]
    fn a_full_queue_drops_its_oldest_trajectories() {
        let queue = ReceivedTrajectories::default();
        queue.take(&[1, 2, 3], &driven());
        assert_eq!((queue.counters(), queue.next()), ((0, 0, 1), None));
    }
}
