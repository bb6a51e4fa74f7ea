//! Bags of poses that ROS has recorded: of ROS 1, or of ROS 2 in an MCAP file, as logs of City3D are too.

mod message;
mod ros1;

use super::RecordError;
use super::cdr::CdrReader;
use super::poses::MeasuredPose;
use super::reader::each_message;
use crate::geom::{Pose2, trig};
use crate::snapshot::VehicleId;
use glam::DVec3;
use message::{BagPose, Packed, poses_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

pub use ros1::is_ros1_bag;

/// So many names are told of what else is in a bag.
const MOST_STRANGERS: usize = 12;

/// Poses of the vehicles with these names, in order of time: of transforms (also those of `/tf`) whose frame has the
/// name as a part, and of stamped poses whose topic has it. Laboratory metres.
///
/// # Errors
/// [`RecordError::NoBag`] where the file cannot be read, or has no pose of any of them.
pub fn read_bag(
    path: &Path,
    names: &BTreeMap<String, VehicleId>,
) -> Result<BTreeMap<VehicleId, Vec<MeasuredPose>>, RecordError> {
    let wrong = |reason: String| RecordError::NoBag { path: path.to_path_buf(), reason };
    let mut sorter = Sorter { names, found: BTreeMap::new(), strangers: BTreeSet::new() };
    let torn = if is_ros1_bag(path) {
        ros1::read(path, |kind, topic, data| sorter.take(poses_of(kind, topic, &mut Packed::new(data))))
    } else {
        each_message(path, |kind, topic, data| {
            sorter.take(CdrReader::new(data).and_then(|mut cdr| poses_of(kind, topic, &mut cdr)));
        })
    };
    if let Some(torn) = torn.map_err(|error| wrong(error.to_string()))? {
        tracing::warn!("{}: {torn}; what stands before is used", path.display());
    }
    let Sorter { found, strangers, .. } = sorter;
    if found.is_empty() {
        let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        return Err(wrong(format!(
            "it has no pose of a vehicle of the scenario ({}); it has poses of: {}",
            list(names.keys().map(String::as_str).collect()),
            list(strangers.iter().map(String::as_str).collect())
        )));
    }
    Ok(found.into_iter().map(|(vehicle, poses)| (vehicle, super::poses::in_order(poses))).collect())
}

/// Why the end is lacking, if it is.
type Torn = Option<String>;

/// Poses that are sorted by the vehicles which they are of.
struct Sorter<'a> {
    names: &'a BTreeMap<String, VehicleId>,
    found: BTreeMap<VehicleId, Vec<MeasuredPose>>,
    /// What else is in the bag.
    strangers: BTreeSet<String>,
}

impl Sorter<'_> {
    /// Takes the poses of a message; one that is damaged has none.
    fn take(&mut self, poses: Option<Vec<BagPose>>) {
        for pose in poses.into_iter().flatten() {
            let vehicle = pose.path.split('/').find_map(|name| self.names.get(name));
            if let Some(&vehicle) = vehicle {
                self.found.entry(vehicle).or_default().extend(measured(&pose));
            } else if self.strangers.len() < MOST_STRANGERS {
                self.strangers.insert(pose.path);
            }
        }
    }
}

/// `None` for what is no pose.
fn measured(pose: &BagPose) -> Option<MeasuredPose> {
    /// Numbers beyond are none of a laboratory.
    const LARGEST: f64 = 1e12;
    let length = pose.orientation.length();
    let numbers = pose.position.to_array().into_iter().chain([pose.time_s, length]);
    if !numbers.into_iter().all(|number| number.abs() < LARGEST) || length < 0.5 {
        return None;
    }
    let forward = pose.orientation.normalize() * DVec3::X;
    let yaw_rad = trig::atan2(forward.y, forward.x);
    let pose2 = Pose2 { position: pose.position.truncate(), yaw_rad };
    Some(MeasuredPose { time_s: pose.time_s, pose: pose2 })
}
