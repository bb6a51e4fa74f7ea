"""Listens to an onboard camera: arguments are the vehicle's name, the camera's and how many pictures. Prints a JSON line
for each picture, with the camera's figures and transform of the same stamp; decodes the picture by the standard library."""

import json
import struct
import sys
import threading
import zlib

import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage
from tf2_msgs.msg import TFMessage

vehicle, camera, wanted = sys.argv[1], sys.argv[2], int(sys.argv[3])
frame = "%s/%s" % (vehicle, camera)
images, infos, transforms, vehicles = {}, {}, {}, {}
whole = threading.Event()


def decoded(data):
    """Width, height and number of colours of a PNG of 8 bits and three channels."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n", data[:8]
    at, packed = 8, b""
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert zlib.crc32(kind + body) == struct.unpack_from(">I", data, at + 8 + length)[0]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack_from(">IIBB", body)
            assert (depth, colour) == (8, 2)
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    assert kind == b"IEND"
    rows, stride, above, colours = zlib.decompress(packed), 3 * width, bytes(3 * width), set()
    assert len(rows) == height * (stride + 1)
    for y in range(height):
        begin = y * (stride + 1)
        assert rows[begin] in (0, 2), "a filter that is not expected"
        row = rows[begin + 1 : begin + 1 + stride]
        if rows[begin] == 2:
            row = bytes((a + b) & 255 for a, b in zip(row, above))
        colours.update(zip(row[0::3], row[1::3], row[2::3]))
        above = row
    return width, height, len(colours)


def pose(transform):
    p, q = transform.translation, transform.rotation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def complete():
    """Stamps of which all has been heard; of the first ones some came before somebody listened."""
    return sorted(set(images) & set(infos) & set(transforms) & set(vehicles))


def note(found, stamp, message):
    found[stamp.to_nsec()] = message
    if len(complete()) >= wanted:
        whole.set()


def hear_tf(message):
    for one in message.transforms:
        if one.child_frame_id == "vicon/%s/%s" % (vehicle, vehicle):
            note(vehicles, one.header.stamp, one)
        if one.child_frame_id == frame:
            note(transforms, one.header.stamp, one)


rospy.init_node("pictures", anonymous=True, disable_signals=True)
listen = [
    rospy.Subscriber("/tf", TFMessage, hear_tf),
    rospy.Subscriber("/%s/camera_info" % frame, CameraInfo, lambda info: note(infos, info.header.stamp, info)),
    rospy.Subscriber("/%s/image/compressed" % frame, CompressedImage, lambda one: note(images, one.header.stamp, one)),
]
heard = (images, infos, transforms, vehicles)
assert whole.wait(50), "%d pictures, %d infos, %d transforms, %d vehicles" % tuple(map(len, heard))
for stamp in complete()[:wanted]:
    image, info, transform = images[stamp], infos[stamp], transforms[stamp]
    width, height, colours = decoded(image.data)
    told = {
        "stamp": stamp,
        "seq": [image.header.seq, info.header.seq],
        "frames": [image.header.frame_id, info.header.frame_id],
        "parent": transform.header.frame_id,
        "format": image.format,
        "picture": [width, height, colours],
        "info": [info.width, info.height],
        "K": info.K,
        "D": info.D,
        "model": info.distortion_model,
        "camera": pose(transform.transform),
        "vehicle": pose(vehicles[stamp].transform),
    }
    print(json.dumps(told), flush=True)
