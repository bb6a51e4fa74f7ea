"""Hostile participants of DDS against a served city: what they send must not take memory. Arguments: domain, process of the city, and
the memory that it may take beside what it has, in MiB. Everything goes to all ports of the first participants of the domain."""

import os
import socket
import struct
import sys
import time

domain, process, bound_mib = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
# Readers and writers of discovery (RTPS 2.5, table 9.3).
SPDP, PUBLICATIONS, SUBSCRIPTIONS = ((bytes([0, n >> 8, n & 255, 0xC7]), bytes([0, n >> 8, n & 255, 0xC2])) for n in (256, 3, 4))
ports = [7400 + 250 * domain + k for k in (0, 1, *range(10, 26))]
sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(8)]


def memory_kib():
    lines = open(f"/proc/{process}/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def prefix(participant):
    return b"\1\x12" + b"\xee" * 6 + struct.pack(">I", participant)


def send(participant, submessages, through=0, to=ports):
    for port in to:
        sockets[through].sendto(b"RTPS\2\3\1\x12" + prefix(participant) + submessages, ("127.0.0.1", port))


def submessage(kind, flags, body):
    return struct.pack("<BBH", kind, flags | 1, len(body)) + body


def number(value):
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


def data(pair, sequence, payload):
    return submessage(0x15, 4, b"\0\0\x10\0" + pair[0] + pair[1] + number(sequence) + payload)


def fragment(pair, sequence, of_bytes):
    sizes = struct.pack("<IHHI", 1, 1, 1024, of_bytes)
    return submessage(0x16, 0, b"\0\0\x1c\0" + pair[0] + pair[1] + number(sequence) + sizes + bytes(1024))


def heartbeat(pair, first, last, count):
    return submessage(0x07, 0, pair[0] + pair[1] + number(first) + number(last) + struct.pack("<I", count))


def gap(pair, start, until):
    return submessage(0x08, 0, pair[0] + pair[1] + number(start) + number(until) + bytes(4))


def parameters(*pairs):
    return b"\0\3\0\0" + b"".join(struct.pack("<HH", key, len(value)) + value for key, value in pairs) + b"\1\0\0\0"


def text(words):
    coded = words.encode() + b"\0"
    return struct.pack("<I", len(coded)) + coded + bytes(-len(coded) % 4)


def participant(number):
    guid = prefix(number) + b"\0\0\1\xc1"
    forever = b"\xff\xff\xff\x7f\xff\xff\xff\xff"
    told = ((0x15, b"\2\3\0\0"), (0x16, b"\1\x12\0\0"), (0x50, guid), (0x58, b"\x3f\x0c\0\0"), (2, forever))
    return data(SPDP, 1, parameters(*told))


def endpoint(number, entity, kind, topic):
    guid = prefix(number) + struct.pack(">I", entity)[1:] + bytes([kind])
    reliable = struct.pack("<III", 2, 0, 0)
    return parameters((0x5A, guid), (5, text(topic)), (7, text("some::type_")), (0x1A, reliable))


def check(what):
    time.sleep(1.0)
    more = (memory_kib() - before) / 1024
    print(f"{what}: {more:.1f} MiB more", flush=True)
    assert more < bound_mib, f"{what}: {more:.1f} MiB more, {bound_mib} allowed"


before = memory_kib()
for k in range(2000):
    send(1, os.urandom(k % 64), k % 8, ports[k % 4 :: 4])
    sockets[0].sendto(os.urandom(k % 1400), ("127.0.0.1", ports[k % len(ports)]))
check("garbage")
for k in range(10):
    send(1, fragment(SPDP, k + 1, 100_000_000))
check("huge messages")
for k in range(20_000):
    send(1 + k % 10, fragment((SPDP[0], struct.pack(">I", k)[1:] + b"\xc2"), 1, 60_000), to=ports[2:8:2])
check("writers")
for k in range(20_000):
    send(1000 + k, participant(1000 + k), k % 8, ports[2:8:2])
check("participants")
for k in range(20_000):
    if k % 2000 == 0:
        send(2, participant(2))
    topic = "rt/city3d/trajectory" if k % 16 == 0 else f"rt/{k}/" + "x" * 200
    send(2, data(PUBLICATIONS, k + 1, endpoint(2, k, 3, topic)), to=ports[2:8:2])
    send(2, data(SUBSCRIPTIONS, k + 1, endpoint(2, k, 4, topic)), to=ports[2:8:2])
    if k % 64 == 0:
        send(2, heartbeat(PUBLICATIONS, k, k, k + 1) + heartbeat(SUBSCRIPTIONS, k, k, k + 1), to=ports[2:8:2])
check("readers and writers")
for k in range(4000):
    send(2, data(PUBLICATIONS, 1_000_001 + 64 * k, b"\0\3\0\0" + bytes(60_000)), to=ports[2:8:2])
check("messages out of order")
for last in (1 << 40, (1 << 63) - 1):
    send(2, heartbeat(SUBSCRIPTIONS, 1, last, 1_000_000) + gap(SUBSCRIPTIONS, 2_000_000, last))
    # As many addresses, and fragments, as nobody has.
    send(2, submessage(0x0F, 0, b"\xff\xff\xff\x7f") + submessage(0x12, 0, bytes(16) + b"\xff" * 12 + bytes(8)))
check("impossible numbers")
