#!/usr/bin/env python3
"""Clients of a page and of Foxglove for scripts/ends_lateness.sh: of each one that reads, and one that asks for everything
and reads nothing.

ends_clients.py PAGE_URL FOXGLOVE_URL all|pictures
"""

import asyncio
import json
import sys

import websockets

PICTURES = [{"mode": "orbit", "x_m": 0, "y_m": 0, "distance_m": 120, "azimuth_deg": 220, "elevation_deg": 35},
            {"mode": "onboard", "vehicle": 1}]


async def page(url, reads, has_pictures):
    base, token = url.split("/#")
    host = base.removeprefix("http://")
    async with websockets.connect(f"ws://{host}/socket", origin=base, max_size=None, max_queue=2,
                                  ping_interval=None) as socket:
        await socket.send(json.dumps({"t": "hello", "token": token}))
        if has_pictures:
            for slot, view in enumerate(PICTURES):
                await socket.send(json.dumps({"t": "look", "slot": slot, "view": view, "width": 480, "height": 320}))
        if not reads:
            socket.transport.pause_reading()
            await asyncio.sleep(3600)
        async for message in socket:
            if isinstance(message, bytes):
                await socket.send(json.dumps({"t": "seen", "slot": message[0]}))


async def foxglove(url, reads, has_pictures):
    async with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None, max_queue=2,
                                  ping_interval=None) as socket:
        pictures = 0
        async for message in socket:
            if not isinstance(message, str):
                continue
            message = json.loads(message)
            if message["op"] != "advertise":
                continue
            wanted = []
            for channel in message["channels"]:
                is_picture = channel["topic"].endswith(("/image", "/calibration"))
                pictures += is_picture
                if not is_picture or (has_pictures and pictures <= 2):
                    wanted.append({"id": channel["id"], "channelId": channel["id"]})
            await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            if not reads:
                await asyncio.sleep(0.5)
                socket.transport.pause_reading()
                await asyncio.sleep(3600)


async def staying(client, *args):
    """The server disconnects who does not read: then the same again."""
    while True:
        try:
            await client(*args)
        except (OSError, websockets.WebSocketException):
            pass
        await asyncio.sleep(0.5)


async def main(page_url, foxglove_url, case):
    has_pictures = case == "pictures"
    await asyncio.gather(*(staying(client, url, reads, has_pictures)
                           for client, url in ((page, page_url), (foxglove, foxglove_url)) for reads in (True, False)))


asyncio.run(main(*sys.argv[1:]))
