"""Counts what is heard of poses over ROS 2: arguments are seconds, the depth of the history, `reliable` or `best_effort`,
and names of vehicles. Prints a line of JSON: messages, those lost (by stamps, which are a tick apart), and latencies."""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

seconds, depth, reliability = float(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
names = sys.argv[4:]
stamps, latencies = {name: [] for name in names}, []
rclpy.init()
node = rclpy.create_node("listen")
qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy[reliability.upper()])


def hear(name):
    def take(message):
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        stamps[name].append(stamp)
        latencies.append(time.time() - stamp)

    return take


for name in names:
    node.create_subscription(PoseStamped, f"/vicon/{name}/{name}", hear(name), qos)
begun = time.monotonic()
while time.monotonic() - begun < 30 and not all(len(heard) > 100 for heard in stamps.values()):
    rclpy.spin_once(node, timeout_sec=0.1)
# All are connected now.
first = max(heard[-1] for heard in stamps.values())
until = first + seconds
while min(heard[-1] for heard in stamps.values()) < until and time.time() < until + 20:
    rclpy.spin_once(node, timeout_sec=1.0)
inside = [{s for s in heard if first < s <= until} for heard in stamps.values()]
# What one vehicle has is an instant of all of them.
instants = set().union(*inside)
lost = sum(len(instants) - len(heard) for heard in inside)
latencies.sort()
at = lambda share: round(1e3 * latencies[min(int(share * len(latencies)), len(latencies) - 1)], 2)
print(json.dumps({
    "vehicles": len(names), "instants": len(instants), "expected": len(instants) * len(names), "lost": lost,
    "latency_ms": {"p50": at(0.5), "p99": at(0.99), "max": at(1.0)},
}))
