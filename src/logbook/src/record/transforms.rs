//! Poses in the log as `geometry_msgs/TransformStamped`, as the VICON bridge publishes them.

use city3d_protocol::cdr::CdrWriter;
use city3d_protocol::ros2::{Pose, Stamp, write_transform};
use city3d_protocol::wire::{Measurement, VICON_WORLD, vicon_frame};

/// Name of the ROS 2 type of transforms.
pub const TRANSFORM_TYPE: &str = "geometry_msgs/msg/TransformStamped";
/// Definition of [`TRANSFORM_TYPE`].
pub const TRANSFORM_SCHEMA: &str = "\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
";

/// The message of a vehicle's pose: laboratory metres, simulated time.
pub fn encode_transform(name: &str, pose: &Measurement, nanoseconds: u64, buffer: Vec<u8>) -> Vec<u8> {
    let mut cdr = CdrWriter::reusing(buffer);
    let stamp = Stamp::from_nanoseconds(nanoseconds);
    write_transform(&mut cdr, (stamp, VICON_WORLD), &vicon_frame(name), &Pose::of(pose));
    cdr.into_bytes()
}
