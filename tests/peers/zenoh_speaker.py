"""What the two other scripts of Zenoh share: a session in the form of rmw_zenoh, with rosbags for messages and hashes."""

import hashlib
import struct
import time

import zenoh
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
ROUTER = "tcp/127.0.0.1:7447"


def session():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ROUTER}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def key(domain, topic, kind):
    """Key of a topic, with the hash that rosbags computes from the definition."""
    package, _, name = kind.split("/")
    return f"{domain}/{topic}/{package}::msg::dds_::{name}_/{STORE.hash_rihs01(kind)}"


class Publisher:
    def __init__(self, session, domain, topic, kind):
        self.kind, self.number = kind, 0
        self.publisher = session.declare_publisher(key(domain, topic, kind))
        self.gid = hashlib.md5(str(self.publisher.key_expr).encode()).digest()

    def put(self, message):
        self.number += 1
        attachment = struct.pack("<qqB16s", self.number, time.time_ns(), 16, self.gid)
        self.publisher.put(bytes(STORE.serialize_cdr(message, self.kind)), attachment=attachment)


def stamp(now):
    return STORE.types["builtin_interfaces/msg/Time"](sec=int(now), nanosec=int(now % 1 * 1e9))


def header(now, frame="map"):
    return STORE.types["std_msgs/msg/Header"](stamp=stamp(now), frame_id=frame)
