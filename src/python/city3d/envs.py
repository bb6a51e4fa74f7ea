"""Environments of Gymnasium and PettingZoo: speeds of automated vehicles among others in the city.

An agent sets the acceleration of its vehicle along its route, in [-1, 1] from full braking to full acceleration; the
library steers, and keeps the right of way, unless the scenario says otherwise. A step is 0.1 s of simulated time.

Observation (float32, 4 + 5 * NEIGHBOURS numbers): own speed over 10 m/s, own acceleration over 3 m/s2, own steering
angle (radians), time left as a share of the duration; then of each of the nearest vehicles whether it is there (0 or
1), its place in front and to the left over 50 m, and its velocity relative to the own one in the same directions over
10 m/s.

Reward: the distance driven in the step over 1 m, less 0.1 times the square of the action's change, less 100 for a
collision, which ends the episode, as does leaving the city. The episode is truncated at the end of the scenario's
duration. A reset without a seed draws one, so that episodes differ; the same seed repeats an episode to the bit.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from pettingzoo import ParallelEnv

from . import COLUMNS, Camera, World, step_worlds

NEIGHBOURS = 5
STEP_S = 0.1
COLLISION = 100.0
#: Agents of scenarios with inflows have entered by then.
ENTERS_S = 60.0
_SIZE = 4 + 5 * NEIGHBOURS
_AT = {name: place for place, name in enumerate(COLUMNS)}
#: Name under which scenarios call the driver of an agent.
DRIVER = "agent"


class _Agents:
    """Makes the drivers of agents; it knows no environment, which would keep its own world alive."""

    def __init__(self, vehicles: tuple[int, ...] | None) -> None:
        self.vehicles = vehicles
        self.made: dict[int, _Agent] = {}

    def __call__(self, vehicle: int, parameters: dict[str, float]) -> _Agent | None:
        if self.vehicles is not None and vehicle not in self.vehicles:
            return None
        self.made[vehicle] = _Agent(parameters)
        return self.made[vehicle]


class _Agent:
    """The driver of one vehicle: it does what the environment was told."""

    def __init__(self, parameters: dict[str, float]) -> None:
        self.least = parameters["min_acceleration_mps2"]
        self.most = parameters["max_acceleration_mps2"]
        self.action = 0.0

    def acceleration(
        self, speed_mps: float, desired_mps: float, gap_m: float | None, leader_mps: float | None
    ) -> float:
        wanted = self.action * (self.most if self.action > 0 else -self.least)
        # Not beyond the speed that the road allows.
        return min(wanted, (desired_mps - speed_mps) / STEP_S)


def observe(states: np.ndarray, row: int, left: float) -> np.ndarray:
    """What the vehicle of a row of states observes."""
    own = states[row]
    heading = own[_AT["heading_rad"]]
    cos, sin = np.cos(heading), np.sin(heading)
    places = states[:, [_AT["x_m"], _AT["y_m"]]] - own[[_AT["x_m"], _AT["y_m"]]]
    velocities = states[:, [_AT["vx_mps"], _AT["vy_mps"]]] - own[[_AT["vx_mps"], _AT["vy_mps"]]]
    distances = np.hypot(places[:, 0], places[:, 1])
    distances[row] = np.inf
    nearest = np.argsort(distances, kind="stable")[: min(NEIGHBOURS, len(states) - 1)]
    out = np.zeros(_SIZE, dtype=np.float32)
    out[:4] = (
        own[_AT["speed_mps"]] / 10.0,
        own[_AT["acceleration_mps2"]] / 3.0,
        own[_AT["steering_rad"]],
        left,
    )
    for place, other in enumerate(nearest):
        (x, y), (vx, vy) = places[other], velocities[other]
        out[4 + 5 * place : 9 + 5 * place] = (
            1.0,
            (x * cos + y * sin) / 50.0,
            (y * cos - x * sin) / 50.0,
            (vx * cos + vy * sin) / 10.0,
            (vy * cos - vx * sin) / 10.0,
        )
    return out


def observation_space() -> spaces.Box:
    """Space of one observation."""
    return spaces.Box(-np.inf, np.inf, (_SIZE,), np.float32)


def action_space() -> spaces.Box:
    """Space of one action."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


class CityParallelEnv(ParallelEnv):
    """Vehicles of a scenario are agents: those with the ids `vehicles`, or all that are there at the start.

    `agents` names those that are on their way. Vehicles of the scenario's default driver that are no agents are driven by
    IDM; those of its other drivers keep theirs.
    """

    metadata = {"name": "city3d", "render_modes": ["rgb_array"], "render_fps": 10, "is_parallelizable": True}

    def __init__(
        self,
        scenario: str = "roundabout",
        *,
        vehicles: tuple[int, ...] | None = None,
        render_mode: str | None = None,
        **world: Any,
    ) -> None:
        self.render_mode = render_mode
        self._drivers = _Agents(vehicles)
        self._random = np.random.default_rng()
        changes = dict(world.pop("set", None) or {})
        changes.setdefault("driver.default.controller", DRIVER)
        self.world = World(scenario, set=changes, drivers={DRIVER: self._drivers}, **world)
        if vehicles is None:
            # Those of the scenario's other drivers are driven by these.
            names = {id: name for id, name in self.world.names.items() if id in self._drivers.made}
            self._drivers.vehicles = tuple(names)
        else:
            names = {vehicle: f"vehicle_{vehicle}" for vehicle in vehicles}
        self._ids = {name: vehicle for vehicle, name in names.items()}
        self.possible_agents = list(self._ids)
        if not self.possible_agents:
            raise ValueError(f"{scenario} has no vehicle of the default driver at its start: give `vehicles` the ids of agents")
        self.agents: list[str] = []
        # One object for each agent, as PettingZoo asks for: it is seeded.
        self._observation_spaces = {agent: observation_space() for agent in self.possible_agents}
        self._action_spaces = {agent: action_space() for agent in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Box:
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        else:
            seed = int(self._random.integers(2**31))
        self.world.reset(seed)
        # Those who enter the city later are waited for.
        while not set(self._ids.values()) <= set(self.world.ids.tolist()):
            if self.world.time_s >= ENTERS_S:
                raise RuntimeError(f"agents have not entered within {ENTERS_S} s: {self._ids}")
            self.world.step(STEP_S)
        strangers = set(self._ids.values()) - self._drivers.made.keys()
        if strangers:
            raise ValueError(f"vehicles {sorted(strangers)} have another driver than the default one: they are no agents")
        self.world.events()
        self.agents = list(self.possible_agents)
        self._last = {agent: 0.0 for agent in self.agents}
        states = self.world.states()
        self._driven = self._distances(states)
        return self._observations(states), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, np.ndarray]
    ) -> tuple[
        dict[str, np.ndarray],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        self._command(actions)
        self.world.step(STEP_S)
        return self._outcome(actions)

    def _command(self, actions: dict[str, np.ndarray]) -> None:
        for agent, action in actions.items():
            self._drivers.made[self._ids[agent]].action = float(np.clip(np.asarray(action).reshape(-1)[0], -1.0, 1.0))

    def _outcome(self, actions: dict[str, np.ndarray]) -> tuple[Any, ...]:
        collided = set()
        for event in self.world.events():
            if event["kind"].startswith("collision"):
                collided |= {event["vehicle"], event.get("with")}
        states, is_over = self.world.states(), self.world.is_over
        driven, observations = self._distances(states), self._observations(states)
        rewards, terminations, truncations = {}, {}, {}
        for agent in self.agents:
            id = self._ids[agent]
            action = self._drivers.made[id].action
            reward = driven.get(id, 0.0) - self._driven.get(id, 0.0) if id in driven else 0.0
            reward -= 0.1 * (action - self._last[agent]) ** 2 + COLLISION * (id in collided)
            self._last[agent] = action
            rewards[agent] = float(reward)
            terminations[agent] = id in collided or id not in driven
            truncations[agent] = is_over and not terminations[agent]
        self._driven = driven
        infos: dict[str, dict[str, Any]] = {agent: {} for agent in self.agents}
        self.agents = [agent for agent in self.agents if not (terminations[agent] or truncations[agent])]
        return observations, rewards, terminations, truncations, infos

    @staticmethod
    def _distances(states: np.ndarray) -> dict[int, float]:
        return dict(zip(states[:, 0].astype(int).tolist(), states[:, _AT["distance_m"]].tolist(), strict=True))

    def _observations(self, states: np.ndarray) -> dict[str, np.ndarray]:
        rows = {int(id): row for row, id in enumerate(states[:, 0])}
        left = max(0.0, 1.0 - self.world.time_s / self.world.duration_s)
        nothing = np.zeros(_SIZE, dtype=np.float32)
        return {
            agent: observe(states, rows[self._ids[agent]], left) if self._ids[agent] in rows else nothing
            for agent in self.agents
        }

    def render(self) -> np.ndarray | None:
        """The city from above, as an array of (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        return self.world.pictures([Camera.overhead(height_m=220.0)], 512, 512)[0]

    def close(self) -> None:
        """Nothing is to be closed."""


class CityEnv(gymnasium.Env):
    """One vehicle of a scenario is the agent; the library drives the others.

    With `picture=(width, height)` the observation is what its windscreen camera sees, `uint8` of (height, width, 3).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: str = "roundabout",
        *,
        vehicle: int = 1,
        picture: tuple[int, int] | None = None,
        render_mode: str | None = None,
        **world: Any,
    ) -> None:
        self.render_mode = render_mode
        self._picture = picture
        self._env = CityParallelEnv(scenario, vehicles=(vehicle,), render_mode=render_mode, **world)
        self.vehicle = self._env.possible_agents[0]
        self.action_space = action_space()
        if picture is None:
            self.observation_space = observation_space()
        else:
            self.observation_space = spaces.Box(0, 255, (picture[1], picture[0], 3), np.uint8)

    @property
    def world(self) -> World:
        """The city of the environment."""
        return self._env.world

    def _seen(self, observations: dict[str, np.ndarray]) -> np.ndarray:
        if self._picture is None:
            return observations[self.vehicle]
        id = self._env._ids[self.vehicle]
        if id not in self.world.ids:
            return np.zeros(self.observation_space.shape, np.uint8)
        return self.world.pictures([Camera.onboard(id)], *self._picture)[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        observations, _ = self._env.reset(int(self.np_random.integers(2**31)) if seed is None else seed)
        return self._seen(observations), {"digest": self.world.digest}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        observations, rewards, terminations, truncations, _ = self._env.step({self.vehicle: action})
        name = self.vehicle
        return self._seen(observations), rewards[name], terminations[name], truncations[name], {}

    def render(self) -> np.ndarray | None:
        """The city from above."""
        return self._env.render()


class CityVectorEnv(VectorEnv):
    """Several `CityEnv` side by side on all cores, with arrays for observations and actions.

    An environment that ends begins anew with the next step, as `AutoresetMode.NEXT_STEP` of Gymnasium says.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, scenario: str = "roundabout", num_envs: int = 2, **options: Any) -> None:
        self.num_envs = num_envs
        self.envs = [CityEnv(scenario, **options) for _ in range(num_envs)]
        self.render_mode = self.envs[0].render_mode
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | list[int | None] | tuple[int | None, ...] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        seeds = list(seed) if isinstance(seed, (list, tuple)) else [None if seed is None else seed + k for k in range(self.num_envs)]
        self._ended[:] = False
        return np.stack([env.reset(seed=own)[0] for env, own in zip(self.envs, seeds, strict=True)]), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        going = [k for k in range(self.num_envs) if not self._ended[k]]
        for k in going:
            env = self.envs[k]
            env._env._command({env.vehicle: actions[k]})
        step_worlds([self.envs[k].world for k in going], STEP_S)
        observations, rewards = [], np.zeros(self.num_envs)
        terminations, truncations = (np.zeros(self.num_envs, dtype=bool) for _ in range(2))
        for k, env in enumerate(self.envs):
            if self._ended[k]:
                observations.append(env.reset()[0])
                continue
            seen, reward, terminated, truncated, _ = env._env._outcome({})
            observations.append(env._seen(seen))
            rewards[k], terminations[k], truncations[k] = (
                of[env.vehicle] for of in (reward, terminated, truncated)
            )
        self._ended = terminations | truncations
        return np.stack(observations), rewards, terminations, truncations, {}

    def render(self) -> tuple[np.ndarray | None, ...]:
        """Each city from above."""
        return tuple(env.render() for env in self.envs)


for _name, _scenario in (("Roundabout", "roundabout"), ("Merge", "merge"), ("City", "city")):
    gymnasium.register(
        id=f"City3D/{_name}-v0",
        entry_point="city3d.envs:CityEnv",
        vector_entry_point="city3d.envs:CityVectorEnv",
        kwargs={"scenario": _scenario},
    )
