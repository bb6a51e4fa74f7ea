"""The examples of src/python/examples run, in short."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from city3d import envs

EXAMPLE = Path(__file__).parents[2] / "src/python/examples/learn_to_drive.py"


@pytest.fixture(scope="module")
def learning():
    return runpy.run_path(str(EXAMPLE))


def test_the_training_runs_in_short_and_says_how_it_compares(learning, monkeypatch, capsys):
    short = "--generations 2 --population 4 --seeds-each 1 --seconds 2 --worlds 2 --unseen 3".split()
    monkeypatch.setattr(sys, "argv", ["learn_to_drive.py", *short])
    learning["main"]()
    said = capsys.readouterr().out
    assert "generation 2" in said and re.search(r"better in [0-3] of 3, permutation test p = [0-9.]+", said), said


def test_its_returns_are_those_of_single_environments(learning):
    vector = envs.CityVectorEnv("roundabout", 3, duration_s=3.0, autoreset_mode=envs.AutoresetMode.DISABLED)
    policies = np.array([[0.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.3, -1.0, 1.0, 1.0]])
    together = learning["returns"](vector, policies, [5, 6])
    env = envs.CityEnv("roundabout", duration_s=3.0)
    for row, policy in enumerate(policies):
        for column, seed in enumerate([5, 6]):
            observation, _ = env.reset(seed=seed)
            total, is_over = 0.0, False
            while not is_over:
                action = np.clip((learning["features"](observation[None]) * policy).sum(), -1.0, 1.0)
                observation, reward, terminated, truncated, _ = env.step(np.array([action], np.float32))
                total, is_over = total + reward, terminated or truncated
            assert together[row, column] == pytest.approx(total)


def test_its_features_and_its_test_are_what_they_are_said_to_be(learning):
    observation = np.zeros((2, 29), np.float32)
    observation[:, 1] = 0.0
    observation[0, 0] = 0.7
    # Beside, behind, 20 m and 10 m ahead.
    for place, other in enumerate([(1, 0.2, 0.2, 0.1), (1, -0.1, 0.0, 0.2), (1, 0.4, 0.01, 0.3), (1, 0.2, -0.01, -0.4)]):
        observation[0, 4 + 5 * place : 8 + 5 * place] = other
    assert np.allclose(learning["features"](observation), [[1.0, 0.7, 1.0, -0.8], [1.0, 0.0, 4.0, 0.0]])
    test = learning["permutation_test"]
    assert test(np.full(10, 2.0)) == 2.0**-10 and test(np.zeros(5)) == 1.0
    differences = np.random.default_rng(1).normal(0.3, 1.0, 12)
    # Against signs that are drawn.
    signs = np.random.default_rng(2).choice([-1.0, 1.0], (200_000, 12))
    drawn = (signs @ differences >= differences.sum()).mean()
    assert test(differences) == pytest.approx(drawn, abs=0.005)
