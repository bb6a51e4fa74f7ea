"""A rosbridge server for tests: WebSocket by Autobahn and Twisted, topics by rospy, as rosbridge_suite has them.

Runs with Debian's python3-autobahn, python3-twisted and, for --ros, python3-rospy. A connection lives by Autobahn's own
rules: its answers to pings, its pings with their time-out, its time-outs of handshakes. A client that only publishes
hears nothing but pongs. Prints its port. When its input ends, it prints what came on each topic as JSON."""

import argparse
import collections
import json
import os
import sys
import threading
import time

from autobahn.twisted.websocket import WebSocketServerFactory, WebSocketServerProtocol
from twisted.internet import reactor, stdio
from twisted.internet.protocol import Protocol

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--port", type=int, default=0)
parser.add_argument("--ros", action="store_true", help="topics of a ROS master by rospy, instead of this process's own")
# Names and defaults of rosbridge_websocket.
parser.add_argument("--websocket_ping_interval", type=float, default=0)
parser.add_argument("--websocket_ping_timeout", type=float, default=30)
parser.add_argument("--any_traffic_is_a_pong", type=int, default=1, help="0: as Autobahn before 22.5")
parser.add_argument("--refuse", action="append", default=[], metavar="TOPIC", help="refuse what is done with this topic")
parser.add_argument("--refusals", type=int, default=0, help="print 'refused' after so many refusals")
parser.add_argument("--cut-after", type=int, default=0, help="abort the connection that publishes the Nth message")
parser.add_argument("--vary", action="store_true", help="send binary, in frames, in fragments, with noise in between")
options = parser.parse_args()

counts = collections.Counter()
topics = {}  # name -> what came on it
clients = set()
closes = []  # of each connection that was closed: [clean, code, reason]
round_trips_ms = []


def entry_of(topic, kind=""):
    return topics.setdefault(topic, {"type": kind, "count": 0, "wrong": [], "delivered": 0, "longest_gap_s": 0.0})


def note(topic, message):
    """Counts a message that a client has published."""
    entry, now = entry_of(topic), time.monotonic()
    entry["count"] += 1
    entry.setdefault("begun_s", now)
    entry["longest_gap_s"] = max(entry["longest_gap_s"], now - entry.get("ended_s", now))
    entry["ended_s"] = now
    entry["last"] = message
    seq = message.get("header", {}).get("seq")
    if seq is not None:
        last = entry.get("seq")
        if last is not None and seq <= last:
            entry["wrong"].append(f"seq {seq} after {last}")
        entry["seq"] = seq


class OwnTopics:
    """Topics that clients of this process share."""

    def __init__(self):
        self.subscribers = collections.defaultdict(set)

    def advertise(self, topic, kind):
        pass

    def unadvertise(self, topic):
        pass

    def subscribe(self, topic, kind, client):
        self.subscribers[topic].add(client)

    def forget(self, client):
        for listeners in self.subscribers.values():
            listeners.discard(client)

    def publish(self, topic, message):
        for client in list(self.subscribers[topic]):
            client.deliver(topic, message)


class RosTopics:
    """Topics of a ROS master. Messages go through rospy in both directions."""

    def __init__(self):
        import genpy
        import roslib.message
        import rospy

        rospy.init_node("rosbridge_websocket", disable_signals=True)
        self.rospy, self.fill, self.class_of = rospy, genpy.message.fill_message_args, roslib.message.get_message_class
        self.lock = threading.Lock()
        self.publishers, self.subscriptions, self.listeners = {}, {}, collections.defaultdict(set)

    def advertise(self, topic, kind):
        message_class = self.class_of(kind)
        if message_class is None:
            raise ValueError(f"Unable to load the message type {kind}")
        with self.lock:
            if topic not in self.publishers:
                self.publishers[topic] = self.rospy.Publisher(topic, message_class, queue_size=100)

    def unadvertise(self, topic):
        with self.lock:
            publisher = self.publishers.pop(topic, None)
        if publisher:
            publisher.unregister()

    def subscribe(self, topic, kind, client):
        with self.lock:
            self.listeners[topic].add(client)
            if topic not in self.subscriptions:
                hear = lambda message: self.hear(topic, message)
                self.subscriptions[topic] = self.rospy.Subscriber(topic, self.class_of(kind), hear, tcp_nodelay=True)

    def forget(self, client):
        with self.lock:
            for listeners in self.listeners.values():
                listeners.discard(client)

    def publish(self, topic, message):
        publisher = self.publishers[topic]
        filled = publisher.data_class()
        self.fill(filled, [message])
        publisher.publish(filled)

    def hear(self, topic, message):
        """Called by a thread of rospy."""
        plain = plain_of(message)
        with self.lock:
            listeners = list(self.listeners[topic])
        for client in listeners:
            reactor.callFromThread(client.deliver, topic, plain)


def plain_of(value):
    """A ROS message as rosbridge writes it in JSON."""
    if hasattr(value, "__slots__"):
        return {slot: plain_of(getattr(value, slot)) for slot in value.__slots__}
    if isinstance(value, (list, tuple)):
        return [plain_of(item) for item in value]
    return value


class Client(WebSocketServerProtocol):
    def onOpen(self):
        counts["clients"] += 1
        clients.add(self)
        self.advertised, self.pieces = {}, 0
        self.waiting, self.has_work, self.is_over = collections.deque(), threading.Condition(), False
        if options.ros:
            # rospy may block, and the thread of the sockets may not.
            threading.Thread(target=self.work, daemon=True).start()

    def onMessage(self, payload, is_binary):
        if not options.ros:
            return self.take(payload)
        with self.has_work:
            self.waiting.append(payload)
            self.has_work.notify()

    def work(self):
        while True:
            with self.has_work:
                while not self.waiting and not self.is_over:
                    self.has_work.wait()
                if self.is_over:
                    return
                counts["longest_backlog"] = max(counts["longest_backlog"], len(self.waiting))
                payload = self.waiting.popleft()
            self.take(payload)

    def take(self, payload):
        said = json.loads(payload)
        op, topic = said.get("op"), said.get("topic")
        try:
            if topic in options.refuse:
                raise ValueError(f"{topic} is not offered here")
            operation = getattr(self, "op_" + str(op), None)
            if operation is None:
                raise ValueError(f"Unknown operation: {op}")
            operation(topic, said)
        except ValueError as error:
            self.refuse(f"{op}: {error}", said.get("id"))

    def refuse(self, text, ident):
        counts["refusals"] += 1
        self.say({"op": "status", "level": "error", "msg": text, "id": ident})
        if counts["refusals"] == options.refusals:
            print("refused", flush=True)

    def op_advertise(self, topic, said):
        kind = said["type"]
        entry = entry_of(topic, kind)
        if entry["type"] not in ("", kind):
            raise ValueError(f"{topic} is already of the type {entry['type']}, not {kind}")
        entry["type"] = kind
        bridge.advertise(topic, kind)
        self.advertised[topic] = kind

    def op_unadvertise(self, topic, said):
        if self.advertised.pop(topic, None) is None:
            raise ValueError(f"{topic} was never advertised")
        bridge.unadvertise(topic)

    def op_subscribe(self, topic, said):
        bridge.subscribe(topic, said["type"], self)

    def op_publish(self, topic, said):
        if topic not in self.advertised:
            raise ValueError(f"Cannot infer topic type for topic {topic} as it is not yet advertised")
        note(topic, said["msg"])
        bridge.publish(topic, said["msg"])
        counts["published"] += 1
        if counts["published"] == options.cut_after:
            counts["cuts"] += 1
            self.transport.abortConnection()

    def deliver(self, topic, message):
        """Sends a message of a topic to this client."""
        if self not in clients:
            return
        entry_of(topic)["delivered"] += 1
        text = json.dumps({"op": "publish", "topic": topic, "msg": message})
        self.pieces += 1
        way = self.pieces % 4 if options.vary else 0
        if way == 0:
            self.sendMessage(text.encode())
        elif way == 1:
            self.sendMessage(text.encode(), isBinary=True)
        elif way == 2:
            self.sendMessage(text.encode(), fragmentSize=70)
        else:
            size = 100
            parts = [text[k : k + size] for k in range(0, len(text), size)]
            for num, data in enumerate(parts):
                self.say({"op": "fragment", "id": str(self.pieces), "data": data, "num": num, "total": len(parts)})
        if options.vary and self.pieces % 50 == 0:
            for odd in ("no json", "[]", '{"op": 7}', '{"op": "png", "data": "x"}', '{"op": "publish"}'):
                self.sendMessage(odd.encode())
            self.say({"op": "fragment", "id": "never", "data": "x", "num": 0, "total": 3})
            self.say({"op": "status", "level": "info", "msg": "all is well"})

    def say(self, message):
        counts["said"] += 1
        text = json.dumps(message).encode()
        if threading.current_thread() is threading.main_thread():
            self.sendMessage(text)
        else:
            reactor.callFromThread(self.sendMessage, text)

    def onPing(self, payload):
        counts["pings"] += 1
        super().onPing(payload)

    def onAutoPong(self, ping_sent, ping_seq, pong_received, pong_rtt, payload):
        round_trips_ms.append(pong_rtt)

    def onAutoPingTimeout(self):
        counts["unanswered_pings"] += 1
        super().onAutoPingTimeout()

    def onClose(self, was_clean, code, reason):
        clients.discard(self)
        closes.append([was_clean, code, reason])
        bridge.forget(self)
        with self.has_work:
            self.is_over = True
            self.has_work.notify()


class Input(Protocol):
    """The end of standard input ends the server."""

    def connectionLost(self, reason):
        reactor.stop()


def report():
    """What came and went, as JSON."""
    for entry in topics.values():
        seconds = entry.get("ended_s", 0) - entry.get("begun_s", 0)
        for count, rate in (("count", "hz"), ("delivered", "delivered_hz")):
            entry[rate] = entry[count] / seconds if seconds > 0 else 0.0
    counted = {"cuts": 0, "pings": 0, "said": 0, "unanswered_pings": 0, **counts}
    return json.dumps({"topics": topics, "open": still_open, "closes": closes, "round_trips_ms": round_trips_ms, **counted})


bridge = RosTopics() if options.ros else OwnTopics()
factory = WebSocketServerFactory()
factory.protocol = Client
factory.setProtocolOptions(
    autoPingInterval=options.websocket_ping_interval,
    autoPingTimeout=options.websocket_ping_timeout,
    autoPingRestartOnAnyTraffic=bool(options.any_traffic_is_a_pong),
)
print(reactor.listenTCP(options.port, factory, interface="127.0.0.1").getHost().port, flush=True)
stdio.StandardIO(Input())
reactor.run()
still_open = len(clients)
# Twisted leaves it non-blocking.
os.set_blocking(sys.stdout.fileno(), True)
print(report(), flush=True)
if options.ros:
    bridge.rospy.signal_shutdown("over")
