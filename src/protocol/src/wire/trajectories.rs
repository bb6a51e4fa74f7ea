//! Encodes trajectories, several vehicles in one datagram.

use super::bytes::{ByteReader, ByteWriter};
use super::envelope::MAX_BODY_BYTES;
use super::{Body, DecodeError, EncodeError, MAX_ANGLE_RAD, MAX_COORDINATE_M, MAX_SPEED_MPS, MAX_TIME_S};
use super::{DecodeFault, Message};
use crate::snapshot::{Indicator, Trajectory, TrajectoryPoint, VehicleId};
use city3d_geometry::{Lab, Pose2};

/// Most points of a trajectory: they fill a datagram.
pub const MAX_POINTS: usize = 28;
/// Most trajectories of a datagram.
pub const MAX_TRAJECTORIES: usize = 64;
const POINT_BYTES: usize = 40;
const TRAJECTORY_BYTES: usize = 12;
/// The number of trajectories, and three reserved bytes.
const COUNT_BYTES: usize = 4;

const YIELDING: u8 = 1;
const FINISHED: u8 = 2;
const INDICATORS: [Indicator; 4] = [Indicator::Off, Indicator::Left, Indicator::Right, Indicator::Hazard];

/// Packs messages in their order into as few bodies as possible.
pub fn pack(messages: impl Iterator<Item = Message>) -> Vec<Body> {
    let mut bodies = Vec::new();
    let (mut together, mut bytes) = (Vec::new(), COUNT_BYTES);
    for message in messages {
        let other = match message {
            Message::Follow(trajectory) => Ok(trajectory),
            Message::Remove(vehicle) => Err(Body::Remove { request: 0, vehicle }),
            Message::Signals(aspects) => Err(Body::Signals(aspects)),
        };
        let trajectory = match other {
            Ok(trajectory) => trajectory,
            Err(body) => {
                bodies.extend(take(&mut together));
                bodies.push(body);
                bytes = COUNT_BYTES;
                continue;
            }
        };
        let more = TRAJECTORY_BYTES + POINT_BYTES * trajectory.points.len();
        if bytes + more > MAX_BODY_BYTES || together.len() == MAX_TRAJECTORIES {
            bodies.extend(take(&mut together));
            bytes = COUNT_BYTES;
        }
        bytes += more;
        together.push(trajectory);
    }
    bodies.extend(take(&mut together));
    bodies
}

fn take(together: &mut Vec<Trajectory<Lab>>) -> Option<Body> {
    (!together.is_empty()).then(|| Body::Trajectories(std::mem::take(together)))
}

pub(super) fn write(trajectories: &[Trajectory<Lab>], out: &mut ByteWriter) -> Result<(), EncodeError> {
    out.count("trajectories", trajectories.len(), MAX_TRAJECTORIES)?;
    [0; COUNT_BYTES - 1].into_iter().for_each(|byte| out.u8(byte));
    for trajectory in trajectories {
        out.u32(trajectory.vehicle.0);
        out.u32(trajectory.sequence);
        out.u8((u8::from(trajectory.yielding) * YIELDING) | (u8::from(trajectory.finished) * FINISHED));
        out.u8(trajectory.indicator as u8);
        out.count("points", trajectory.points.len(), MAX_POINTS)?;
        out.u8(0);
        trajectory.points.iter().for_each(|point| write_point(*point, out));
    }
    Ok(())
}

pub(super) fn read(from: &mut ByteReader<'_>) -> Result<Vec<Trajectory<Lab>>, DecodeError> {
    let count = from.u8("trajectories")?;
    let count = from.within("trajectories", count, (1, MAX_TRAJECTORIES as u8))?;
    for _ in 1..COUNT_BYTES {
        zero(from, "reserved")?;
    }
    (0..count).map(|_| read_one(from)).collect()
}

pub(super) fn write_point(point: TrajectoryPoint<Lab>, out: &mut ByteWriter) {
    let TrajectoryPoint { time_s, pose, speed_mps } = point;
    let Pose2 { position, yaw_rad, .. } = pose;
    [time_s, position.x, position.y, yaw_rad, speed_mps].into_iter().for_each(|number| out.f64(number));
}

/// Reads a point within a range of times, later than the one before.
pub(super) fn read_point(
    from: &mut ByteReader<'_>,
    (least_s, most_s): (f64, f64),
    before_s: Option<f64>,
) -> Result<TrajectoryPoint<Lab>, DecodeError> {
    let time_s = from.number("time", least_s, most_s)?;
    if before_s.is_some_and(|before_s| before_s >= time_s) {
        return Err(from.error("time", 8, DecodeFault::NotLater));
    }
    let pose = read_pose(from)?;
    let speed_mps = from.number("speed", 0.0, MAX_SPEED_MPS)?;
    Ok(TrajectoryPoint { time_s, pose, speed_mps })
}

/// Reads a pose of the laboratory's floor.
pub(super) fn read_pose(from: &mut ByteReader<'_>) -> Result<Pose2<Lab>, DecodeError> {
    let x = from.number("x", -MAX_COORDINATE_M, MAX_COORDINATE_M)?;
    let y = from.number("y", -MAX_COORDINATE_M, MAX_COORDINATE_M)?;
    let yaw_rad = from.number("yaw", -MAX_ANGLE_RAD, MAX_ANGLE_RAD)?;
    Ok(Pose2::new(x, y, yaw_rad))
}

pub(super) fn zero(from: &mut ByteReader<'_>, field: &'static str) -> Result<(), DecodeError> {
    let found = from.u8(field)?;
    from.within(field, found, (0, 0)).map(drop)
}

pub(super) fn read_indicator(from: &mut ByteReader<'_>) -> Result<Indicator, DecodeError> {
    from.one_of("indicator", &INDICATORS, "0 (off), 1 (left), 2 (right) and 3 (hazard)")
}

fn read_one(from: &mut ByteReader<'_>) -> Result<Trajectory<Lab>, DecodeError> {
    let (vehicle, sequence) = (VehicleId(from.u32("vehicle id")?), from.u32("trajectory sequence")?);
    let flags = from.u8("trajectory flags")?;
    let flags = from.within("trajectory flags", flags, (0, YIELDING | FINISHED))?;
    let indicator = read_indicator(from)?;
    let count = from.u8("points")?;
    let count = from.within("points", count, (1, MAX_POINTS as u8))?;
    zero(from, "reserved")?;
    let mut points: Vec<TrajectoryPoint<Lab>> = Vec::with_capacity(count.into());
    for _ in 0..count {
        let before_s = points.last().map(|before| before.time_s);
        points.push(read_point(from, (0.0, MAX_TIME_S), before_s)?);
    }
    let (yielding, finished) = (flags & YIELDING != 0, flags & FINISHED != 0);
    Ok(Trajectory { vehicle, sequence, points, yielding, finished, indicator })
}
