"""Logs as tables and figures, pictures and animations of notebooks."""

import csv
import io
import struct
import subprocess

import numpy as np
import pyarrow
import pytest
from xml.etree import ElementTree

import city3d


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "roundabout"
    assert city3d.run_program(["city3d", "run", "roundabout", "--out", str(folder)]) == 0
    return folder


def test_a_log_has_the_states_of_the_run(run):
    log = city3d.read(run)
    table = log.vehicles
    assert (log.scenario, log.seed, log.end_s, log.truncation) == ("roundabout", 2, 40.0, None)
    with (run / "vehicles.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["id"] == "4" and float(row["t"]) <= 40.0]
    own = table["id"] == 4
    times = table["time_s"][own]
    for column, name, digits in [("x", "x_m", 4), ("speed", "speed_mps", 4), ("distance", "distance_m", 3), ("gas", "gas", 4)]:
        places = np.searchsorted(times, [float(row["t"]) - 1e-6 for row in rows])
        assert np.allclose(table[name][own][places], [float(row[column]) for row in rows], atol=0.6 * 10**-digits)
    names = np.array(table["name"])[own]
    assert set(names) == {"path2_a"} and "west-roundabout/ring/outer/3" in table["lane"]
    assert len(log.events) == len((run / "summary.json").read_text().split('"kind"')) - 1
    with pytest.raises(KeyError, match="there are id, name, time_s"):
        table["velocity"]


def test_arrow_takes_a_table_without_a_copy(run):
    log = city3d.read(run / "run.mcap")
    first, second = pyarrow.table(log), pyarrow.table(log.vehicles)
    assert first.num_rows == len(log.vehicles) and first.column_names == log.vehicles.column_names
    first.validate(full=True)
    address = [table["speed_mps"].chunk(0).buffers()[1].address for table in (first, second)]
    assert address[0] == address[1], "both are the memory of the log"
    assert pyarrow.schema(log.vehicles) == first.schema
    speeds = first["speed_mps"].to_numpy()
    del log, second
    assert np.isfinite(speeds).all() and speeds.max() > 5.0
    assert first["station_m"].null_count >= 0 and first["lane"].type.value_type == pyarrow.string()


def test_figures_are_those_of_the_program(run, tmp_path):
    assert city3d.run_program(["city3d", "plot", str(run), "--out", str(tmp_path / "plot")]) == 0
    figures = city3d.read(run).figures()
    assert {path.stem for path in (tmp_path / "plot").glob("*.svg")} == set(figures)
    for name, figure in figures.items():
        assert figure.svg().encode() == (tmp_path / f"plot/{name}.svg").read_bytes()
        assert figure.csv().encode() == (tmp_path / f"plot/{name}.csv").read_bytes()
    assert figures["space_time"].png() == (tmp_path / "plot/space_time.png").read_bytes()
    ElementTree.fromstring(figures["space_time"]._repr_svg_())
    figures["pedals"].save(tmp_path)
    assert (tmp_path / "pedals.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    only = city3d.read(run).figures(vehicles=[1], size="column")["speed_time"]
    assert {row["vehicle"] for row in csv.DictReader(io.StringIO(only.csv()))} == {"1"}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda run: city3d.read(run / "summary.json"), "summary.json"),
        (lambda run: city3d.read(run / "nothing.mcap"), "nothing.mcap"),
        (lambda run: city3d.read(run).figures(size="poster"), '"page" or "column"'),
        (lambda run: city3d.read(run).figures(vehicles=[77]), "no vehicle 77"),
        (lambda run: city3d.read(run).figures(merge="nowhere"), "nowhere"),
        (lambda run: city3d.World("straight").animation(0.0), "pictures are possible"),
        (lambda run: city3d.World("straight").animation(float("nan")), "pictures are possible"),
        (lambda run: city3d.World("straight").animation(1.0, speed=0.0), "times as fast"),
    ],
)
def test_what_is_asked_for_wrongly_is_told(run, wrong, message):
    with pytest.raises((ValueError, OSError), match=message):
        wrong(run)


def chunks(png: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while at < len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        found.append((png[at + 4 : at + 8], png[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def pixels(path, frame: int) -> np.ndarray:
    """A picture of a file, as ffmpeg sees it."""
    select = ["-vf", f"select=eq(n\\,{frame})", "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    run = subprocess.run(["ffmpeg", "-v", "error", "-i", str(path), *select], check=True, capture_output=True)
    return np.frombuffer(run.stdout, np.uint8)


def test_an_animation_shows_the_run(tmp_path):
    world, still = (city3d.World("roundabout", quality="low") for _ in range(2))
    camera = city3d.Camera.overhead(-100.0, 0.0, 120.0)
    animation = world.animation(1.0, camera=camera, width=96, height=64, fps=5, speed=2.0)
    assert len(animation) == 5 and animation.duration_s == pytest.approx(0.5) and world.time_s == 1.0
    parts = chunks(animation._repr_png_())
    assert [kind for kind, _ in parts].count(b"fcTL") == 5
    delays = {struct.unpack(">HH", data[20:24]) for kind, data in parts if kind == b"fcTL"}
    assert delays == {(100, 1000)}, "a fifth of a second at twice the speed"
    animation.save(tmp_path / "run.png")
    still.step(1.0)
    last = still.pictures([camera], 96, 64)[0]
    assert np.array_equal(pixels(tmp_path / "run.png", 4).reshape(64, 96, 3), last)
    animation.save(tmp_path / "run.mp4")
    assert np.abs(pixels(tmp_path / "run.mp4", 4).reshape(64, 96, 3).astype(int) - last).mean() < 12
    with pytest.raises(ValueError, match="png, mp4"):
        animation.save(tmp_path / "run.txt")


def test_a_notebook_shows_a_world():
    world = city3d.World("merge", quality="low")
    png = world._repr_png_()
    assert png[:8] == b"\x89PNG\r\n\x1a\n" and struct.unpack(">II", png[16:24]) == (640, 480)
    classes = world.pictures([world.overview(320, 240)], 320, 240, kind="semantic")[0]
    columns = np.flatnonzero((classes == city3d.CLASSES.index("road")).any(axis=0))
    assert columns.min() < 60 and columns.max() > 260, "the road is seen from end to end"
