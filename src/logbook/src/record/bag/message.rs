//! Pose messages of ROS bags. ROS 1 serialization and ROS 2 CDR differ only in alignment and the `seq` field.

use city3d_protocol::cdr::CdrReader;
use glam::{DQuat, DVec3};

/// A pose in a bag, named by its frame or topic.
#[derive(Clone, Debug, PartialEq)]
pub struct BagPose {
    /// Frame or topic name, such as `vicon/car/car`.
    pub path: String,
    /// Header stamp, seconds: since the epoch, or simulated.
    pub time_s: f64,
    /// Position in the world frame, laboratory metres.
    pub position: DVec3,
    /// World from body.
    pub orientation: DQuat,
}

/// Reads the primitives of a message in their order; `None` past its end.
pub trait PrimitiveReader {
    /// Whether headers have a `seq` field (ROS 1).
    const HAS_SEQ: bool;
    /// Reads a little-endian integer of four bytes.
    fn u32(&mut self) -> Option<u32>;
    /// Reads a little-endian number in double precision.
    fn f64(&mut self) -> Option<f64>;
    /// Reads a string; `None` also for bytes that are not UTF-8.
    fn text(&mut self) -> Option<String>;
}

impl PrimitiveReader for CdrReader<'_> {
    const HAS_SEQ: bool = false;

    fn u32(&mut self) -> Option<u32> {
        self.u32()
    }

    fn f64(&mut self) -> Option<f64> {
        self.f64()
    }

    fn text(&mut self) -> Option<String> {
        self.string()
    }
}

/// Reader of the ROS 1 serialization: little-endian, without alignment.
pub struct Ros1Reader<'a>(&'a [u8]);

impl<'a> Ros1Reader<'a> {
    /// Begins at the first byte of a message.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*taken)
    }
}

impl PrimitiveReader for Ros1Reader<'_> {
    const HAS_SEQ: bool = true;

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let (text, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        String::from_utf8(text.to_vec()).ok()
    }
}

/// Whether messages of a type, by its ROS 1 or ROS 2 name, have poses.
pub fn is_pose_type(kind: &str) -> bool {
    let types =
        ["geometry_msgs/TransformStamped", "tf2_msgs/TFMessage", "tf/tfMessage", "geometry_msgs/PoseStamped"];
    types.contains(&kind.replace("/msg/", "/").as_str())
}

/// The poses of a message by its ROS 1 or ROS 2 type name: empty for types without poses, `None` for a damaged
/// message.
pub fn poses_of<P: PrimitiveReader>(kind: &str, topic: &str, from: &mut P) -> Option<Vec<BagPose>> {
    Some(match kind.replace("/msg/", "/").as_str() {
        "geometry_msgs/TransformStamped" => vec![transform(from)?],
        "tf2_msgs/TFMessage" | "tf/tfMessage" => {
            // No memory is reserved: a damaged count may be larger than the message.
            (0..from.u32()?).map(|_| transform(from)).collect::<Option<_>>()?
        }
        "geometry_msgs/PoseStamped" => {
            let time_s = stamp(from)?;
            let (position, orientation) = pose(from)?;
            vec![BagPose { path: topic.to_owned(), time_s, position, orientation }]
        }
        _ => Vec::new(),
    })
}

fn transform<P: PrimitiveReader>(from: &mut P) -> Option<BagPose> {
    let (time_s, path) = (stamp(from)?, from.text()?);
    let (position, orientation) = pose(from)?;
    Some(BagPose { path, time_s, position, orientation })
}

/// The stamp of a header, seconds; skips its frame.
fn stamp<P: PrimitiveReader>(from: &mut P) -> Option<f64> {
    if P::HAS_SEQ {
        from.u32()?;
    }
    let (seconds, nanoseconds) = (from.u32()?, from.u32()?);
    from.text()?;
    Some(f64::from(seconds) + f64::from(nanoseconds) * 1e-9)
}

fn pose<P: PrimitiveReader>(from: &mut P) -> Option<(DVec3, DQuat)> {
    let position = DVec3::new(from.f64()?, from.f64()?, from.f64()?);
    Some((position, DQuat::from_xyzw(from.f64()?, from.f64()?, from.f64()?, from.f64()?)))
}
