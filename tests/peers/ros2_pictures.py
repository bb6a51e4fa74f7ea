"""Listens to an onboard camera over ROS 2: arguments are the vehicle's name, the camera's, how many pictures, and `compressed`, `raw`, `depth` or `classes`.
Fails where a picture is not whole, or does not fit its camera; prints what has come as JSON."""

import json
import struct
import sys
import time

import rclpy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

vehicle, camera, wanted, form = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4]
frame = f"{vehicle}/{camera}"
# Place of the topics, encoding, and bytes of a pixel, of those that are no files.
PIXELS = {"raw": (frame, "rgb8", 3), "depth": (f"{frame}/depth", "32FC1", 4), "classes": (f"{frame}/classes", "8UC1", 1)}
place, encoding, pixel_bytes = PIXELS.get(form, (frame, None, 0))
images, infos = {}, {}


def size(data):
    """Width and height of a whole JPEG or PNG file."""
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        assert data[-8:-4] == b"IEND"
        return struct.unpack(">II", data[16:24])
    assert data[:2] == b"\xff\xd8" and data[-2:] == b"\xff\xd9", (data[:2], data[-2:])
    at = 2
    while data[at + 1] not in (0xC0, 0xC2):
        at += 2 + struct.unpack(">H", data[at + 2:at + 4])[0]
    height, width = struct.unpack(">HH", data[at + 5:at + 9])
    return width, height


rclpy.init()
node = rclpy.create_node("pictures")
key = lambda message: (message.header.stamp.sec, message.header.stamp.nanosec)
note = lambda found: lambda message: found.setdefault(key(message), message)
node.create_subscription(CameraInfo, f"/{place}/camera_info", note(infos), 10)
if encoding:
    node.create_subscription(Image, f"/{place}/image", note(images), 10)
else:
    node.create_subscription(CompressedImage, f"/{frame}/image/compressed", note(images), 10)
until = time.monotonic() + 60
while len(set(images) & set(infos)) < wanted and time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.5)
both = sorted(set(images) & set(infos))
lengths = []
for stamp in both:
    image, info = images[stamp], infos[stamp]
    data = bytes(image.data)
    width, height = (image.width, image.height) if encoding else size(data)
    if encoding:
        assert image.encoding == encoding and len(data) == pixel_bytes * width * height == height * image.step, len(data)
    if form == "depth":
        depths = struct.unpack(f"<{width * height}f", data)
        assert all(depth > 0 for depth in depths) and 0.01 < min(depths) < 1 and max(depths) > 5, (min(depths), max(depths))
    if form == "classes":
        assert 3 < len(set(data)) < 40, set(data)
    assert (width, height) == (info.width, info.height) and image.header.frame_id == info.header.frame_id == frame
    assert info.k[2] == (width - 1) / 2 or abs(info.k[2] - width / 2) <= 0.5, info.k
    lengths.append(len(data))
told = {"pictures": len(both), "size": [width, height], "bytes": max(lengths), "format": getattr(image, "format", "raw")} if both else {}
print(json.dumps(told))
# The first ones may have come before both topics were matched.
if len(both) < wanted or len(images) > len(both) + 3:
    sys.exit(f"{len(images)} pictures and {len(infos)} infos, {len(both)} of one stamp")
