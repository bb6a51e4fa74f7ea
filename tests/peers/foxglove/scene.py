#!/usr/bin/env python3
"""A client of a city in Foxglove's WebSocket protocol, with Foxglove's own definitions of messages.

scene.py URL PICTURE          connects with the address with the token, reads scene, transforms, pictures and the log's messages,
                              writes one picture to PICTURE, and prints one line a finding; fails where something is not as
                              it should be
scene.py URL PICTURE --look   reads and writes pictures alone
"""

import asyncio
import base64
import json
import struct
import sys
import time

import websockets
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

TIMEOUT_S = 60
DEFINITIONS = {it.DESCRIPTOR.full_name: it for it in (CameraCalibration, CompressedImage, FrameTransforms, SceneUpdate)}


def reader(channel):
    """What reads messages of a channel."""
    name = channel["schemaName"]
    if channel["encoding"] == "protobuf":
        files = FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
        assert any(name.endswith(f".{it.name}") for file in files.file for it in file.message_type), name
        return DEFINITIONS[name].FromString
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg"), channel
    schema = Schema(id=1, name=name, encoding="ros2msg", data=channel["schema"].encode())
    return DecoderFactory().decoder_for("cdr", schema)


class Client:
    def __init__(self, socket):
        self.socket, self.channels, self.readers = socket, {}, {}

    async def heard(self):
        """The next message: its topic, simulated time and content; texts have no topic."""
        message = await asyncio.wait_for(self.socket.recv(), TIMEOUT_S)
        if isinstance(message, str):
            told = json.loads(message)
            self.channels.update({it["topic"]: it for it in told.get("channels", []) if "topic" in it})
            return None, None, told
        if message[0] != 1:
            return None, None, message
        subscription, stamp_ns = struct.unpack_from("<IQ", message, 1)
        topic, read = self.readers[subscription]
        return topic, stamp_ns / 1e9, read(message[13:])

    async def subscribe(self, topic):
        while topic not in self.channels:
            await self.heard()
        number = len(self.readers) + 1
        self.readers[number] = topic, reader(self.channels[topic])
        subscriptions = [{"id": number, "channelId": self.channels[topic]["id"]}]
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    async def until(self, wanted, is_it=lambda _: True):
        while True:
            topic, at_s, content = await self.heard()
            if topic == wanted and is_it(content):
                return at_s, content


def quantile(values, part):
    return sorted(values)[int((len(values) - 1) * part)]


async def steadiness(client):
    """How much later than the quickest messages arrive: simulated time runs as fast as that on the wall."""
    delays, sizes, end = [], 0, time.monotonic() + 10
    while time.monotonic() < end:
        topic, at_s, content = await client.heard()
        if topic == "/city3d/scene":
            delays.append(time.monotonic() - at_s)
            sizes += content.ByteSize()
    least = min(delays)
    late_ms = [1000 * (delay - least) for delay in delays]
    print(f"{len(delays) / 10:.0f} scenes a second of {sizes // len(delays)} bytes; behind the quickest "
          f"{quantile(late_ms, 0.5):.1f} ms (p50), {quantile(late_ms, 0.99):.1f} ms (p99)")


async def look(client, name, path):
    """Pictures of the windscreen of a vehicle: their calibration, and how often they come."""
    for topic in (f"/{name}/windscreen/image", f"/{name}/windscreen/calibration"):
        await client.subscribe(topic)
    begun = time.monotonic()
    _, calibration = await client.until(f"/{name}/windscreen/calibration")
    _, image = await client.until(f"/{name}/windscreen/image")
    first_s = time.monotonic() - begun
    assert image.format == "jpeg" and image.data[:2] == b"\xff\xd8" and image.frame_id == f"{name}/windscreen"
    assert calibration.width > 100 and calibration.K[2] == (calibration.width - 1) / 2, calibration
    count, end = 0, time.monotonic() + 5
    while time.monotonic() < end:
        topic, _, content = await client.heard()
        if topic == f"/{name}/windscreen/image":
            count, image = count + 1, content
    with open(path, "wb") as file:
        file.write(image.data)
    print(f"a picture of {len(image.data) // 1024} KiB after {first_s:.1f} s, then {count / 5:.1f} a second; f = {calibration.K[0]:.0f}")
    assert count >= 3


async def talk(url, path, only_looks):
    async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        client = Client(socket)
        if only_looks:
            await look(client, "path1_a", path)
            return
        await client.subscribe("/city3d/map")
        _, roads = await client.until("/city3d/map")
        lanes = roads.entities[0].triangles
        print(f"roads of {len(lanes)} lanes, {roads.ByteSize() // 1024} KiB")
        for topic in ("/city3d/scene", "/tf", "/city3d/snapshot", "/city3d/network"):
            await client.subscribe(topic)
        at_s, scene = await client.until("/city3d/scene", lambda scene: len(scene.entities) >= 6)
        stamp = scene.entities[0].timestamp
        assert abs(stamp.seconds + stamp.nanos / 1e9 - at_s) < 1e-6
        _, moves = await client.until("/tf", lambda it: len(it.transforms) >= 6)
        names = {it.child_frame_id for it in moves.transforms}
        assert names == {entity.id for entity in scene.entities}, names
        _, snapshot = await client.until("/city3d/snapshot", lambda it: len(it.vehicles) == 6)
        _, command = await client.until("/city3d/network")
        print(f"scene and transforms of {sorted(names)}; snapshot of tick {snapshot.tick}, command of {command.sender}")
        await steadiness(client)
        await look(client, sorted(names)[0], path)


asyncio.run(talk(*sys.argv[1:3], "--look" in sys.argv))
