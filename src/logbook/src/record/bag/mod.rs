//! Reads poses from ROS bags: ROS 1 bag format 2.0, and ROS 2 bags in MCAP files.

mod message;
mod ros1;

use super::RecordError;
use super::input::{FileKind, file_kind};
use super::poses::RecordedPose;
use super::reader::each_message;
use city3d_geometry::lab::Pose2;
use city3d_geometry::trig;
use city3d_protocol::cdr::CdrReader;
use city3d_protocol::snapshot::VehicleId;
use glam::DVec3;
use message::{BagPose, Ros1Reader, poses_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Most other frame and topic names that an error message lists.
const MAX_LISTED_PATHS: usize = 12;

/// Poses of the named vehicles in order of time, laboratory metres: transforms (also on `/tf`) whose child frame has
/// the name as a part, and stamped poses whose topic has it.
///
/// # Errors
/// [`RecordError::Unreadable`] where the file cannot be read, [`RecordError::NoBag`] where it has no pose of any of them.
pub fn read_bag(
    path: &Path,
    names: &BTreeMap<String, VehicleId>,
) -> Result<BTreeMap<VehicleId, Vec<RecordedPose>>, RecordError> {
    let wrong = |reason: String| RecordError::NoBag { path: path.to_path_buf(), reason };
    let mut sorter = PoseCollector { names, found: BTreeMap::new(), other_paths: BTreeSet::new() };
    let truncation = match file_kind(path)? {
        FileKind::Ros1Bag => ros1::read(path, |kind, topic, data| {
            sorter.take(poses_of(kind, topic, &mut Ros1Reader::new(data)));
        }),
        FileKind::Mcap => each_message(path, |kind, topic, data| {
            sorter.take(CdrReader::new(data).and_then(|mut cdr| poses_of(kind, topic, &mut cdr)));
        }),
        FileKind::Text | FileKind::Other => {
            return Err(wrong("it is neither an MCAP file nor a bag of ROS 1 in format 2.0".to_owned()));
        }
    };
    let truncation =
        truncation.map_err(|reason| RecordError::Unreadable { path: path.to_path_buf(), reason })?;
    let PoseCollector { found, other_paths, .. } = sorter;
    if found.is_empty() {
        let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let truncation = truncation.map(|truncation| format!("; {truncation}")).unwrap_or_default();
        return Err(wrong(format!(
            "it has no pose of a vehicle of the scenario ({}); it has poses of: {}{truncation}",
            list(names.keys().map(String::as_str).collect()),
            list(other_paths.iter().map(String::as_str).collect())
        )));
    }
    if let Some(truncation) = &truncation {
        tracing::warn!("{}: {truncation}; the records before that are used", path.display());
    }
    Ok(found.into_iter().map(|(vehicle, poses)| (vehicle, super::poses::in_order(poses))).collect())
}

/// Collects poses by vehicle.
struct PoseCollector<'a> {
    names: &'a BTreeMap<String, VehicleId>,
    found: BTreeMap<VehicleId, Vec<RecordedPose>>,
    /// Frames and topics of no vehicle.
    other_paths: BTreeSet<String>,
}

impl PoseCollector<'_> {
    /// Takes the poses of a message; a damaged message has none.
    fn take(&mut self, poses: Option<Vec<BagPose>>) {
        for pose in poses.into_iter().flatten() {
            let vehicle = pose.path.split('/').find_map(|name| self.names.get(name));
            if let Some(&vehicle) = vehicle {
                self.found.entry(vehicle).or_default().extend(measured(&pose));
            } else if self.other_paths.len() < MAX_LISTED_PATHS {
                self.other_paths.insert(pose.path);
            }
        }
    }
}

/// `None` for numbers that are no pose.
fn measured(pose: &BagPose) -> Option<RecordedPose> {
    /// Larger numbers are no laboratory poses.
    const LARGEST: f64 = 1e12;
    let length = pose.orientation.length();
    let numbers = pose.position.to_array().into_iter().chain([pose.time_s, length]);
    if !numbers.into_iter().all(|number| number.abs() < LARGEST) || length < 0.5 {
        return None;
    }
    let forward = pose.orientation.normalize() * DVec3::X;
    let yaw_rad = trig::atan2(forward.y, forward.x);
    let pose2 = Pose2::at(pose.position.truncate(), yaw_rad);
    Some(RecordedPose { time_s: pose.time_s, pose: pose2 })
}
