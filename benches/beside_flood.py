"""When the poses of each tick of a served city come, against an even beat, while strangers flood its port.

    python3 benches/beside_flood.py target/release/city3d [--key] [--clients clients/python]

6 cars with their mainframe; each kind of flood beside none, in turns. Prints lateness, ticks that nobody told of, and what
the city counted.
"""

import json
import os
import random
import socket
import struct
import sys
import tempfile
import time
import zlib
from multiprocessing import Process
from pathlib import Path

from beside import Lateness, served_city

OPTIONS = sys.argv[2:]
CLIENTS = OPTIONS[OPTIONS.index("--clients") + 1] if "--clients" in OPTIONS else str(Path(__file__).parent.parent / "clients/python")
sys.path.insert(0, CLIENTS)
from city3d_link import City  # noqa: E402

PORT, SECONDS = 19_880, 8.0
VERSION = 2 if "CHALLENGE" in open(Path(CLIENTS) / "city3d_link.py").read() else 1


def hello(session):
    text = struct.pack("<4sBBHQQQI", b"C3DL", VERSION, 1, 0, session, 0, 1, 0) + struct.pack("<QQ", 7, 0)[: 8 * VERSION]
    return text + struct.pack("<I", zlib.crc32(text))


KINDS = {
    "none": None,
    "garbage": lambda number: random.randbytes(64),
    "damaged": lambda number: hello(7)[:-1] + b"x",
    "handshakes": lambda number: hello(7),
    "sessions": lambda number: hello(number + 1),
}


def flood(kind, sockets, until):
    senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(sockets)]
    for sender in senders:
        sender.connect(("127.0.0.1", PORT))
    datagrams = [KINDS[kind](number) for number in range(1000)]
    sent = 0
    while time.monotonic() < until:
        for sender in senders:
            for _ in range(20):
                try:
                    sender.send(datagrams[sent % 1000])
                except OSError:
                    pass
                sent += 1


def measure(kind, sockets, key, folder):
    keyed = ["--key", key] if key else []
    controlling = ["--duration", "60", *keyed]
    with served_city(sys.argv[1], "roundabout", PORT, folder, ["--headless", *keyed], controlling):
        secret = Path(key).read_bytes().strip() if key else None
        link = City(port=PORT, patience=60.0, key=secret)
        link.subscribe()
        came, ends, flooding = {}, None, None
        while ends is None or time.monotonic() < ends:
            for poses in link.poses(1.0):
                now = time.monotonic()
                if poses.phase == 1 and poses.time > 2.0:
                    if ends is None:
                        ends = now + SECONDS
                        if KINDS[kind]:
                            flooding = Process(target=flood, args=(kind, sockets, ends))
                            flooding.start()
                    came.setdefault(poses.tick, now)
                if ends is not None and now > ends:
                    break
        if flooding:
            flooding.join()
    ticks, late = sorted(came), Lateness(came.items())
    summary = json.load(open(f"{folder}/city/summary.json"))
    lost = sum(event["kind"] == "link_lost" or "link_lost" in str(event["kind"]) for event in summary["events"])
    missed = ticks[-1] - ticks[0] + 1 - len(ticks)
    received = summary["link"]["received"]
    print(
        f"{kind:10} from {sockets:3}: median {late.at(0.5):.2f}  99 % {late.at(0.99):.2f}  latest {late.at(1):.2f} ms; "
        f"{missed} ticks missed, {lost} link_lost, {received / SECONDS:.0f} datagrams/s",
        flush=True,
    )


def main():
    with tempfile.TemporaryDirectory() as folder:
        key = None
        if "--key" in OPTIONS:
            key = f"{folder}/key"
            Path(key).write_text(os.urandom(16).hex())
        for kind in KINDS:
            for sockets in (1, 50) if KINDS[kind] else (1,):
                measure(kind, sockets, key, folder)


if __name__ == "__main__":
    main()
