"""Studies on a Ray cluster: the shards of `city3d sweep` as tasks, and logs and pictures of runs where the cluster stores.

Ray is only imported when a study is run (`pip install ray`). `ray.init` decides which cluster it is; where it was not called,
Ray takes the one of `RAY_ADDRESS`, or starts one on this machine. The workers need this package. A scenario that is a file
has to be at the same path on all of them, as `working_dir` of Ray's `runtime_env` does.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["record", "sweep"]


class _Killed(Exception):
    """The program was ended from outside, as by a machine that has no memory left: another try may work."""


def sweep(
    scenario: str,
    out: str | os.PathLike[str],
    *,
    shards: int,
    seeds: Iterable[int] | str | None = None,
    set: Mapping[str, Any] | None = None,
    duration_s: float | None = None,
    environment: str | None = None,
    model: str | None = None,
    parquet: bool = False,
    retries: int = 3,
) -> Path:
    """Runs a sweep in `shards` tasks of one processor each; returns the path of its table, `out/sweep.csv`.

    The table is that of `city3d sweep` on one machine, to the byte. `set` has the axes: a list of values, or a text as `--set`
    takes it. Shards that are in `out/shards` are not run again, so that a study that was stopped goes on. A task whose worker is
    lost or whose program is killed is tried again, `retries` times. `out` is on the machine of the caller.
    """
    import ray

    words = _words(scenario, seeds, set, duration_s, environment, model)
    folder = Path(out)
    places = {index: folder / "shards" / f"{index}-of-{shards}.csv" for index in range(shards)}
    task = ray.remote(num_cpus=1, max_retries=retries, retry_exceptions=[_Killed])(_shard)
    running = {task.remote(words, index, shards): place for index, place in places.items() if not place.exists()}
    while running:
        for done in ray.wait(list(running))[0]:
            _write(running.pop(done), ray.get(done))
    _program("sweep", *words, "--out", str(folder), "--merge", *(["--parquet"] if parquet else []))
    return folder / "sweep.csv"


def record(
    scenario: str,
    store: str | os.PathLike[str],
    *,
    seeds: Iterable[int],
    set: Mapping[str, Any] | None = None,
    duration_s: float | None = None,
    environment: str | None = None,
    model: str | None = None,
    pictures: Sequence[str] | None = None,
    retries: int = 3,
) -> list[dict[str, Any]]:
    """Runs a scenario once for each seed with its log; returns what `summary.json` has of each, in the order of the seeds.

    `store` is a folder that all workers reach, or the URL of a storage that fsspec knows, such as `s3://bucket/study`: the files
    of a run go into its folder `seed-N`. `pictures` has options of `city3d frames`, such as `["--camera", "chase", "--vehicle",
    "path1_a", "--every", "1"]`; the pictures go into `seed-N/pictures`.
    """
    import ray

    words = _words(scenario, None, set, duration_s, environment, model)
    place = str(store) if "://" in str(store) else str(Path(store).absolute())
    task = ray.remote(num_cpus=1, max_retries=retries, retry_exceptions=[_Killed])(_record)
    return ray.get([task.remote(words, seed, place, list(pictures or [])) for seed in seeds])


def _words(
    scenario: str,
    seeds: Iterable[int] | str | None,
    set: Mapping[str, Any] | None,
    duration_s: float | None,
    environment: str | None,
    model: str | None,
) -> list[str]:
    """The scenario and the options of a command."""
    if seeds is not None and not isinstance(seeds, str):
        given = list(seeds)
        is_range = len(given) > 1 and given == list(range(given[0], given[-1] + 1))
        seeds = f"{given[0]}..{given[-1]}" if is_range else ",".join(str(seed) for seed in given)
    words = [scenario]
    for option, value in [("--seeds", seeds), ("--duration", duration_s), ("--environment", environment), ("--model", model)]:
        if value is not None:
            words += [option, str(value)]
    for key, value in (set or {}).items():
        several = value if isinstance(value, (list, tuple)) else [value]
        words += ["--set", f"{key}={','.join(_word(one) for one in several)}"]
    return words


def _word(value: Any) -> str:
    """A value as the program reads it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _shard(words: list[str], index: int, count: int) -> bytes:
    """Runs a shard; returns its file."""
    with tempfile.TemporaryDirectory(prefix="city3d-") as folder:
        _program("sweep", *words, "--threads", "1", "--out", folder, "--shard", f"{index}/{count}")
        return Path(folder, "shards", f"{index}-of-{count}.csv").read_bytes()


def _record(words: list[str], seed: int, store: str, pictures: list[str]) -> dict[str, Any]:
    """Runs a seed with its log, and stores its files."""
    with tempfile.TemporaryDirectory(prefix="city3d-") as folder:
        run = Path(folder, "run")
        # A collision that the scenario forbids is an outcome, too.
        _program("run", *words, "--seed", str(seed), "--out", str(run), fine=(0, 1))
        if pictures:
            _program("frames", str(run / "run.mcap"), "--out", str(run / "pictures"), *pictures)
        summary = json.loads((run / "summary.json").read_text())
        _store(run, f"{store.rstrip('/')}/seed-{seed}")
    return summary


def _program(*words: str, fine: Sequence[int] = (0,)) -> None:
    """Runs the program in a process of its own; what it complains of is raised."""
    # With this package, wherever it was imported from.
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
    command = [sys.executable, "-m", "city3d", *words]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode < 0:
        raise _Killed(f"city3d {' '.join(words)} was ended by signal {-done.returncode}")
    if done.returncode not in fine:
        raise RuntimeError(done.stderr.strip() or f"city3d {' '.join(words)} exited with {done.returncode}")


def _write(path: Path, content: bytes) -> None:
    """Writes a file that appears under its name when it is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{path.name}.{os.getpid()}.part")
    beside.write_bytes(content)
    beside.replace(path)


def _store(folder: Path, place: str) -> None:
    """Copies a folder to a path or a URL."""
    if "://" not in place:
        shutil.copytree(folder, place, dirs_exist_ok=True)
        return
    import fsspec

    files, root = fsspec.core.url_to_fs(place)
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        target = f"{root}/{path.relative_to(folder).as_posix()}"
        files.makedirs(target.rsplit("/", 1)[0], exist_ok=True)
        files.put_file(str(path), target)
