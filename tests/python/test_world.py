"""Worlds of the package: equal to runs of the program, saved and restored, driven and seen."""

import json
import os
import subprocess
import threading

import numpy as np
import pytest

import city3d

AT = {name: place for place, name in enumerate(city3d.COLUMNS)}


def program_digest(tmp_path, *options: str) -> str:
    """Digest of a run of the program, which runs in a process of its own."""
    folder = tmp_path / "run"
    arguments = ["city3d", "run", *options, "--out", str(folder), "--no-log"]
    code = f"import city3d; raise SystemExit(city3d.run_program({arguments!r}))"
    path = os.environ.get("CITY3D_PACKAGE", "")
    subprocess.run(["python3", "-c", code], check=True, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.DEVNULL)
    return json.loads((folder / "summary.json").read_text())["state_hash"]


@pytest.mark.parametrize("options", [{}, {"seed": 7, "environment": "testbed"}, {"model": "bicycle"}])
def test_a_world_is_equal_to_a_run_of_the_program(tmp_path, options):
    world = city3d.World("roundabout", **options)
    while not world.is_over:
        world.step()
    of_program = [text for key, value in options.items() for text in (f"--{key}", str(value))]
    assert world.digest == program_digest(tmp_path, "roundabout", *of_program)
    assert world.time_s == world.duration_s == 40.0


def test_states_have_the_documented_columns():
    world = city3d.World("roundabout")
    world.step(5.0)
    states = world.states()
    assert states.shape == (6, len(city3d.COLUMNS)) and states.dtype == np.float64
    assert states[:, AT["id"]].tolist() == world.ids.tolist() == list(world.names)
    velocity = states[:, [AT["vx_mps"], AT["vy_mps"]]]
    heading = states[:, AT["heading_rad"]]
    along = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    assert np.allclose(along, states[:, AT["speed_mps"]], atol=0.05)
    before = states[:, AT["distance_m"]]
    world.step(0.1)
    driven = world.states()[:, AT["distance_m"]] - before
    assert np.allclose(driven, 0.1 * states[:, AT["speed_mps"]], atol=0.05)
    assert city3d.STATUSES[int(states[0, AT["status"]])] == "driving"


def test_a_run_repeats_after_a_reset_and_differs_with_another_seed():
    world = city3d.World("roundabout", seed=3, environment="testbed")
    digests = []
    for seed in (None, None, 4, 3):
        world.reset(seed)
        world.step(10.0)
        digests.append(world.digest)
    assert digests[0] == digests[1] == digests[3] != digests[2]
    assert world.seed == 3


def test_saved_worlds_are_restored_to_the_bit():
    world = city3d.World("roundabout")
    world.step(3.0)
    world.drive(2, gas=0.6, steering_rad=0.05)
    world.step(1.0)
    saved, at = world.save(), world.digest
    world.release(2)
    world.step(4.0)
    later = world.digest
    world.restore(saved)
    assert world.digest == at and world.time_s == 4.0
    world.release(2)
    world.step(4.0)
    assert world.digest == later
    with pytest.raises(ValueError, match="another scenario"):
        city3d.World("roundabout", seed=9).restore(saved)


def test_pedals_drive_a_vehicle_and_events_tell_what_comes_of_it():
    world = city3d.World("straight")
    vehicle = world.ids[:1]
    for _ in range(80):
        world.act(vehicle, np.array([[1.0, 0.0, 0.3]]))
        world.step()
    events = world.events()
    assert {"t", "vehicle", "kind"} <= events[0].keys()
    assert any(event["kind"].startswith("collision") for event in events), events
    assert world.events() == [], "each event is told once"


def test_pictures_are_arrays_of_every_kind():
    world = city3d.World("roundabout", quality="low")
    world.step(1.0)
    cameras = [city3d.Camera.onboard(1), city3d.Camera.chase(2), city3d.Camera.overhead()]
    rgb = world.pictures(cameras, 64, 48)
    assert rgb.shape == (3, 48, 64, 3) and rgb.dtype == np.uint8 and len(np.unique(rgb)) > 50
    depth = world.pictures(cameras[2:], 64, 48, kind="depth")
    assert depth.shape == (1, 48, 64) and depth.dtype == np.float32
    assert 100.0 < np.median(depth) < 201.0, "the camera is 200 m high"
    classes = world.pictures(cameras, 64, 48, kind="semantic")
    assert {city3d.CLASSES[k] for k in np.unique(classes)} >= {"road", "building", "vehicle"}
    ids = world.pictures(cameras[1:2], 64, 48, kind="instance")
    assert 2 in np.unique(ids), "the chased vehicle is seen"
    looking = city3d.Camera.looking_at((0.0, -200.0, 80.0), (0.0, 0.0, 0.0))
    assert world.pictures([looking], 8, 8).shape == (1, 8, 8, 3)


class Idm:
    """The intelligent driver model, in laboratory metres."""

    def __init__(self, vehicle, parameters):
        self.parameters = parameters

    def acceleration(self, speed, desired, gap, leader):
        p = self.parameters
        free = 1.0 - (speed / max(desired, 1e-6)) ** 4
        if gap is None:
            return p["max_acceleration_mps2"] * free
        comfort = (p["max_acceleration_mps2"] * -p["min_acceleration_mps2"]) ** 0.5
        wanted = p["standstill_gap_m"] + max(0.0, speed * p["headway_s"] + speed * (speed - leader) / (2 * comfort))
        return p["max_acceleration_mps2"] * (free - (wanted / max(gap, 1e-3)) ** 2)


def test_a_class_of_python_drives():
    asked = set()

    class Counted(Idm):
        def __init__(self, vehicle, parameters):
            super().__init__(vehicle, parameters)
            self.vehicle = vehicle

        def acceleration(self, *now):
            asked.add(self.vehicle)
            return super().acceleration(*now)

    world = city3d.World("roundabout", set={"driver.default.controller": "own"}, drivers={"own": Counted})
    while not world.is_over:
        world.step()
    assert not any(event["kind"].startswith("collision") for event in world.events())
    assert world.states()[:, AT["distance_m"]].min() > 100.0
    assert asked == {1, 2, 3, 4, 5, 6}
    by_library = city3d.World("roundabout")
    by_library.step(40.0)
    assert world.digest != by_library.digest, "it is not the same as the built-in one"


def test_what_a_driver_raises_is_raised_by_the_step():
    class Lost(Idm):
        def acceleration(self, *now):
            raise LookupError("no idea")

    world = city3d.World("roundabout", set={"driver.default.controller": "own"}, drivers={"own": Lost})
    with pytest.raises(LookupError, match="no idea"):
        world.step()
    drivers = {"own": lambda vehicle, parameters: type("Nan", (), {"acceleration": lambda *now: float("nan")})()}
    world = city3d.World("roundabout", set={"driver.default.controller": "own"}, drivers=drivers)
    with pytest.raises(ValueError, match="answers NaN"):
        world.step()


def test_what_a_driver_raises_when_it_is_made_is_raised_by_the_world():
    def refuse(vehicle, parameters):
        raise LookupError(f"not {vehicle}")

    with pytest.raises(LookupError, match="not 1"):
        city3d.World("roundabout", set={"driver.default.controller": "own"}, drivers={"own": refuse})


def test_a_driver_that_asks_its_world_is_told_why_not():
    worlds = []

    class Curious(Idm):
        def acceleration(self, *now):
            return float(worlds[0].time_s)

    worlds.append(city3d.World("roundabout", set={"driver.default.controller": "own"}, drivers={"own": Curious}))
    with pytest.raises(RuntimeError, match="is in use"):
        worlds[0].step()


def test_worlds_are_stepped_side_by_side_and_threads_run_meanwhile():
    alone = [city3d.World("roundabout", seed=seed) for seed in range(4)]
    together = [city3d.World("roundabout", seed=seed) for seed in range(4)]
    counted = [0]
    is_over = threading.Event()

    def count():
        while not is_over.is_set():
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    city3d.step_worlds(together, 40.0)
    meanwhile = counted[0] - before
    is_over.set()
    thread.join()
    for world in alone:
        world.step(40.0)
    assert [world.digest for world in alone] == [world.digest for world in together]
    assert meanwhile > 100, "a thread that counts gets nowhere while the lock is held"


def test_a_command_runs_in_the_process_and_a_script_runs_once(tmp_path):
    commands = [["run", "straight", "--duration", "1", "--out", str(tmp_path / "a")], ["check", "straight"], ["--help"], ["fly"]]
    script = tmp_path / "script.py"
    script.write_text(f"import city3d\nprint('once')\nfor command in {commands!r}:\n    print('code', city3d.run_program(['city3d', *command]), flush=True)\n")
    environment = {key: value for key, value in os.environ.items() if key != "XDG_RUNTIME_DIR"}
    environment["PYTHONPATH"] = os.environ.get("CITY3D_PACKAGE", "")
    run = subprocess.run(["python3", str(script)], capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("once") == 1
    assert [line for line in run.stdout.splitlines() if line.startswith("code")] == ["code 0", "code 0", "code 0", "code 2"]
    assert "Usage: city3d" in run.stdout and "fly" in run.stderr


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: city3d.World("nowhere"), "neither a file nor one of the shipped scenarios"),
        (lambda: city3d.World("roundabout", set={"driver.default.controler": "x"}), "did you mean"),
        (lambda: city3d.World("roundabout", environment="moon"), '"ideal" or "testbed"'),
        (lambda: city3d.World("roundabout", quality="best"), "there are auto, low"),
        (lambda: city3d.World("roundabout", model="boat"), '"raycast" or "bicycle"'),
        (lambda: city3d.World("roundabout").step(0.003), "no whole number of steps"),
        (lambda: city3d.World("roundabout").step(float("nan")), "no whole number of steps"),
        (lambda: city3d.World("roundabout").drive(99), "no vehicle 99"),
        (lambda: city3d.World("roundabout").act(np.array([1], np.uint32), np.zeros((2, 3))), "one row of 3"),
        (lambda: city3d.World("roundabout").act([1], [[0.0]], "pull"), "there are pedals, acceleration, along_route, trajectory"),
        (lambda: city3d.World("roundabout").pictures([city3d.Camera.onboard(1)], 0, 9), "1 to 8192"),
        (lambda: city3d.World("roundabout").pictures([], kind="sound"), "rgb, depth, semantic, instance"),
        (lambda: city3d.Camera.onboard(1, "roof"), "windscreen"),
    ],
)
def test_what_is_asked_for_wrongly_is_told(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()
