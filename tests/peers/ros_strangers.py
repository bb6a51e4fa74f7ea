"""Peers of a ROS node that misbehave: one argument, the node's name. Prints "held" when all are connected, and
stays until its input ends; then checks that the node still answers, and prints "answers"."""

import random
import socket
import struct
import sys
import xmlrpc.client
from urllib.parse import urlparse

import rosgraph

node = sys.argv[1]
uri = rosgraph.Master("/strangers").lookupNode(node)
api = xmlrpc.client.ServerProxy(uri)
code, _, (protocol, host, port) = api.requestTopic("/strangers", "/tf", [["TCPROS"]])
assert (code, protocol) == (1, "TCPROS")
calls = (urlparse(uri).hostname, urlparse(uri).port)
topics = (host, port)
held = []


def connect(place, data):
    stranger = socket.socket()
    # A small window fills up soon where nobody reads.
    stranger.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    stranger.connect(place)
    stranger.sendall(data)
    held.append(stranger)
    return stranger


def header(**fields):
    fields = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(body)) + body


greeting = header(callerid="/slow", topic="/tf", type="*", md5sum="*")
# Subscribers that never read.
for _ in range(3):
    connect(topics, greeting)
# Those who hang up in their greeting, or never end it.
for length in range(0, len(greeting), 7):
    connect(topics, greeting[:length]).close()
    connect(topics, greeting[:length])
# A greeting of 4 GB, and one with fields beyond its end.
connect(topics, struct.pack("<I", 0xFFFFFFFF) + b"x" * 1000)
connect(topics, struct.pack("<II", 8, 0x7FFFFFFF) + b"abcd")
# The wrong message, and no topic of this node: refused with the reason.
for fields, why in (
    (dict(topic="/tf", type="std_msgs/String", md5sum="*"), "tf2_msgs/TFMessage"),
    (dict(topic="/tf", type="*", md5sum="0"), "94810edda583a504dfda3829e70d7eec"),
    (dict(topic="/nothing", type="*", md5sum="*"), "not published"),
    (dict(callerid="/nobody"), "topic"),
):
    refused = connect(topics, header(**fields))
    told = refused.recv(4096).decode()
    assert "error=" in told and why in told, told
# Noise, on both sockets; then calls that are none.
random.seed(1)
for place in (calls, topics):
    for length in (1, 5, 100, 5000):
        try:
            connect(place, random.randbytes(length))
        except OSError:
            pass
for text in (
    b"GET / HTTP/1.1\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: 10\r\n\r\nabc",
    b"POST / HTTP/1.1\r\nContent-Length: 8\r\n\r\n<a><b><c",
    b"POST / HTTP/1.1\r\n" + b"x: y\r\n" * 1000,
):
    connect(calls, text)
for method, arguments in (
    ("system.listMethods", ()),
    ("publisherUpdate", ("/master", "/tf", ["http://127.0.0.1:9/", "", "http://"])),
    ("requestTopic", ()),
    ("requestTopic", ("/strangers", "/nothing", [["UDPROS", 1]])),
):
    try:
        answer = getattr(api, method)(*arguments)
        assert answer[0] in (1, -1), answer
    except xmlrpc.client.Fault:
        pass

print("held", flush=True)
sys.stdin.read()
code, _, pid = api.getPid("/strangers")
assert code == 1 and pid > 0
code, _, stats = api.getBusInfo("/strangers")
assert code == 1 and any(row[1] == "/slow" for row in stats), stats
print("answers", flush=True)
