"""A small client of City3D's link (docs/wire.md), of the standard library alone.

    city = City("127.0.0.1", 9870)
    city.setup(1, "car", x=0.5, y=1.793, yaw=0.0)
    city.subscribe()
    city.start()
    while True:
        for poses in city.poses():
            city.trajectory(1, [(poses.time + 0.1 * k, x, y, yaw, speed) for k in range(20)])

Metres, metres per second and radians of the laboratory's floor; times are the city's clock. A city that is served with
--key wants the same `key` here: the bytes of that file, without the blanks around them.
"""

import hashlib
import hmac
import os
import socket
import struct
import time
import zlib
from collections import namedtuple

HEADER = struct.Struct("<4sBBHQQQI")
HELLO, SETUP, TRAJECTORIES, REMOVE, COMMAND, SUBSCRIBE = 1, 2, 3, 4, 5, 6
CLOCK, ACK, POSES, CHALLENGE = 65, 66, 67, 70
VERSION = 2
START, PAUSE, RESET = 0, 1, 2
STATUS = ("waiting", "driving", "yielding", "stopped", "manual", "link lost", "collided", "finished", "physical",
          "unseen")

Poses = namedtuple("Poses", "tick time phase vehicles")  # vehicles: number -> Pose
Pose = namedtuple("Pose", "status x y z qx qy qz qw")


class Refused(Exception):
    """The city will not do what it was asked for, for the reason stated."""


class City:
    """A city that is served, and the sender that this process is to it."""

    def __init__(self, host="127.0.0.1", port=9870, key=None, world=0, patience=10.0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((host, port))
        self.key, self.world, self.patience = key, world, patience
        self.session = int.from_bytes(os.urandom(8), "little") | 1
        self.city = self.challenge = self.sequence = self.request = 0
        self.counts = {}
        self._waiting = []
        self.clock = self._hello()

    # What is sent.

    def setup(self, number, name, x, y, yaw, speed=0.0, algorithm="", parameters=(), vehicle_type="default",
              body=0, colour=(178, 34, 34)):
        """Brings a vehicle in, the middle of its outline at (x, y); gives what the city has to say of it."""
        text = struct.pack("<IH3B4d", number, body, *colour, x, y, yaw, speed)
        text += _text(name) + _text(algorithm) + bytes([len(parameters)])
        for key, value in dict(parameters).items():
            text += _text(key) + struct.pack("<d", value)
        return self._ask(SETUP, text + b"\0" + _text(vehicle_type))

    def trajectory(self, number, points, yielding=False, finished=False, indicator=0):
        """Where the front axle shall be: (time, x, y, yaw, speed), up to 28 of them, and longer than the
        vehicle needs to stop."""
        self.counts[number] = self.counts.get(number, 0) + 1
        flags = (1 if yielding else 0) | (2 if finished else 0)
        text = struct.pack("<B3xIIBBBx", 1, number, self.counts[number], flags, indicator, len(points))
        self._send(TRAJECTORIES, text + b"".join(struct.pack("<5d", *point) for point in points))

    def remove(self, number):
        return self._ask(REMOVE, struct.pack("<I", number))

    def start(self):
        return self._ask(COMMAND, bytes([START]))

    def pause(self):
        return self._ask(COMMAND, bytes([PAUSE]))

    def reset(self):
        self.counts.clear()
        return self._ask(COMMAND, bytes([RESET]))

    def subscribe(self, every_ticks=1, lease=60.0):
        """Poses come from now on, until the lease is over."""
        return self._ask(SUBSCRIBE, struct.pack("<Hd", every_ticks, lease))

    # What comes.

    def poses(self, wait=1.0):
        """The poses of the next ticks that come, waiting no longer than so many seconds for each."""
        parts = {}
        while True:
            found = self._waiting.pop(0) if self._waiting else self._receive(time.monotonic() + wait)
            if found is None:
                return
            kind, text = found
            if kind != POSES:
                continue
            tick, now, _, phase, part, count, poses = struct.unpack_from("<QdQ4B", text)
            parts = parts if (tick, phase) in parts else {(tick, phase): {}}
            parts[tick, phase][part] = text[28:28 + 64 * poses]
            if len(parts[tick, phase]) == count:
                vehicles = {}
                for numbers in struct.iter_unpack("<IB3x7d", b"".join(parts[tick, phase].values())):
                    vehicles[numbers[0]] = Pose(STATUS[numbers[1]], *numbers[2:])
                yield Poses(tick, now, phase, vehicles)

    # Below: datagrams.

    def _send(self, kind, text):
        # A Hello that asks for the challenge belongs to no session yet.
        self.sequence += 1 if self.challenge else 0
        flags = 1 if self.key else 0
        head = HEADER.pack(b"C3DL", VERSION, kind, flags, self.session, self.challenge, self.sequence, self.world)
        self.socket.send(head + text + self._check(head + text))

    def _check(self, text):
        if self.key:
            return hmac.new(self.key, text, hashlib.sha256).digest()[:16]
        return struct.pack("<I", zlib.crc32(text))

    def _receive(self, until):
        """Kind and body of the next datagram of the city; None when it is later than `until`."""
        while True:
            left = until - time.monotonic()
            if left <= 0:
                return None
            self.socket.settimeout(left)
            try:
                data = self.socket.recv(1201)
            except (TimeoutError, ConnectionError):
                # A city that is not there yet refuses at once.
                time.sleep(min(0.01, max(0.0, until - time.monotonic())))
                continue
            size = 16 if self.key else 4
            text, check = data[:-size], data[-size:]
            if len(text) < HEADER.size or not hmac.compare_digest(self._check(text), check):
                continue
            magic, version, kind, _, session, peer, _, _ = HEADER.unpack_from(text)
            if (magic, version, peer) != (b"C3DL", VERSION, self.session) or self.city not in (0, session):
                continue
            self.city = session
            return kind, text[HEADER.size:]

    def _hello(self):
        """Answers the city's challenge, which all later datagrams name, and gives its clock."""
        until = time.monotonic() + self.patience
        nonce = int.from_bytes(os.urandom(8), "little")
        while time.monotonic() < until:
            self._send(HELLO, struct.pack("<QQ", nonce, 0))
            found = self._receive(time.monotonic() + 0.2)
            if found and found[0] == CHALLENGE and not self.challenge:
                token, challenge = struct.unpack("<QQ", found[1])
                self.challenge = challenge if token == nonce else 0
            elif found and found[0] == CLOCK:
                names = "token tick time physics_hz length_scale phase lockstep"
                return namedtuple("Clock", names)(*struct.unpack("<QQdIdBB", found[1]))
        raise TimeoutError("no city answers there")

    def _ask(self, kind, text):
        """Sends a request until it is answered."""
        self.request += 1
        until = time.monotonic() + self.patience
        while time.monotonic() < until:
            self._send(kind, struct.pack("<I", self.request) + text)
            again = time.monotonic() + 0.1
            while True:
                found = self._receive(again)
                if found is None:
                    break
                if found[0] != ACK:
                    self._waiting = self._waiting[-100:] + [found]
                    continue
                request, outcome, _, length = struct.unpack_from("<IBQB", found[1])
                if request == self.request:
                    detail = found[1][14:14 + length].decode()
                    if outcome == 2:
                        raise Refused(detail)
                    if outcome == 0:
                        return detail
        raise TimeoutError("the city does not answer, or another sender leads it")


def _text(text):
    data = text.encode()
    return bytes([len(data)]) + data
