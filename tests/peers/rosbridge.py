"""A rosbridge for tests: relays topics between its clients as JSON over WebSocket, the way rosbridge_server does.

Prints its port. Hands messages on whole, in fragments of the protocol, in frames of the WebSocket, as text and as
binary by turns, with things in between that a client has to bear. The first client that publishes is cut off once, in
the middle of its run. When its input ends it prints what came on each topic."""

import asyncio
import json
import sys

import websockets

CUT_AFTER = 600
topics = {}  # topic -> {"type", "count", "first", "last", "wrong", "gaps"}
subscribers = {}  # topic -> set of clients
counts = {"clients": 0, "published": 0, "cuts": 0, "pieces": 0}


def note(topic, message):
    entry = topics[topic]
    entry["count"] += 1
    entry.setdefault("first", message)
    entry["last"] = message
    seq = message.get("header", {}).get("seq")
    if seq is not None:
        last = entry.get("seq")
        if last is not None and seq <= last:
            entry["wrong"].append(f"seq {seq} after {last}")
        entry["seq"] = seq


async def hand_on(client, topic, message):
    text = json.dumps({"op": "publish", "topic": topic, "msg": message})
    counts["pieces"] += 1
    way = counts["pieces"] % 4
    try:
        if way == 0:
            await client.send(text)
        elif way == 1:
            await client.send(text.encode())
        elif way == 2:
            # Frames of one WebSocket message.
            await client.send(iter([text[:50], text[50:120], text[120:]]))
        else:
            size = 100
            parts = [text[k : k + size] for k in range(0, len(text), size)]
            for num, data in enumerate(parts):
                part = {"op": "fragment", "id": str(counts["pieces"]), "data": data, "num": num, "total": len(parts)}
                await client.send(json.dumps(part))
        if counts["pieces"] % 50 == 0:
            for odd in ("no json", "[]", '{"op": 7}', '{"op": "png", "data": "x"}', '{"op": "publish"}'):
                await client.send(odd)
            await client.send(json.dumps({"op": "fragment", "id": "never", "data": "x", "num": 0, "total": 3}))
            await client.send(json.dumps({"op": "status", "level": "info", "msg": "all is well"}))
    except websockets.ConnectionClosed:
        pass


async def serve(client):
    counts["clients"] += 1
    advertised = {}
    try:
        async for text in client:
            said = json.loads(text)
            op, topic = said["op"], said.get("topic")
            if op == "advertise":
                advertised[topic] = said["type"]
                entry = topics.setdefault(topic, {"type": said["type"], "count": 0, "wrong": []})
                if entry["type"] != said["type"]:
                    entry["wrong"].append(said["type"])
            elif op == "unadvertise":
                advertised.pop(topic)
            elif op == "subscribe":
                subscribers.setdefault(topic, set()).add(client)
            elif op == "publish":
                if topic not in advertised:
                    topics.setdefault(topic, {"type": "", "count": 0, "wrong": []})["wrong"].append("not advertised")
                note(topic, said["msg"])
                for other in list(subscribers.get(topic, ())):
                    await hand_on(other, topic, said["msg"])
                counts["published"] += 1
                if counts["published"] == CUT_AFTER:
                    counts["cuts"] += 1
                    client.transport.abort()
                    return
            else:
                raise ValueError(said)
    except websockets.ConnectionClosed:
        pass
    finally:
        for listeners in subscribers.values():
            listeners.discard(client)


async def main():
    async with websockets.serve(serve, "127.0.0.1", 0, compression=None) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    print(json.dumps({"topics": topics, **counts}))


asyncio.run(main())
