"""A node of ROS 2 that drives the car of block.toml once round its block (docs/ros2.md): drive_block.py ROUTES.json"""
import json
import sys
from math import atan2, cos, hypot, sin, sqrt

import rclpy
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, Twist, Vector3
from rclpy.duration import Duration
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

[car] = json.load(open(sys.argv[1]))["routes"]["vehicles"]
route, front, place = car["points"], car["body"]["front_axle_m"], 0
end, step = route[-1]["at_m"], route[1]["at_m"]


def drive(measured):
    """Sends the way ahead of the front axle, where it is measured, at the speeds of the route; it brakes before its end."""
    global place
    middle, rotation, time = measured.pose.position, measured.pose.orientation, 0.0
    yaw = 2 * atan2(rotation.z, rotation.w)
    x, y = middle.x + front * cos(yaw), middle.y + front * sin(yaw)
    place = min(range(place, min(place + 25, len(route))), key=lambda k: hypot(route[k]["x_m"] - x, route[k]["y_m"] - y))
    message = MultiDOFJointTrajectory(header=measured.header, joint_names=[car["name"]])
    for point in route[place:place + 50]:
        yaw, speed = point["yaw_rad"], min(point["speed_mps"], sqrt(0.2 * (end - point["at_m"])))
        pose = Transform(translation=Vector3(x=point["x_m"], y=point["y_m"]), rotation=Quaternion(z=sin(yaw / 2), w=cos(yaw / 2)))
        motion = Twist(linear=Vector3(x=speed * cos(yaw), y=speed * sin(yaw)))
        message.points.append(MultiDOFJointTrajectoryPoint(
            transforms=[pose], velocities=[motion], time_from_start=Duration(seconds=time).to_msg()))
        time += step / max(speed, 0.05)
    publisher.publish(message)


rclpy.init()
node = rclpy.create_node("drive_block")
publisher = node.create_publisher(MultiDOFJointTrajectory, "/city3d/trajectory", 10)
node.create_subscription(PoseStamped, f"/vicon/{car['name']}/{car['name']}", drive, 1)
while place < len(route) - 5:
    rclpy.spin_once(node)
print(f"{car['name']} is round the block")
