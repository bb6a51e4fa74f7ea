//! Messages of ROS 2 in CDR (Humble to Kilted: their definitions are the same): poses, transforms, pictures and
//! trajectories. What comes from elsewhere is read with the message's own length as its only memory.

use crate::cdr::{CdrReader, CdrWriter};
use crate::wire::Measurement;
use glam::{DQuat, DVec3};

/// A type of messages by its name in ROS 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageKind {
    /// Package, such as `geometry_msgs`.
    pub package: &'static str,
    /// Name in that package, such as `PoseStamped`.
    pub name: &'static str,
    /// Hash of its definition (`RIHS01`, REP-2016), in hexadecimal: the same from Humble to Kilted.
    pub hash: &'static str,
}

impl MessageKind {
    const fn new(package: &'static str, name: &'static str, hash: &'static str) -> Self {
        Self { package, name, hash }
    }

    /// Name of the type in DDS, as all middlewares of ROS 2 make it.
    pub fn dds_name(self) -> String {
        format!("{}::msg::dds_::{}_", self.package, self.name)
    }
}

/// Pose of a vehicle, as ros2-vicon-receiver publishes it.
pub const POSE_STAMPED: MessageKind = MessageKind::new(
    "geometry_msgs",
    "PoseStamped",
    "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
);
/// Pose of a frame in its parent.
pub const TRANSFORM_STAMPED: MessageKind = MessageKind::new(
    "geometry_msgs",
    "TransformStamped",
    "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
);
/// Several of them, on `/tf` and `/tf_static`.
pub const TF_MESSAGE: MessageKind = MessageKind::new(
    "tf2_msgs",
    "TFMessage",
    "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
);
/// Simulated time.
pub const CLOCK: MessageKind = MessageKind::new(
    "rosgraph_msgs",
    "Clock",
    "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
);
/// A picture as a file.
pub const COMPRESSED_IMAGE: MessageKind = MessageKind::new(
    "sensor_msgs",
    "CompressedImage",
    "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
);
/// A picture as its pixels.
pub const IMAGE: MessageKind = MessageKind::new(
    "sensor_msgs",
    "Image",
    "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
);
/// Intrinsics of a camera.
pub const CAMERA_INFO: MessageKind = MessageKind::new(
    "sensor_msgs",
    "CameraInfo",
    "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
);
/// Motions of several bodies.
pub const MULTI_DOF_TRAJECTORY: MessageKind = MessageKind::new(
    "trajectory_msgs",
    "MultiDOFJointTrajectory",
    "3a18fd095292a65cfde8833c72985a30af981f3ec44494655c6267262b443a4a",
);

const NANOSECONDS: u64 = 1_000_000_000;

/// `builtin_interfaces/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Whole seconds since 1970 or, for simulated time, since its start.
    pub sec: u32,
    /// Nanoseconds after the whole second.
    pub nanosec: u32,
}

impl Stamp {
    /// From nanoseconds since 1970, or of simulated time.
    pub fn from_nanoseconds(nanoseconds: u64) -> Self {
        let sec = u32::try_from(nanoseconds / NANOSECONDS).unwrap_or(u32::MAX);
        Self { sec, nanosec: (nanoseconds % NANOSECONDS) as u32 }
    }

    /// From seconds since 1970, or of simulated time.
    pub fn from_seconds(seconds: f64) -> Self {
        Self::from_nanoseconds((seconds.max(0.0) * NANOSECONDS as f64).round() as u64)
    }

    /// Seconds with their fraction.
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) * 1e-9
    }

    fn write(self, cdr: &mut CdrWriter) {
        cdr.u32(self.sec);
        cdr.u32(self.nanosec);
    }

    fn read(cdr: &mut CdrReader<'_>) -> Option<Self> {
        Some(Self { sec: cdr.u32()?, nanosec: cdr.u32()? })
    }
}

/// Position and orientation, `geometry_msgs/Pose` and `Transform`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Origin of the body in its parent, metres.
    pub position: DVec3,
    /// Parent from body.
    pub orientation: DQuat,
}

impl Pose {
    /// Of a measured vehicle, laboratory metres.
    pub fn of(measured: &Measurement) -> Self {
        Self { position: measured.position, orientation: measured.orientation }
    }

    fn write(&self, cdr: &mut CdrWriter) {
        let numbers = self.position.to_array().into_iter().chain(self.orientation.to_array());
        numbers.for_each(|number| cdr.f64(number));
    }

    fn read(cdr: &mut CdrReader<'_>) -> Option<Self> {
        Some(Self { position: vector(cdr)?, orientation: DQuat::from_array(numbers(cdr)?) })
    }
}

fn numbers<const N: usize>(cdr: &mut CdrReader<'_>) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = cdr.f64()?;
    }
    Some(numbers)
}

fn vector(cdr: &mut CdrReader<'_>) -> Option<DVec3> {
    numbers(cdr).map(DVec3::from_array)
}

/// Stamp and frame of a header.
pub type HeaderParts<'a> = (Stamp, &'a str);

fn write_header(cdr: &mut CdrWriter, (stamp, frame): HeaderParts<'_>) {
    stamp.write(cdr);
    cdr.string(frame);
}

/// Writes a [`POSE_STAMPED`].
pub fn write_pose(cdr: &mut CdrWriter, header: HeaderParts<'_>, pose: &Pose) {
    write_header(cdr, header);
    pose.write(cdr);
}

/// Writes a [`TRANSFORM_STAMPED`]: the pose of a child frame in the frame of the header.
pub fn write_transform(cdr: &mut CdrWriter, header: HeaderParts<'_>, child: &str, pose: &Pose) {
    write_header(cdr, header);
    cdr.string(child);
    pose.write(cdr);
}

/// Writes a [`TF_MESSAGE`] of frames with one parent.
pub fn write_transforms<'a>(
    cdr: &mut CdrWriter,
    header: HeaderParts<'_>,
    children: impl ExactSizeIterator<Item = (&'a str, Pose)>,
) {
    cdr.u32(children.len() as u32);
    children.for_each(|(child, pose)| write_transform(cdr, header, child, &pose));
}

/// Writes a [`CLOCK`].
pub fn write_clock(cdr: &mut CdrWriter, stamp: Stamp) {
    stamp.write(cdr);
}

/// Writes a [`COMPRESSED_IMAGE`]: a complete file of a format, such as `jpeg` or `png`.
pub fn write_compressed_image(cdr: &mut CdrWriter, header: HeaderParts<'_>, format: &str, file: &[u8]) {
    write_header(cdr, header);
    cdr.string(format);
    cdr.octets(file);
}

/// Pixels of an [`IMAGE`], row by row from the top.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// Width and height.
    pub extent: [u32; 2],
    /// Name of the pixel format, such as `rgb8`.
    pub encoding: &'a str,
    /// Bytes of one pixel.
    pub pixel_bytes: u32,
    /// All of them, without padding; numbers are little-endian.
    pub bytes: &'a [u8],
}

/// Writes an [`IMAGE`].
pub fn write_image(cdr: &mut CdrWriter, header: HeaderParts<'_>, pixels: &Pixels<'_>) {
    let [width, height] = pixels.extent;
    write_header(cdr, header);
    cdr.u32(height);
    cdr.u32(width);
    cdr.string(pixels.encoding);
    // Whether it is big-endian.
    cdr.u8(0);
    cdr.u32(width * pixels.pixel_bytes);
    cdr.octets(pixels.bytes);
}

/// Writes the [`CAMERA_INFO`] of a pinhole without distortion: width and height, focal lengths and principal point, pixels.
pub fn write_camera_info(
    cdr: &mut CdrWriter,
    header: HeaderParts<'_>,
    [width, height]: [u32; 2],
    [fx, fy, cx, cy]: [f64; 4],
) {
    write_header(cdr, header);
    cdr.u32(height);
    cdr.u32(width);
    cdr.string("plumb_bob");
    cdr.f64s([0.0; 5].into_iter());
    let intrinsics = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let rectification = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let projection = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    intrinsics.into_iter().chain(rectification).chain(projection).for_each(|number| cdr.f64(number));
    // No binning, and the whole picture as the region of interest.
    (0..6).for_each(|_| cdr.u32(0));
    cdr.u8(0);
}

/// A pose that was received, with its stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// When it was measured, by the clock of its sender.
    pub stamp: Stamp,
    /// In the world of the sender.
    pub pose: Pose,
}

/// Reads a [`POSE_STAMPED`]; `None` where it is damaged.
pub fn read_pose(cdr: &mut CdrReader<'_>) -> Option<StampedPose> {
    let stamp = read_header(cdr)?;
    Some(StampedPose { stamp, pose: Pose::read(cdr)? })
}

/// Reads a [`TRANSFORM_STAMPED`]; `None` where it is damaged.
pub fn read_transform(cdr: &mut CdrReader<'_>) -> Option<StampedPose> {
    let stamp = read_header(cdr)?;
    cdr.string()?;
    Some(StampedPose { stamp, pose: Pose::read(cdr)? })
}

fn read_header(cdr: &mut CdrReader<'_>) -> Option<Stamp> {
    let stamp = Stamp::read(cdr)?;
    cdr.string()?;
    Some(stamp)
}

/// A [`MULTI_DOF_TRAJECTORY`] without its accelerations.
#[derive(Clone, Debug, PartialEq)]
pub struct MultiDofTrajectory {
    /// Times of the points count from here.
    pub stamp: Stamp,
    /// Names of the bodies.
    pub joints: Vec<String>,
    /// In order of time.
    pub points: Vec<MultiDofPoint>,
}

/// All bodies at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct MultiDofPoint {
    /// After the stamp, seconds.
    pub time_s: f64,
    /// One for each body.
    pub poses: Vec<Pose>,
    /// Linear velocity of each body, metres per second in the world; empty where they are not told.
    pub velocities: Vec<DVec3>,
}

/// Reads a [`MULTI_DOF_TRAJECTORY`]; `None` where it is damaged.
pub fn read_trajectory(cdr: &mut CdrReader<'_>) -> Option<MultiDofTrajectory> {
    let stamp = read_header(cdr)?;
    // No memory is reserved: a damaged count may be larger than the message.
    let joints = (0..cdr.u32()?).map(|_| cdr.string()).collect::<Option<_>>()?;
    let points = (0..cdr.u32()?).map(|_| read_point(cdr)).collect::<Option<_>>()?;
    Some(MultiDofTrajectory { stamp, joints, points })
}

fn read_point(cdr: &mut CdrReader<'_>) -> Option<MultiDofPoint> {
    let poses = (0..cdr.u32()?).map(|_| Pose::read(cdr)).collect::<Option<_>>()?;
    let velocities = read_twists(cdr)?;
    read_twists(cdr)?;
    // `builtin_interfaces/Duration`: the seconds have a sign.
    let (sec, nanosec) = (cdr.u32()? as i32, cdr.u32()?);
    Some(MultiDofPoint { time_s: f64::from(sec) + f64::from(nanosec) * 1e-9, poses, velocities })
}

/// Reads `geometry_msgs/Twist[]`, of which the linear parts.
fn read_twists(cdr: &mut CdrReader<'_>) -> Option<Vec<DVec3>> {
    let twist = |cdr: &mut CdrReader<'_>| {
        let linear = vector(cdr)?;
        vector(cdr)?;
        Some(linear)
    };
    (0..cdr.u32()?).map(|_| twist(cdr)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const POSE: Pose =
        Pose { position: DVec3::new(1.5, -2.0, 0.25), orientation: DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8) };
    const STAMP: Stamp = Stamp { sec: 12, nanosec: 340_000_000 };

    fn written(write: impl FnOnce(&mut CdrWriter)) -> Vec<u8> {
        let mut cdr = CdrWriter::reusing(Vec::new());
        write(&mut cdr);
        cdr.into_bytes()
    }

    #[test]
    fn poses_come_back_as_they_were() {
        let stamped = Some(StampedPose { stamp: STAMP, pose: POSE });
        let pose = written(|cdr| write_pose(cdr, (STAMP, "map"), &POSE));
        assert_eq!(read_pose(&mut CdrReader::new(&pose).unwrap()), stamped);
        let transform = written(|cdr| write_transform(cdr, (STAMP, "vicon"), "a_a", &POSE));
        assert_eq!(read_transform(&mut CdrReader::new(&transform).unwrap()), stamped);
        assert_eq!(read_pose(&mut CdrReader::new(&pose[..pose.len() - 1]).unwrap()), None);
    }

    /// `geometry_msgs/PoseStamped` as rosbags 0.11.9 (`serialize_cdr`) writes it.
    #[test]
    fn a_pose_has_the_bytes_of_other_writers() {
        let pose = written(|cdr| write_pose(cdr, (STAMP, "map"), &POSE));
        let numbers = [1.5, -2.0, 0.25, 0.0, 0.0, 0.6, 0.8_f64];
        let mut expected = vec![0, 1, 0, 0, 12, 0, 0, 0];
        expected.extend(340_000_000_u32.to_le_bytes());
        expected.extend([4, 0, 0, 0, b'm', b'a', b'p', 0]);
        expected.extend(numbers.into_iter().flat_map(f64::to_le_bytes));
        assert_eq!(pose, expected);
    }

    /// A trajectory of two bodies, written as ROS 2 writes it.
    fn trajectory(velocities: u32) -> Vec<u8> {
        written(|cdr| {
            write_header(cdr, (STAMP, "map"));
            cdr.u32(2);
            cdr.string("a");
            cdr.string("bcd");
            cdr.u32(1);
            cdr.u32(2);
            POSE.write(cdr);
            POSE.write(cdr);
            cdr.u32(velocities);
            (0..velocities * 6).for_each(|k| cdr.f64(f64::from(k)));
            cdr.u32(0);
            cdr.u32(3);
            cdr.u32(500_000_000);
        })
    }

    #[test]
    fn trajectories_are_read() {
        for velocities in [0, 2] {
            let bytes = trajectory(velocities);
            let read = read_trajectory(&mut CdrReader::new(&bytes).unwrap()).unwrap();
            assert_eq!((read.stamp, read.joints), (STAMP, vec!["a".to_owned(), "bcd".to_owned()]));
            assert_eq!((read.points[0].time_s, &read.points[0].poses), (3.5, &vec![POSE, POSE]));
            let told = [DVec3::new(0.0, 1.0, 2.0), DVec3::new(6.0, 7.0, 8.0)];
            assert_eq!(read.points[0].velocities, &told[..velocities as usize]);
        }
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_strange(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            // Any input is read or refused, without a panic.
            let mut message = vec![0, 1, 0, 0];
            message.extend(bytes);
            let cdr = CdrReader::new(&message).unwrap();
            let _ = (read_pose(&mut cdr.clone()), read_transform(&mut cdr.clone()), read_trajectory(&mut cdr.clone()));
        }
    }

    #[test]
    fn stamps_keep_their_nanoseconds() {
        assert_eq!(Stamp::from_seconds(12.34), STAMP);
        assert_eq!(Stamp::from_seconds(0.999_999_999_9), Stamp { sec: 1, nanosec: 0 });
        assert_eq!(Stamp::from_seconds(-1.0), Stamp::default());
        assert!((STAMP.seconds() - 12.34).abs() < 1e-9);
    }
}
