"""Writes the poses of a run log into a bag, as a recorder in the laboratory would have.

kind: ros1, ros1-bz2, ros1-lz4 (transforms on the topics of VICON and on /tf), poses (ROS 1, PoseStamped on /<name>/pose) or
ros2 (an MCAP file with /tf alone).

usage: write_bag.py KIND run.mcap BAG
"""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer as McapWriter
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# A clock of the laboratory, not the run's.
EPOCH = 1_700_000_000


def transforms(path):
    with open(path, "rb") as file:
        for _schema, channel, _message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            if channel.topic.startswith("/vicon/"):
                yield channel.topic, decoded


def numbers(decoded):
    place, turn = decoded.transform.translation, decoded.transform.rotation
    return (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)


class Types:
    def __init__(self, store):
        self.store = get_typestore(store)
        self.has_seq = store == Stores.ROS1_NOETIC
        if "tf2_msgs/msg/TFMessage" not in self.store.types:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))

    def __getattr__(self, name):
        found = [key for key in self.store.types if key.endswith("/" + name)]
        return self.store.types[found[0]]

    def header(self, seq, decoded, frame):
        stamp = self.Time(EPOCH + decoded.header.stamp.sec, decoded.header.stamp.nanosec)
        return self.Header(seq, stamp, frame) if self.has_seq else self.Header(stamp, frame)

    def transform(self, seq, decoded):
        place, turn = numbers(decoded)
        transform = self.Transform(self.Vector3(*place), self.Quaternion(*turn))
        header = self.header(seq, decoded, decoded.header.frame_id)
        return self.TransformStamped(header, decoded.child_frame_id, transform)

    def pose(self, seq, decoded):
        place, turn = numbers(decoded)
        pose = self.Pose(self.Point(*place), self.Quaternion(*turn))
        return self.PoseStamped(self.header(seq, decoded, "map"), pose)


def write_ros1(kind, log, bag):
    types = Types(Stores.ROS1_NOETIC)
    compressions = {"ros1-bz2": Writer.CompressionFormat.BZ2, "ros1-lz4": Writer.CompressionFormat.LZ4}
    writer = Writer(bag)
    if kind in compressions:
        writer.set_compression(compressions[kind])
    with writer:
        connections = {}

        def write(topic, name, message, stamp):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=types.store)
            writer.write(connections[topic], stamp, types.store.serialize_ros1(message, name))

        write("/chatter", "std_msgs/msg/String", types.String("a stranger"), EPOCH * 10**9)
        for seq, (topic, decoded) in enumerate(transforms(log)):
            stamp = (EPOCH + decoded.header.stamp.sec) * 10**9 + decoded.header.stamp.nanosec
            if kind == "poses":
                write(f"/{topic.split('/')[2]}/pose", "geometry_msgs/msg/PoseStamped", types.pose(seq, decoded), stamp)
            else:
                transform = types.transform(seq, decoded)
                write(topic, "geometry_msgs/msg/TransformStamped", transform, stamp)
                write("/tf", "tf2_msgs/msg/TFMessage", types.TFMessage([transform]), stamp)


def write_ros2(log, bag):
    types = Types(Stores.ROS2_HUMBLE)
    name = "tf2_msgs/msg/TFMessage"
    with open(bag, "wb") as file:
        writer = McapWriter(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="test")
        definition, _ = types.store.generate_msgdef(name, ros_version=2)
        schema = writer.register_schema(name, "ros2msg", definition.encode())
        channel = writer.register_channel("/tf", "cdr", schema)
        for seq, (_topic, decoded) in enumerate(transforms(log)):
            data = types.store.serialize_cdr(types.TFMessage([types.transform(seq, decoded)]), name)
            writer.add_message(channel, seq, bytes(data), seq)
        writer.finish()


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    kind, log, bag = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    write_ros2(log, bag) if kind == "ros2" else write_ros1(kind, log, bag)
