"""Writes the poses of a run log into a bag of ROS 2, as ros2 bag record would have: a folder with metadata.yaml and files.

storage: sqlite3 or mcap; version: 8 (Humble) or 9 (Jazzy) of rosbag2's metadata. Topics: PoseStamped on /vicon/<name>/<name>, and
pictures that are longer than poses may be. form: whole; split (two files, the later one first by its name); file or message (compressed).

usage: write_rosbag2.py STORAGE VERSION FORM run.mcap BAG
"""

import shutil
import sys
from pathlib import Path

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores
from ruamel.yaml import YAML
from write_bag import EPOCH, Types, transforms

POSE, PICTURE = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/CompressedImage"


def write(types, poses, bag, version, storage, form):
    writer = Writer(bag, version=version, storage_plugin=storage)
    if form in ("file", "message"):
        writer.set_compression(CompressionMode[form.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}

        def add(topic, name, message, stamp):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=types.store)
            writer.write(connections[topic], stamp, types.store.serialize_cdr(message, name))

        picture = types.CompressedImage(types.header(0, poses[0][1], "camera"), "png", types.bytes(3 << 20))
        add("/camera", PICTURE, picture, EPOCH * 10**9)
        for topic, decoded in poses:
            stamp = (EPOCH + decoded.header.stamp.sec) * 10**9 + decoded.header.stamp.nanosec
            add(topic, POSE, types.pose(0, decoded), stamp)


def split(types, poses, bag, version, storage):
    """Two bags become one: the second file has a name that comes first."""
    half = len(poses) // 2
    parts = [bag.with_name(bag.name + part) for part in ("_b", "_a")]
    names = []
    bag.mkdir()
    for part, some in zip(parts, (poses[:half], poses[half:])):
        write(types, some, part, version, storage, "whole")
        (file,) = (file for file in part.iterdir() if file.name != "metadata.yaml")
        shutil.move(file, bag / file.name)
        names.append(file.name)
    yaml = YAML()
    metadata = yaml.load(parts[0] / "metadata.yaml")
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = names
    yaml.dump(metadata, bag / "metadata.yaml")


class Rosbag2Types(Types):
    @staticmethod
    def bytes(count):
        import numpy

        return numpy.zeros(count, dtype=numpy.uint8)


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    storage, version, form = StoragePlugin[sys.argv[1].upper()], int(sys.argv[2]), sys.argv[3]
    log, bag = Path(sys.argv[4]), Path(sys.argv[5])
    types = Rosbag2Types(Stores.ROS2_HUMBLE if version == 8 else Stores.ROS2_JAZZY)
    poses = list(transforms(log))
    if form == "split":
        split(types, poses, bag, version, storage)
    else:
        write(types, poses, bag, version, storage, form)
