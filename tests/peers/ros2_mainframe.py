"""A node of ROS 2 in the mainframe's place: drives the six cars of the roundabout from start to end. Arguments: a file of
`city3d check roundabout-coordinated --json --routes`, whose cars and starts are those of `roundabout`.

Coordination is that of clients/python/coordinate_roundabout.py; poses come and trajectories go over ROS 2 only.
"""

import json
import math
import sys
import time
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "clients" / "python"))

import rclpy
from geometry_msgs.msg import PoseStamped, Transform, Twist
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from coordinate_roundabout import Coordinator


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9


class Mainframe(Node):
    def __init__(self, coordinator):
        super().__init__("mainframe")
        self.coordinator, self.cars = coordinator, coordinator.cars
        self.begun, self.now, self.poses, self.through = None, None, {}, {}
        self.sender = self.create_publisher(MultiDOFJointTrajectory, "/city3d/trajectory", 10)
        for car in self.cars.values():
            topic = f"/vicon/{car.name}/{car.name}"
            self.create_subscription(PoseStamped, topic, lambda pose, car=car: self.hear(car, pose), QoSProfile(depth=100))

    def hear(self, car, message):
        # With simulated stamps all poses of an instant have the same one.
        now, p, q = seconds(message.header.stamp), message.pose.position, message.pose.orientation
        if now != self.now:
            self.now, self.poses = now, {}
        self.poses[car.number] = SimpleNamespace(x=p.x, y=p.y, qz=q.z, qw=q.w)
        if len(self.poses) == len(self.cars) and (self.begun is None or now - self.begun >= 0.04 - 1e-6):
            self.begun = now
            self.control(now, message.header.stamp)

    def control(self, now, stamp):
        self.coordinator.step(SimpleNamespace(time=now, vehicles=self.poses))
        message = MultiDOFJointTrajectory()
        message.header.stamp, message.header.frame_id = stamp, "map"
        for k in range(13):
            message.points.append(MultiDOFJointTrajectoryPoint(time_from_start=Duration(seconds=0.25 * k).to_msg()))
        for car in self.cars.values():
            message.joint_names.append(car.name)
            for point, (_, x, y, yaw, speed) in zip(message.points, self.coordinator.points(car, now)):
                transform, twist = Transform(), Twist()
                transform.translation.x, transform.translation.y = x, y
                transform.rotation.z, transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
                twist.linear.x, twist.linear.y = speed * math.cos(yaw), speed * math.sin(yaw)
                point.transforms.append(transform)
                point.velocities.append(twist)
            if self.coordinator.is_through(car) and car.name not in self.through:
                self.through[car.name] = round(now, 2)
        self.sender.publish(message)


def main():
    coordinator = Coordinator(json.load(open(sys.argv[1]))["routes"])
    for car in coordinator.cars.values():
        car.plan = car.drive(0.0, car.start["axle_m"], car.start["speed_mps"])
    coordinator.enter(0.0)
    rclpy.init()
    node = Mainframe(coordinator)
    # Up to the end of the experiment: then the clock stands, and instants are new no more.
    heard = None
    while heard is None or time.monotonic() - heard < 2.0:
        before = node.begun
        rclpy.spin_once(node, timeout_sec=20.0 if heard is None else 0.5)
        if node.now is None:
            sys.exit("no pose is heard")
        if node.begun != before:
            heard = time.monotonic()
    if len(node.through) < len(node.cars):
        sys.exit(f"only these are through: {node.through}")
    print(json.dumps({"through_s": node.through}))


main()
