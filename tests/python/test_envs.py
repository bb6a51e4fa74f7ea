"""Environments of Gymnasium and PettingZoo, by the libraries' own checkers."""

import gc
import warnings
import weakref

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test

import city3d
from city3d import envs

IDS = ["City3D/Roundabout-v0", "City3D/Merge-v0", "City3D/City-v0"]


@pytest.mark.parametrize("name", IDS)
def test_the_checker_of_gymnasium_passes(name):
    env = gymnasium.make(name, duration_s=90.0 if "Merge" in name else 20.0)
    with warnings.catch_warnings():
        # That observations have no bounds, which physical ones have not.
        warnings.simplefilter("ignore")
        check_env(env.unwrapped, skip_render_check=True)


def test_the_checkers_of_pettingzoo_pass():
    parallel_api_test(envs.CityParallelEnv("roundabout"), num_cycles=500)
    parallel_seed_test(lambda: envs.CityParallelEnv("roundabout", environment="testbed"))


def test_a_full_throttle_is_faster_than_a_full_brake_and_both_end():
    driven = {}
    for action in (-1.0, 1.0):
        env = gymnasium.make("City3D/Roundabout-v0")
        env.reset(seed=5)
        total, is_over, steps = 0.0, False, 0
        while not is_over:
            _, reward, terminated, truncated, _ = env.step(np.array([action], np.float32))
            total, is_over, steps = total + reward, terminated or truncated, steps + 1
        assert steps <= 400
        driven[action] = total
    assert driven[-1.0] < 20.0 < driven[1.0], driven


def test_a_vector_of_environments_is_equal_to_its_parts():
    vector = gymnasium.make_vec("City3D/Roundabout-v0", num_envs=3, vectorization_mode="vector_entry_point")
    singles = [gymnasium.make("City3D/Roundabout-v0") for _ in range(3)]
    together, _ = vector.reset(seed=11)
    alone = np.stack([env.reset(seed=11 + k)[0] for k, env in enumerate(singles)])
    assert np.array_equal(together, alone)
    random = np.random.default_rng(1)
    for _ in range(60):
        actions = random.uniform(-1, 1, (3, 1)).astype(np.float32)
        seen, rewards, *_ = vector.step(actions)
        parts = [env.step(action)[:2] for env, action in zip(singles, actions, strict=True)]
        assert np.array_equal(seen, np.stack([part[0] for part in parts]))
        assert np.allclose(rewards, [part[1] for part in parts])


def test_an_environment_of_a_vector_begins_anew_with_the_step_after_its_end():
    vector = envs.CityVectorEnv("roundabout", 2, duration_s=1.0)
    first, _ = vector.reset(seed=0)
    for _ in range(10):
        _, _, _, truncated, _ = vector.step(np.zeros((2, 1), np.float32))
    assert truncated.all()
    again, rewards, _, truncated, _ = vector.step(np.zeros((2, 1), np.float32))
    assert np.array_equal(again, first) and not truncated.any() and not rewards.any()


def test_a_camera_is_an_observation():
    env = envs.CityEnv("roundabout", picture=(84, 84), quality="low")
    seen, _ = env.reset(seed=2)
    assert env.observation_space.contains(seen) and seen.shape == (84, 84, 3)
    assert env.observation_space.contains(env.step(np.zeros(1, np.float32))[0])
    parallel = envs.CityParallelEnv("roundabout", render_mode="rgb_array", quality="low")
    parallel.reset()
    assert parallel.render().shape == (512, 512, 3)


def test_episodes_without_a_seed_differ_and_those_with_one_repeat():
    env = envs.CityEnv("roundabout", environment="testbed")

    def episode(seed):
        env.reset(seed=seed)
        for _ in range(30):
            env.step(np.ones(1, np.float32))
        return env.world.digest

    assert episode(3) == episode(3)
    assert episode(None) != episode(None)


def test_vehicles_of_other_drivers_are_no_agents():
    env = envs.CityParallelEnv("platoon")
    observations, _ = env.reset(seed=1)
    assert observations and "leader" not in observations
    env.step({agent: np.zeros(1, np.float32) for agent in env.agents})


def test_an_environment_that_is_dropped_frees_its_world():
    env = envs.CityEnv("roundabout")
    world = weakref.ref(env.world)
    del env
    gc.collect()
    assert world() is None


def test_pictures_of_a_vector_are_those_of_its_parts():
    vector = envs.CityVectorEnv("roundabout", 3, picture=(64, 48), quality="low")
    singles = [envs.CityEnv("roundabout", picture=(64, 48), quality="low") for _ in range(3)]
    together, _ = vector.reset(seed=4)
    assert np.array_equal(together, np.stack([env.reset(seed=4 + k)[0] for k, env in enumerate(singles)]))
    actions = np.array([[-1.0], [0.0], [1.0]], np.float32)
    for _ in range(5):
        together, *_ = vector.step(actions)
        alone = np.stack([env.step(action)[0] for env, action in zip(singles, actions, strict=True)])
    assert np.array_equal(together, alone) and not np.array_equal(together[0], together[2])


def test_observations_are_what_they_are_said_to_be():
    env = envs.CityParallelEnv("roundabout")
    env.reset(seed=1)
    for _ in range(20):
        seen, *_ = env.step({agent: np.zeros(1, np.float32) for agent in env.agents})
    states, at = env.world.states(), {name: place for place, name in enumerate(city3d.COLUMNS)}
    for row, agent in enumerate(env.possible_agents):
        own, observed = states[row], seen[agent]
        assert np.allclose(observed[:2], [own[at["speed_mps"]] / 10, own[at["acceleration_mps2"]] / 3], atol=1e-6)
        assert np.isclose(observed[3], 1 - env.world.time_s / env.world.duration_s)
        places = states[:, [at["x_m"], at["y_m"]]]
        distances = np.delete(np.hypot(*(places - places[row]).T), row)
        order = np.delete(np.arange(len(states)), row)[np.argsort(distances)]
        cos, sin = np.cos(own[at["heading_rad"]]), np.sin(own[at["heading_rad"]])
        for neighbour, other in zip(observed[4:].reshape(5, 5), order, strict=True):
            x, y = places[other] - places[row]
            assert np.allclose(neighbour[:3], [1, (x * cos + y * sin) / 50, (y * cos - x * sin) / 50], atol=1e-5)
