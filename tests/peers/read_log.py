"""Reads a run log with the public MCAP tools and prints what is in it as JSON.

Messages are decoded twice, by mcap-ros2-support and by rosbags, from the schemas in the file alone.

usage: read_log.py run.mcap
"""

import json
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

VEHICLE = ["id", "status", "lights", "x", "y", "z", "qx", "qy", "qz", "qw", "speed", "steering", "lateral_error", "distance"]


def snapshot(message):
    vehicles = [{name: getattr(vehicle, name) for name in VEHICLE} for vehicle in message.vehicles]
    for vehicle, source in zip(vehicles, message.vehicles):
        vehicle["wheel_spin"] = [float(angle) for angle in source.wheel_spin]
    return {"tick": message.tick, "time": message.time, "state_hash": f"{message.state_hash:016x}", "vehicles": vehicles}


def transform(message):
    place, turn = message.transform.translation, message.transform.rotation
    stamp = message.header.stamp
    return {
        "time": stamp.sec + stamp.nanosec * 1e-9,
        "frames": [message.header.frame_id, message.child_frame_id],
        "numbers": [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w],
    }


def with_ros2_support(path):
    topics, snapshots, transforms, events, digests = {}, [], {}, [], []
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _schema, channel, _message, decoded in reader.iter_decoded_messages():
            topics[channel.topic] = topics.get(channel.topic, 0) + 1
            if channel.topic == "/city3d/snapshot":
                snapshots.append(snapshot(decoded))
            elif channel.topic.startswith("/vicon/"):
                transforms[channel.topic] = transform(decoded)
            elif channel.topic == "/city3d/event":
                events.append({"kind": decoded.kind, **json.loads(decoded.json)})
            elif channel.topic == "/city3d/tick":
                digests.append({"tick": decoded.tick, "state_hash": f"{decoded.state_hash:016x}"})
    return topics, [snapshots[0], snapshots[-1]], transforms, events, digests


def with_rosbags(path):
    store = get_typestore(Stores.EMPTY)
    # A standard type, which a reader knows without the file.
    standard = get_typestore(Stores.ROS2_HUMBLE)
    snapshots, transforms = [], {}
    with open(path, "rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            if channel.topic == "/city3d/snapshot":
                if schema.name not in store.fielddefs:
                    store.register(get_types_from_msg(schema.data.decode(), schema.name))
                snapshots.append(snapshot(store.deserialize_cdr(message.data, schema.name)))
            elif channel.topic.startswith("/vicon/"):
                transforms[channel.topic] = transform(standard.deserialize_cdr(message.data, schema.name))
    return [snapshots[0], snapshots[-1]], transforms


def contents(path):
    topics, ends, transforms, events, digests = with_ros2_support(path)
    if with_rosbags(path) != (ends, transforms):
        raise SystemExit("mcap-ros2-support and rosbags read different snapshots or transforms")
    with open(path, "rb") as file:
        reader = make_reader(file)
        header = reader.get_header()
        return {
            "profile": header.profile,
            "topics": topics,
            "ends": ends,
            "last_transforms": transforms,
            "events": events,
            "digests": digests,
            "attachments": {item.name: item.data.decode("utf-8", "replace")[:80] for item in reader.iter_attachments()},
            "metadata": {item.name: item.metadata for item in reader.iter_metadata()},
        }


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    json.dump(contents(sys.argv[1]), sys.stdout)
