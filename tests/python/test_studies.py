"""Shards from Python, as workers of a cluster run them, without a cluster."""

import csv
import json

import pyarrow.parquet
import pytest

from city3d import studies

WORDS = ["straight", "--seeds", "1..5", "--duration", "2", "--environment", "testbed", "--set", "environment.loss=0,0.1"]


def test_arguments_are_words_of_the_command():
    words = studies._words("straight", range(1, 6), {"environment.loss": [0, 0.1]}, 2, "testbed", None)
    assert sorted(words) == sorted(WORDS)
    words = studies._words("merge", [7, 2], {"a.b": True, "c": "0:1:0.5"}, None, None, "bicycle")
    assert words == ["merge", "--seeds", "7,2", "--model", "bicycle", "--set", "a.b=true", "--set", "c=0:1:0.5"]


def test_shards_of_workers_are_the_table_of_one_machine(tmp_path):
    studies._program("sweep", *WORDS, "--out", str(tmp_path / "one"))
    for index in range(3):
        studies._write(tmp_path / "shards" / f"{index}-of-3.csv", studies._shard(WORDS, index, 3))
    studies._program("sweep", *WORDS, "--out", str(tmp_path), "--merge")
    assert (tmp_path / "sweep.csv").read_bytes() == (tmp_path / "one" / "sweep.csv").read_bytes()


def test_arrow_reads_what_the_table_has(tmp_path):
    axes = ["--set", "environment.loss=0,0.1", "--set", "collisions_forbidden=true,false", "--set", "rates.control_hz=25,50"]
    studies._program("sweep", "straight", "--duration", "1", *axes, "--seeds", "1..9", "--out", str(tmp_path), "--parquet")
    table = pyarrow.parquet.read_table(tmp_path / "sweep.parquet")
    kinds = {"environment.loss": "double", "collisions_forbidden": "bool", "rates.control_hz": "int64", "seed": "int64"}
    kinds |= {"stops": "int64", "mean_speed_mps": "double", "plans": "int64", "state_hash": "string"}
    assert {name: str(table.schema.field(name).type) for name in kinds} == kinds
    with open(tmp_path / "sweep.csv", newline="") as file:
        expected = list(csv.DictReader(file))
    assert len(expected) == 72 and table.column_names == list(expected[0])
    read = {"bool": lambda cell: cell == "true", "int64": int, "double": float, "string": str}
    for row, cells in zip(table.to_pylist(), expected, strict=True):
        for name, cell in cells.items():
            assert row[name] == (read[str(table.schema.field(name).type)](cell) if cell else None), name
    assert table.schema.metadata[b"city3d.version"].decode() and any(cells["plans"] == "" for cells in expected)


def test_a_log_is_stored_with_its_summary(tmp_path):
    summary = studies._record(["straight", "--duration", "1"], 4, str(tmp_path / "store"), [])
    stored = tmp_path / "store" / "seed-4"
    assert summary == json.loads((stored / "summary.json").read_text()) and summary["seed"] == 4
    assert (stored / "run.mcap").stat().st_size > 0


def test_what_the_program_complains_of_is_raised(tmp_path):
    with pytest.raises(RuntimeError, match='unknown key "lost"'):
        studies._shard(["straight", "--set", "environment.lost=1"], 0, 1)
