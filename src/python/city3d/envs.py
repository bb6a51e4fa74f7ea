"""Environments of Gymnasium and PettingZoo: speeds of automated vehicles among others in the city.

An agent sets the acceleration of its vehicle along its route, in [-1, 1] from full braking to full acceleration; the
library steers, and keeps the right of way, unless the scenario says otherwise. The distance to the vehicle ahead is the
agent's. Where vehicles are coordinated, plans drive them, and agents too. A step is 0.1 s of simulated time.

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

from . import COLUMNS, Camera, World, picture_worlds, step_worlds

NEIGHBOURS = 5
STEP_S = 0.1
COLLISION = 100.0
#: Agents of scenarios with inflows have entered by then.
ENTERS_S = 60.0
_SIZE = 4 + 5 * NEIGHBOURS
_AT = {name: place for place, name in enumerate(COLUMNS)}
#: The control algorithm of vehicles that may be agents: IDM, until it is told an acceleration.
DRIVER = "agent"


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
        self._random = np.random.default_rng()
        changes = dict(world.pop("set", None) or {})
        changes.setdefault("driver.default.controller", DRIVER)
        self.world = World(scenario, set=changes, **world)
        if vehicles is None:
            # Those of the scenario's other drivers are driven by these.
            controllers = self.world.controllers
            names = {id: name for id, name in self.world.names.items() if controllers[id] == DRIVER}
        else:
            names = {vehicle: f"vehicle_{vehicle}" for vehicle in vehicles}
        if not names:
            raise ValueError(f"{scenario} has no vehicle of the default driver at its start: give `vehicles` the ids of agents")
        self.possible_agents = list(names.values())
        self.agents: list[str] = []
        self._ids = np.array(list(names), np.uint32)
        self._place = {agent: place for place, agent in enumerate(self.possible_agents)}
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
        while not np.isin(self._ids, self.world.ids).all():
            if self.world.time_s >= ENTERS_S:
                raise RuntimeError(f"agents have not entered within {ENTERS_S} s: {self._ids.tolist()}")
            self.world.step(STEP_S)
        controllers = self.world.controllers
        if strangers := [id for id in self._ids.tolist() if controllers[id] != DRIVER]:
            raise ValueError(f"vehicles {strangers} have another driver than the default one: they are no agents")
        self.world.events()
        self.agents = list(self.possible_agents)
        self._limits = self.world.limits(self._ids)
        self._actions = np.zeros(len(self._ids))
        self._last = np.zeros(len(self._ids))
        self._driven, _ = self._distances()
        observations = self.world.observe(self._ids, NEIGHBOURS)
        return dict(zip(self.agents, observations, strict=True)), {agent: {} for agent in self.agents}

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
        return self._outcome()

    def _command(self, actions: dict[str, np.ndarray]) -> None:
        places = [self._place[agent] for agent in self.agents if agent in actions]
        if not places:
            return
        numbers = [np.asarray(actions[agent]).reshape(-1)[0] for agent in self.agents if agent in actions]
        wanted = np.clip(np.array(numbers, np.float64), -1.0, 1.0)
        self._actions[places] = wanted
        least, most = self._limits[places].T
        self.world.act(self._ids[places], np.where(wanted > 0, wanted * most, -wanted * least), "along_route")

    def _outcome(self) -> tuple[Any, ...]:
        collided = np.zeros(len(self._ids), dtype=bool)
        for event in self.world.events():
            if event["kind"].startswith("collision"):
                collided |= np.isin(self._ids, [event["vehicle"], event.get("with", -1)])
        driven, is_there = self._distances()
        rewards = np.where(is_there, driven - self._driven, 0.0)
        rewards -= 0.1 * (self._actions - self._last) ** 2 + COLLISION * collided
        terminated = collided | ~is_there
        truncated = ~terminated & self.world.is_over
        self._driven, self._last = driven, self._actions.copy()
        places = [self._place[agent] for agent in self.agents]
        observations = self.world.observe(self._ids[places], NEIGHBOURS)

        def of_agents(values: np.ndarray) -> dict[str, Any]:
            return dict(zip(self.agents, values[places].tolist(), strict=True))

        outcome: tuple[Any, ...] = (
            dict(zip(self.agents, observations, strict=True)),
            of_agents(rewards),
            of_agents(terminated),
            of_agents(truncated),
            {agent: {} for agent in self.agents},
        )
        is_over = terminated | truncated
        self.agents = [agent for agent, place in zip(self.agents, places, strict=True) if not is_over[place]]
        return outcome

    def _distances(self) -> tuple[np.ndarray, np.ndarray]:
        """How far each agent has driven, and whether it is in the city."""
        states = self.world.states()
        rows = np.searchsorted(states[:, _AT["id"]], self._ids)
        is_there = np.isin(self._ids, states[:, _AT["id"]])
        driven = np.zeros(len(self._ids))
        driven[is_there] = states[rows[is_there], _AT["distance_m"]]
        return driven, is_there

    def render(self) -> np.ndarray | None:
        """The city from above, as an array of (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        return self.world.pictures([self.world.overview(512, 512)], 512, 512)[0]

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

    @property
    def id(self) -> int:
        """Id of the agent's vehicle."""
        return int(self._env._ids[0])

    def _camera(self) -> Camera | None:
        """The camera of a picture as observation, while the vehicle is in the city."""
        return Camera.onboard(self.id) if self.id in self.world.ids else None

    def _seen(self, observations: dict[str, np.ndarray]) -> np.ndarray:
        if self._picture is None:
            return observations[self.vehicle]
        camera = self._camera()
        if camera is None:
            return np.zeros((self._picture[1], self._picture[0], 3), np.uint8)
        return self.world.pictures([camera], *self._picture)[0]

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

    An environment that ends begins anew with the next step, as `AutoresetMode.NEXT_STEP` of Gymnasium says. With
    `AutoresetMode.DISABLED` it waits, with a reward of 0, for `reset(seed=, options={"reset_mask": mask})`, which resets
    those of the mask.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: str = "roundabout",
        num_envs: int = 2,
        *,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if autoreset_mode not in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
            raise ValueError(f"{autoreset_mode}: environments begin anew with the next step, or are reset by a mask")
        self.metadata = {**self.metadata, "autoreset_mode": autoreset_mode}
        self.num_envs = num_envs
        self.envs = [CityEnv(scenario, **options) for _ in range(num_envs)]
        self.render_mode = self.envs[0].render_mode
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._terminated, self._truncated = (np.zeros(num_envs, dtype=bool) for _ in range(2))
        shape = (_SIZE,) if self.envs[0]._picture is None else (*self.envs[0]._picture[::-1], 3)
        self._observations = np.zeros((num_envs, *shape), self.single_observation_space.dtype)

    def reset(
        self, *, seed: int | list[int | None] | tuple[int | None, ...] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        seeds = list(seed) if isinstance(seed, (list, tuple)) else [None if seed is None else seed + k for k in range(self.num_envs)]
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        for k in np.flatnonzero(mask):
            self._observations[k], _ = self.envs[k].reset(seed=seeds[k])
        self._terminated[mask] = self._truncated[mask] = False
        return self._observations.copy(), {}

    def _pictures(self, width: int, height: int) -> np.ndarray:
        """What all windscreen cameras see."""
        pictures = np.zeros((self.num_envs, height, width, 3), np.uint8)
        seen = {k: camera for k, env in enumerate(self.envs) if (camera := env._camera()) is not None}
        if seen:
            worlds = [self.envs[k].world for k in seen]
            pictures[list(seen)] = picture_worlds(worlds, list(seen.values()), width, height)
        return pictures

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        ended = self._terminated | self._truncated
        begins_anew = ended & (self.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP)
        going = np.flatnonzero(~ended)
        for k in going:
            env = self.envs[k]
            env._env._command({env.vehicle: actions[k]})
        step_worlds([self.envs[k].world for k in going], STEP_S)
        rewards = np.zeros(self.num_envs)
        self._terminated[begins_anew] = self._truncated[begins_anew] = False
        for k in np.flatnonzero(~ended | begins_anew):
            env = self.envs[k]
            if begins_anew[k]:
                seen, _ = env._env.reset(int(env.np_random.integers(2**31)))
            else:
                seen, reward, terminated, truncated, _ = env._env._outcome()
                rewards[k], self._terminated[k], self._truncated[k] = (of[env.vehicle] for of in (reward, terminated, truncated))
            if env._picture is None:
                self._observations[k] = seen[env.vehicle]
        if (picture := self.envs[0]._picture) is not None:
            self._observations = self._pictures(*picture)
        return self._observations.copy(), rewards, self._terminated.copy(), self._truncated.copy(), {}

    def render(self) -> tuple[Any, ...]:
        """Each city from above."""
        return tuple(env.render() for env in self.envs)


#: What environments are by name. In the merge, coordination would drive the agent, which has a plan then.
_REGISTERED: dict[str, dict[str, Any]] = {
    "Roundabout": {"scenario": "roundabout", "environment": "testbed"},
    "Merge": {"scenario": "merge", "vehicle": 4, "set": {"coordination.algorithm": "none"}},
    "City": {"scenario": "city"},
}
for _name, _options in _REGISTERED.items():
    gymnasium.register(
        id=f"City3D/{_name}-v0",
        entry_point="city3d.envs:CityEnv",
        vector_entry_point="city3d.envs:CityVectorEnv",
        kwargs=_options,
    )
