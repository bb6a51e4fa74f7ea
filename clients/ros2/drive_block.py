"""A node of ROS 2 that drives the car of block.toml once round its block.

    city3d check block.toml --json --routes > routes.json
    city3d serve block.toml --headless --ros2 --ros2-control &
    python3 drive_block.py routes.json
"""
import json
import math
import sys

import rclpy
from geometry_msgs.msg import PoseStamped, Transform, Twist
from rclpy.duration import Duration
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

[car] = json.load(open(sys.argv[1]))["routes"]["vehicles"]
route, topic, place = car["points"], f"/vicon/{car['name']}/{car['name']}", 0
end, step = route[-1]["at_m"], route[1]["at_m"]


def drive(measured):
    """Sends the way ahead of the front axle, where it is measured, at the speeds of the route; it brakes before its end."""
    global place
    p, q, front = measured.pose.position, measured.pose.orientation, car["body"]["front_axle_m"]
    yaw = 2.0 * math.atan2(q.z, q.w)
    x, y, time = p.x + front * math.cos(yaw), p.y + front * math.sin(yaw), 0.0
    place = min(range(place, min(place + 25, len(route))), key=lambda k: math.hypot(route[k]["x_m"] - x, route[k]["y_m"] - y))
    message = MultiDOFJointTrajectory(header=measured.header, joint_names=[car["name"]])
    for point in route[place:place + 50]:
        yaw, speed = point["yaw_rad"], min(point["speed_mps"], math.sqrt(0.2 * (end - point["at_m"])))
        transform, twist = Transform(), Twist()
        transform.translation.x, transform.translation.y = point["x_m"], point["y_m"]
        transform.rotation.z, transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        twist.linear.x, twist.linear.y = speed * math.cos(yaw), speed * math.sin(yaw)
        message.points.append(MultiDOFJointTrajectoryPoint(
            transforms=[transform], velocities=[twist], time_from_start=Duration(seconds=time).to_msg()))
        time += step / max(speed, 0.05)
    publisher.publish(message)


rclpy.init()
node = rclpy.create_node("drive_block")
publisher = node.create_publisher(MultiDOFJointTrajectory, "/city3d/trajectory", 10)
node.create_subscription(PoseStamped, topic, drive, 1)
while place < len(route) - 5:
    rclpy.spin_once(node)
print(f"{car['name']} is round the block")
