"""When the poses of each tick of a served city come, against an even beat: without a window and with one, in turns.

    xvfb-run -a -s "-screen 0 1280x720x24" python3 benches/beside_window.py target/release/city3d [--realtime]

50 cars with their mainframe. --realtime gives this subscriber a real-time priority, so that it does not wait for the
display server on the same processors; it takes rights.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from beside import Lateness, served_city

sys.path.insert(0, str(Path(__file__).parent.parent / "clients/python"))
from city3d_link import City  # noqa: E402

PORT, TICKS, TURNS = 19_879, 1000, 3
DRIVING_S = 8.0


def lateness(window, folder):
    view = ["--adapter", "software"] if window else ["--headless"]
    with served_city(sys.argv[1], "city", PORT, folder, view):
        link = City(port=PORT, patience=60.0)
        link.subscribe()
        came = []
        while len(came) < TICKS:
            for poses in link.poses(60.0):
                now = time.monotonic()
                if poses.phase == 1 and poses.time > DRIVING_S:
                    came.append((poses.tick, now))
                if len(came) == TICKS:
                    break
        return Lateness(came)


def main():
    if "--realtime" in sys.argv:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(TURNS):
            for window in (False, True):
                late = lateness(window, folder)
                median, most, nearly, latest = (late.at(part) for part in (0.5, 0.9, 0.99, 1))
                name = "with the window" if window else "headless"
                print(f"{name:16} median {median:.2f}  90 % {most:.2f}  99 % {nearly:.2f}  latest {latest:.2f} ms", flush=True)


if __name__ == "__main__":
    main()
