#!/usr/bin/env python3
"""A browser on the web page of a city: Chromium, driven over its DevTools protocol.

web.py CHROMIUM URL FOLDER PIPE   opens the address with the token, uses the page, writes pictures of it into FOLDER,
                                  and prints one line a finding; asks through PIPE for another city at the same
                                  address; fails where something is not as it should be
web.py CHROMIUM URL FOLDER --log  the same with the page on a log of 20 s of the roundabout
"""

import asyncio
import base64
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request

import websockets

FLAGS = [
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--remote-debugging-port=0", "--hide-scrollbars",
]


class Tab:
    """One page of the browser."""

    def __init__(self, socket):
        self.socket, self.count = socket, 0

    async def call(self, method, **params):
        self.count += 1
        await self.socket.send(json.dumps({"id": self.count, "method": method, "params": params}))
        while True:
            answer = json.loads(await self.socket.recv())
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]

    async def run(self, script):
        found = await self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    async def until(self, script, seconds=30):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if await self.run(script):
                return
            await asyncio.sleep(0.02)
        raise AssertionError(f"not within {seconds} s: {script}; status: {await self.run('$(`status`).textContent')}")

    async def shoot(self, path, size=(1280, 900), phone=False):
        await self.call("Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1,
                        mobile=phone)
        await asyncio.sleep(0.7)
        picture = await self.call("Page.captureScreenshot", format="png")
        with open(path, "wb") as file:
            file.write(base64.b64decode(picture["data"]))


def ask(port, path, method="GET"):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", method=method)
    return json.load(urllib.request.urlopen(request))


async def open_tab(port, url):
    place = ask(port, "/json/new?about:blank", "PUT")["webSocketDebuggerUrl"]
    tab = Tab(await websockets.connect(place, max_size=None))
    await tab.call("Page.enable")
    await tab.call("Page.navigate", url=url)
    return tab


async def check(port, url, folder, restart):
    tab = await open_tab(port, url)
    await tab.until("typeof state === 'object' && state !== null && map !== null")
    await tab.until("mayOrder && state.vehicles.length > 0")
    print("page: state after", round(await tab.run("performance.now()")), "ms of the page's life (upper bound)")
    await tab.run("select(state.vehicles[0][0])")
    await tab.until("$('small').dataset.pictures > 0")
    print("page: first picture after", round(await tab.run("window.firstPicture")), "ms of the page's life, as",
          await tab.run("$('small').dataset.codec"))
    has_video = await tab.run("hasVideo")
    assert await tab.run("$('small').dataset.codec") == ("h264" if has_video else "jpeg")
    assert has_video or "CITY3D_HAS_H264" not in os.environ, "no H.264"
    await tab.run("$('start').click()")
    await tab.until("state.phase === 'running'")
    await tab.run("$('mode').value = 'orbit'; $('mode').onchange()")
    await tab.until("$('large').dataset.pictures > 3")
    await asyncio.sleep(4)
    await tab.shoot(f"{folder}/page.png")
    for mode in ["chase", "overhead"]:
        await tab.run(f"$('mode').value = '{mode}'; $('large').dataset.pictures = 0; $('mode').onchange()")
        await tab.until("$('large').dataset.pictures > 2")
    await tab.shoot(f"{folder}/phone.png", (390, 1400), True)
    await tab.call("Emulation.clearDeviceMetricsOverride")

    await tab.run("$('drive').click()")
    await tab.run("""window.pressed = performance.now(); window.moved = 0; window.pictured = 0;
        window.manual = setInterval(() => { const v = state.vehicles.find((v) => v[0] === selected);
            if (!window.moved && v[5] === 'manual' && v[7] > 0.5) {
                window.moved = performance.now(); $('small').addEventListener('picture', () => {
                    window.pictured ||= performance.now(); }); } }, 1);""")
    await tab.call("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW")
    await tab.until("window.pictured > 0")
    print("drive: key to state", round(await tab.run("moved - pressed")), "ms, to the next picture",
          round(await tab.run("pictured - pressed")), "ms")
    await tab.shoot(f"{folder}/drive.png")
    await tab.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")
    await tab.run("stopDriving()")
    await tab.until("state.vehicles.find((v) => v[0] === selected)[5] !== 'manual'")

    # On a phone: the bar steers, a field is gas.
    await tab.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    await tab.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
    await tab.run("$('drive').click(); $('pad').scrollIntoView()")
    wheel, gas = [await tab.run(f"(() => {{ const b = {element}.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; }})()")
                  for element in ("$('wheel')", "document.querySelector('[data-pedal=gas]')")]
    points = [{"x": wheel[0] + wheel[2] * 0.9, "y": wheel[1] + wheel[3] / 2, "id": 1},
              {"x": gas[0] + gas[2] / 2, "y": gas[1] + gas[3] / 2, "id": 2}]
    await tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=points)
    await tab.until("(() => { const v = state.vehicles.find((v) => v[0] === selected);"
                    " return v[5] === 'manual' && v[7] > 0.5 && v[6] < -0.2; })()")
    await tab.shoot(f"{folder}/touch.png", (390, 844), True)
    await tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    await tab.until("(() => { const v = state.vehicles.find((v) => v[0] === selected); return v[7] < 0.1; })()")
    await tab.run("stopDriving()")
    await tab.call("Emulation.setTouchEmulationEnabled", enabled=False)
    await tab.call("Emulation.clearDeviceMetricsOverride")
    print("touch: steers right with gas, and lets go")

    await check_guest(port, url, tab, folder)
    if has_video:
        await check_fallback(port, url, tab)

    watching = url.split("#")[0]
    visitor = await open_tab(port, watching)
    await visitor.until("typeof state === 'object' && state !== null && state.vehicles.length > 0")
    await visitor.run("select(state.vehicles[1][0])")
    await visitor.until("$('small').dataset.pictures > 0")
    first = round(await visitor.run("window.firstPicture"))
    print("a visitor: first picture after", first, "ms of the page's life")
    assert first < 1000, first
    await visitor.call("Page.close")

    others = [await open_tab(port, watching) for _ in range(19)]
    await tab.until("state.pages === 20", 60)
    is_told = "typeof state === 'object' && state !== null && !mayOrder"
    await asyncio.gather(*(other.until(is_told, 60) for other in others))
    rate = await tab.run("state.rate")
    print("twenty pages: real-time factor", rate)
    await tab.shoot(f"{folder}/twenty.png")

    before = time.monotonic()
    restart.write("another city\n")
    restart.flush()
    # The token is that of the city before, so the page watches.
    await tab.until("state.tick < 2000 && !mayOrder && state.vehicles.length > 0", 60)
    print("restart: the page shows the new city after", round(time.monotonic() - before, 1), "s")
    await tab.shoot(f"{folder}/restart.png")


async def check_guest(port, url, tab, folder):
    """A page joins with a car of its own and drives it; a second one waits until the first one leaves."""
    own_speed = "state.vehicles.find((v) => v[0] === own)[4]"
    assert await tab.run("!$('join').hidden && $('join').textContent === 'Join with a car of my own'")
    before = time.monotonic()
    await tab.run("$('join').click()")
    await tab.until("own !== null && driven === own && selected === own")
    print("guest: at the wheel of a car of its own after", round(time.monotonic() - before, 1), "s")
    await tab.call("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW")
    await tab.until(f"{own_speed} > 1.5 && $('large').dataset.pictures > 2")
    await tab.run("scrollTo(0, 0)")
    await tab.shoot(f"{folder}/guest.png")
    await tab.shoot(f"{folder}/guest-phone.png", (390, 1700), True)
    await tab.call("Emulation.clearDeviceMetricsOverride")
    await tab.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")

    other = await open_tab(port, url)
    await other.until("typeof state === 'object' && state !== null && !$('join').hidden")
    await other.run("$('join').click()")
    await other.until("$('notice').textContent.includes('your car waits outside') && own === null")
    await tab.run("$('join').click()")
    await other.until("own !== null && $('notice').textContent.includes('steer')")
    await tab.until("own === null && $('join').textContent === 'Join with a car of my own'")
    car = await other.run("own")
    await other.call("Page.close")
    await tab.until(f"!state.vehicles.some(([id]) => id === {car})")
    await tab.run("select(state.vehicles[0][0])")
    print("guest: one waits outside until the other leaves, and a closed page takes its car along")


async def check_fallback(port, url, tab):
    """Without a decoder of H.264, from the start or all at once, pictures come as JPEG."""
    await tab.run("$('mode').value = 'orbit'; $('mode').onchange()")
    await tab.until("$('large').dataset.codec === 'h264' && decoders.every((it) => it && it.state === 'configured')")
    await tab.run("decoders[LARGE].close()")
    await tab.until("PLACES.every((place) => $(place).dataset.codec === 'jpeg')")
    count = await tab.run("Number($('small').dataset.pictures)")
    await tab.until(f"$('small').dataset.pictures > {count + 3}")
    older = await open_tab(port, "about:blank")
    await older.call("Page.addScriptToEvaluateOnNewDocument", source="delete window.VideoDecoder")
    await older.call("Page.navigate", url=url)
    await older.until("typeof state === 'object' && state !== null && state.vehicles.length > 0")
    await older.run("select(state.vehicles[1][0])")
    await older.until("$('small').dataset.pictures > 3")
    assert await older.run("$('small').dataset.codec") == "jpeg"
    await older.call("Page.close")
    print("without a decoder of H.264 the pages go on with JPEG")


async def check_log(port, url, folder):
    """A log of 20 s: any time of it, played, with its events."""
    tab = await open_tab(port, url)
    await tab.until("typeof state === 'object' && state !== null && map !== null && told && told.count > 0")
    assert await tab.run("isLog && mayOrder && !$('timeline').hidden && $('reset').hidden && $('drive').hidden")
    await tab.run("$('mode').value = 'orbit'; $('mode').onchange(); select(state.vehicles[0][0])")
    await tab.until("$('large').dataset.pictures > 0")
    await tab.run("$('seek').value = 12; $('seek').onchange()")
    await tab.until("state.time === 12 && $('at').textContent === '12.0 of 20.0 s'")
    known = await tab.run("$('events').children.length")
    await tab.run("$('start').click()")
    await tab.until("state.phase === 'running' && state.time > 13")
    await tab.shoot(f"{folder}/log.png")
    await tab.run("$('speed').value = '5'; $('speed').onchange()")
    await tab.until("state.phase === 'paused' && state.time === 20")
    assert await tab.run("$('events').children.length") >= known > 0
    await tab.run("$('seek').value = 0; $('seek').onchange()")
    await tab.until("state.time === 0 && $('events').children.length < 10")
    print("log: played, sought, with", await tab.run("told.count"), "events")


async def main(chromium, url, folder, pipe):
    is_log = pipe == "--log"
    with tempfile.TemporaryDirectory() as profile, open(os.devnull if is_log else pipe, "w", encoding="utf-8") as restart:
        browser = subprocess.Popen([chromium, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
                                   stderr=subprocess.PIPE, text=True)
        try:
            for line in browser.stderr:
                found = re.search(r"ws://127\.0\.0\.1:(\d+)/", line)
                if found:
                    break
            port = int(found.group(1))
            await (check_log(port, url, folder) if is_log else check(port, url, folder, restart))
        finally:
            browser.terminate()
            browser.wait()


if __name__ == "__main__":
    os.makedirs(sys.argv[3], exist_ok=True)
    asyncio.run(main(*sys.argv[1:5]))
