//! Reads poses from ROS bags: ROS 1 bag format 2.0, and ROS 2 bags in MCAP files and SQLite databases.

mod folder;
mod message;
mod ros1;
mod sqlite;

use super::input::{FileKind, ZSTANDARD_MAGIC, file_kind};
use super::poses::RecordedPose;
use super::reader::each_message;
use super::{RecordError, Truncation};
use city3d_geometry::lab::Pose2;
use city3d_geometry::trig;
use city3d_protocol::cdr::CdrReader;
use city3d_protocol::snapshot::VehicleId;
use folder::DECOMPRESS;
pub use folder::is_bag_folder;
use glam::DVec3;
use message::{BagPose, Ros1Reader, is_pose_type, poses_of};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Most other frame and topic names that an error message lists.
const MAX_LISTED_PATHS: usize = 12;

/// Poses of the named vehicles in order of time, laboratory metres: transforms (also on `/tf`) whose child frame has
/// the name as a part, and stamped poses whose topic has it. The path is that of a file, or of the folder of a bag of ROS 2.
///
/// # Errors
/// [`RecordError::Unreadable`] where a file cannot be read, [`RecordError::NoBag`] where it is damaged, compressed as a whole,
/// or has no pose of any of them.
pub fn read_bag(
    path: &Path,
    names: &BTreeMap<String, VehicleId>,
) -> Result<BTreeMap<VehicleId, Vec<RecordedPose>>, RecordError> {
    let mut collector =
        PoseCollector { names, found: BTreeMap::new(), other_paths: BTreeSet::new(), has_compressed: false };
    let files = if path.is_dir() { folder::files_of(path)? } else { vec![path.to_path_buf()] };
    let mut truncations = Vec::new();
    for file in &files {
        if let Some(truncation) = collector.read(file)? {
            truncations.push(format!("{}: {truncation}", file.display()));
        }
    }
    let PoseCollector { found, other_paths, has_compressed, .. } = collector;
    if found.is_empty() {
        let reason = if has_compressed {
            format!("its messages are compressed: {DECOMPRESS}")
        } else {
            let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            let truncations: String =
                truncations.iter().map(|truncation| format!("; {truncation}")).collect();
            format!(
                "it has no pose of a vehicle of the scenario ({}); it has poses of: {}{truncations}",
                list(names.keys().map(String::as_str).collect()),
                list(other_paths.iter().map(String::as_str).collect())
            )
        };
        return Err(RecordError::NoBag { path: path.to_path_buf(), reason });
    }
    for truncation in &truncations {
        tracing::warn!("{truncation}; the records before that are used");
    }
    Ok(found.into_iter().map(|(vehicle, poses)| (vehicle, super::poses::in_order(poses))).collect())
}

/// Collects poses by vehicle.
struct PoseCollector<'a> {
    names: &'a BTreeMap<String, VehicleId>,
    found: BTreeMap<VehicleId, Vec<RecordedPose>>,
    /// Frames and topics of no vehicle.
    other_paths: BTreeSet<String>,
    /// A message of ROS 2 was compressed.
    has_compressed: bool,
}

impl PoseCollector<'_> {
    /// Reads a file; returns why it was not read up to its end, if it was not.
    fn read(&mut self, path: &Path) -> Result<Option<Truncation>, RecordError> {
        let wrong = |reason: String| RecordError::NoBag { path: path.to_path_buf(), reason };
        let truncation = match file_kind(path)? {
            FileKind::Ros1Bag => ros1::read(path, |kind, topic, data| {
                self.take(poses_of(kind, topic, &mut Ros1Reader::new(data)));
            }),
            FileKind::Mcap => each_message(path, |kind, topic, data| self.take_cdr(kind, topic, data)),
            FileKind::Sqlite => {
                sqlite::read(path, |kind, topic, data| self.take_cdr(kind, topic, data))?;
                Ok(None)
            }
            FileKind::Zstandard => {
                return Err(wrong(
                    "it is compressed with Zstandard; decompress it first, with zstd -d".to_owned(),
                ));
            }
            FileKind::Text | FileKind::Other => {
                return Err(wrong(
                    "its first bytes are those of no bag: ROS 1 in format 2.0, MCAP, or SQLite. Copy it again, or record it again"
                        .to_owned(),
                ));
            }
        };
        truncation.map_err(|reason| RecordError::Unreadable { path: path.to_path_buf(), reason })
    }

    /// Takes the poses of a message of ROS 2.
    fn take_cdr(&mut self, kind: &str, topic: &str, data: &[u8]) {
        /// Encapsulation of little-endian CDR; the two bytes of options behind it differ between middlewares.
        const LITTLE_ENDIAN: [u8; 2] = [0, 1];
        if !is_pose_type(kind) {
            return;
        }
        self.has_compressed |= data.starts_with(&ZSTANDARD_MAGIC);
        let body = data.get(4..).filter(|_| data.starts_with(&LITTLE_ENDIAN));
        self.take(body.and_then(|body| poses_of(kind, topic, &mut CdrReader::of_body(body))));
    }

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
