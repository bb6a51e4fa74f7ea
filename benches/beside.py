"""A served city with its mainframe, and when the poses of each tick come from it, against an even beat."""

import contextlib
import subprocess

TICK_S = 0.01


def program(binary, *args):
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([binary, *args], **quiet)


@contextlib.contextmanager
def served_city(binary, scenario, port, folder, serving=(), controlling=()):
    """A city on a port and its mainframe, with their files in a folder; they end with the block."""
    address = f"127.0.0.1:{port}"
    where = ["--bind", address, "--out", f"{folder}/city", "--force"]
    city = program(binary, "serve", scenario, *where, *serving)
    where = ["--city", address, "--out", f"{folder}/far", "--force"]
    far = program(binary, "mainframe", scenario, *where, *controlling)
    try:
        yield
    finally:
        for one in (far, city):
            one.terminate()
            one.wait()


class Lateness:
    """By how many milliseconds the poses of each tick came later than an even beat, from pairs of tick and time."""

    def __init__(self, came):
        offsets = sorted(at - tick * TICK_S for tick, at in came)
        # The beat is that of the earliest tenth: nothing comes before its time.
        beat = offsets[len(offsets) // 10]
        self.sorted_ms = [1e3 * max(0.0, offset - beat) for offset in offsets]

    def at(self, part):
        return self.sorted_ms[min(len(self.sorted_ms) - 1, int(part * len(self.sorted_ms)))]
