"""Motion capture of one physical vehicle over ROS 2, in the form of ros2-vicon-receiver: publishes its poses 100 times a second along
a line. Arguments: name of the vehicle, where it begins (x, y), metres per second eastwards, seconds, and the name of a virtual
vehicle, whose trajectory lets the experiment begin; it stands at its place."""

import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, Transform
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

name, (x, y, speed, seconds), other = sys.argv[1], map(float, sys.argv[2:6]), sys.argv[6]
rclpy.init()
node = rclpy.create_node("vicon_client")
poses = node.create_publisher(PoseStamped, f"/vicon/{name}/{name}", 10)
trajectories = node.create_publisher(MultiDOFJointTrajectory, "/city3d/trajectory", 10)
seen = []
node.create_subscription(PoseStamped, f"/vicon/{other}/{other}", lambda pose: seen.append(pose.pose), 10)
begun = time.monotonic()
while not seen and time.monotonic() - begun < 10:
    rclpy.spin_once(node, timeout_sec=0.1)
begun, sent = time.monotonic(), 0
while (now := time.monotonic() - begun) < seconds:
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = node.get_clock().now().to_msg(), "map"
    message.pose.position.x, message.pose.position.y, message.pose.orientation.w = x + speed * now, y, 1.0
    poses.publish(message)
    if seen and sent % 50 == 0:
        place = seen[-1]
        transform = Transform(rotation=place.orientation)
        transform.translation.x, transform.translation.y = place.position.x, place.position.y
        standing = MultiDOFJointTrajectory(header=message.header, joint_names=[other])
        standing.points.append(MultiDOFJointTrajectoryPoint(transforms=[transform]))
        trajectories.publish(standing)
    sent += 1
    time.sleep(max(0.0, begun + 0.01 * sent - time.monotonic()))
print(f"{sent} poses of {name}; {other} is {'heard' if seen else 'not heard'}")
