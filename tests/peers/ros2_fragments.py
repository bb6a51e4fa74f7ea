"""Cyclone DDS leads a vehicle with trajectories of 100 points, which it sends in fragments of 1344 bytes. Arguments: domain, name of the
vehicle, which stays where it is, and seconds."""

import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str = "map"


@dataclass
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Rotation(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Place(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector
    orientation: Rotation


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Place


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector
    angular: Vector


@dataclass
class Point(IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectoryPoint_"):
    transforms: sequence[Place]
    velocities: sequence[Twist]
    accelerations: sequence[Twist]
    time_from_start: Time


@dataclass
class Trajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[Point]


domain, name, seconds = int(sys.argv[1]), sys.argv[2], float(sys.argv[3])
participant = DomainParticipant(domain)
reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
poses = DataReader(participant, Topic(participant, f"rt/vicon/{name}/{name}", PoseStamped), reliable)
writer = DataWriter(participant, Topic(participant, "rt/city3d/trajectory", Trajectory), reliable)
seen, sent, begun = None, 0, time.monotonic()
while time.monotonic() - begun < seconds:
    for sample in poses.take(N=100):
        # Others tell that a publisher is gone.
        seen = sample if isinstance(sample, PoseStamped) else seen
    if seen is not None:
        still = Place(seen.pose.position, seen.pose.orientation)
        points = [Point([still], [], [], Time(k // 10, k % 10 * 100_000_000)) for k in range(100)]
        writer.write(Trajectory(Header(seen.header.stamp), [name], points))
        sent += 1
    time.sleep(0.1)
print(f"{sent} trajectories of 100 points")
assert sent > 0, f"{name} is not heard"
