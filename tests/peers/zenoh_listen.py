"""Counts what is heard of poses over Zenoh: arguments are the domain, seconds, and names of vehicles. Prints a line of JSON:
messages, those lost (by the sequence numbers of their publishers), and latencies by the stamps of the attachments."""

import json
import struct
import sys
import time

from zenoh_speaker import STORE, key, session

POSE = "geometry_msgs/msg/PoseStamped"
domain, seconds, names = sys.argv[1], float(sys.argv[2]), sys.argv[3:]
heard, latencies = {}, []


def take(sample):
    now = time.time_ns()
    number, sent, size, gid = struct.unpack("<qqB16s", sample.attachment.to_bytes())
    assert size == 16, size
    numbers, last = heard.setdefault(str(sample.key_expr), ([], []))
    numbers.append((number, gid))
    last[:] = [sample.payload.to_bytes()]
    latencies.append((now - sent) / 1e6)


zenoh = session()
subscribers = [zenoh.declare_subscriber(key(domain, f"vicon/{name}/{name}", POSE), take) for name in names]
begun = time.monotonic()
while len(heard) < len(names) and time.monotonic() - begun < 30:
    time.sleep(0.1)
latencies.clear()
time.sleep(seconds)
measured = sorted(latencies)
assert len(heard) == len(names), f"{len(heard)} of {len(names)} vehicles are heard"
lost = 0
for topic, (numbers, last) in heard.items():
    order = [number for number, _ in numbers]
    assert len({gid for _, gid in numbers}) == 1 and order == sorted(order), topic
    lost += order[-1] - order[0] + 1 - len(order)
    pose = STORE.deserialize_cdr(last[0], POSE)
    assert pose.header.frame_id == "map" and abs(pose.pose.position.x) < 10, pose
at = lambda share: round(measured[min(int(share * len(measured)), len(measured) - 1)], 2)
expected = sum(numbers[-1][0] - numbers[0][0] + 1 for numbers, _ in heard.values())
print(json.dumps({"vehicles": len(heard), "expected": expected, "lost": lost,
                  "latency_ms": {"p50": at(0.5), "p99": at(0.99), "max": at(1.0)}}))
static = []
late = zenoh.declare_subscriber(key(domain, "tf_static", "tf2_msgs/msg/TFMessage"), lambda sample: static.append(sample))
token = zenoh.liveliness().declare_token(
    f"@ros2_lv/{domain}/{zenoh.info.zid()}/0/1/MS/%/%/listen/%tf_static/tf2_msgs::msg::dds_::TFMessage_/RIHS01_0/:1:,1:,:,:,,")
begun = time.monotonic()
while not static and time.monotonic() - begun < 10:
    time.sleep(0.05)
assert static, "who comes later does not get /tf_static"
frames = STORE.deserialize_cdr(static[0].payload.to_bytes(), "tf2_msgs/msg/TFMessage").transforms
assert (frames[0].header.frame_id, frames[0].child_frame_id) == ("map", "vicon"), frames
token.undeclare()
zenoh.close()
