"""What the Python package takes: vehicle steps, pictures and memory, beside highway-env and MetaDrive.

    scripts/python.sh bench                                  all of it, with the wheel that scripts/python.sh wheel has built
    target/python-wheel/bin/python benches/python.py states resets      some of City3D's measurements
    target/python-peers/bin/python benches/python.py highway-env        a peer, in an environment that has it

Each measurement runs in a process of its own. One step is 0.1 s of simulated time with the observations of all vehicles; a
vehicle step is that of one vehicle.
"""

import gc
import os
import subprocess
import sys
import time

#: Wall-clock time of a measurement, seconds.
LASTS_S = float(os.environ.get("CITY3D_BENCH_S", "10"))
RESETS = int(os.environ.get("CITY3D_BENCH_RESETS", "10000"))


def row(what: str, result: str) -> None:
    print(f"| {what} | {result} |", flush=True)


def resident_mb() -> float:
    """Memory of this process that is in RAM."""
    gc.collect()
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def rate(step) -> float:
    """How many times a second `step` counts, after a first call."""
    step()
    counted, began = 0, time.perf_counter()
    while time.perf_counter() - began < LASTS_S:
        counted += step()
    return counted / (time.perf_counter() - began)


def states() -> None:
    """Vehicle steps with 50 ray-cast vehicles, on all cores."""
    import city3d
    from city3d.envs import CityParallelEnv

    for count in (1, 2, 8, 64):
        worlds = [city3d.World("city", seed=seed) for seed in range(count)]

        def step():
            city3d.step_worlds(worlds, 0.1)
            seen = 0
            for world in worlds:
                seen += len(world.observe(world.ids))
                if world.is_over:
                    world.reset()
            return seen

        row(f"`step_worlds` and `observe`, worlds: {count}", f"{rate(step):,.0f} vehicle steps/s")
    env = CityParallelEnv("city")
    env.reset(seed=1)

    def step_agents():
        if not env.agents:
            env.reset()
        count = len(env.agents)
        # Agents coast, so that few of them collide and leave.
        env.step({agent: (0.0,) for agent in env.agents})
        return count

    row("`CityParallelEnv`, all vehicles are agents", f"{rate(step_agents):,.0f} vehicle steps/s")


def pictures() -> None:
    """Pictures of 84 x 84 as observations."""
    import city3d
    import numpy as np
    from city3d.envs import CityVectorEnv

    world = city3d.World("city", quality="low")
    world.step(2.0)
    cameras = [city3d.Camera.onboard(vehicle) for vehicle in world.ids]
    row("`World.pictures` of 50 cameras", f"{rate(lambda: len(world.pictures(cameras, 84, 84))):,.0f} pictures/s")
    worlds = [city3d.World("city", seed=seed, quality="low") for seed in range(16)]
    ahead = [city3d.Camera.onboard(1)] * len(worlds)
    row("`picture_worlds`, 16 worlds", f"{rate(lambda: len(city3d.picture_worlds(worlds, ahead, 84, 84))):,.0f} pictures/s")
    for scenario in ("roundabout", "city"):
        env = CityVectorEnv(scenario, 16, picture=(84, 84), quality="low")
        env.reset(seed=1)
        actions = np.zeros((16, 1), np.float32)
        row(f"`CityVectorEnv`, {scenario}, 16 worlds, a step and its pictures", f"{rate(lambda: len(env.step(actions)[0])):,.0f} pictures/s")


def memory() -> None:
    """Memory of 64 worlds in one process."""
    import city3d

    city3d.World("city").step(1.0)
    before = resident_mb()
    worlds = [city3d.World("city", seed=seed, quality="low") for seed in range(64)]
    city3d.step_worlds(worlds, 10.0)
    after = resident_mb()
    row("64 worlds of 50 vehicles", f"{after - before:.0f} MB ({before:.0f} MB before)")
    city3d.picture_worlds(worlds, [city3d.Camera.onboard(1)] * 64, 84, 84)
    row("the same with a picture each", f"{resident_mb() - before:.0f} MB")
    del worlds
    row("after all are gone", f"{resident_mb() - before:.0f} MB")


def resets() -> None:
    """Memory over resets."""
    import city3d

    world = city3d.World("roundabout")
    for seed in range(200):
        world.reset(seed)
        world.step(0.1)
    before, began = resident_mb(), time.perf_counter()
    for _ in range(RESETS):
        world.reset()
        world.step(0.1)
    took = time.perf_counter() - began
    row(f"{RESETS:,} resets with one seed", f"{resident_mb() - before:+.1f} MB, {1e3 * took / RESETS:.2f} ms each with a step")
    before, began = resident_mb(), time.perf_counter()
    for seed in range(RESETS):
        world.reset(seed)
        world.step(0.1)
    took = time.perf_counter() - began
    row(f"{RESETS:,} resets with another seed each", f"{resident_mb() - before:+.1f} MB, {1e3 * took / RESETS:.2f} ms each with a step")


def highway_env() -> None:
    """highway-env with 50 vehicles around the agent, the agent's observation alone."""
    import gymnasium
    import highway_env

    gymnasium.register_envs(highway_env)
    config = {"vehicles_count": 49, "simulation_frequency": 10, "policy_frequency": 10, "duration": 1000, "offscreen_rendering": True}
    env = gymnasium.make("highway-v0", config=config).unwrapped

    def step():
        _, _, terminated, truncated, _ = env.step(1)
        if terminated or truncated:
            env.reset()
        return len(env.road.vehicles)

    env.reset(seed=1)
    row("highway-env 1.12, `highway-v0`, one world, a step of 0.1 s", f"{rate(step):,.0f} vehicle steps/s")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    seen = {"type": "GrayscaleObservation", "observation_shape": (84, 84), "stack_size": 1, "weights": [0.3, 0.6, 0.1], "scaling": 1.75}
    env = gymnasium.make("highway-v0", config={**config, "observation": seen}).unwrapped
    env.reset(seed=1)

    def picture():
        step()
        return 1

    row("the same, pictures of 84 x 84 (flat, from above)", f"{rate(picture):,.1f} pictures/s")


def metadrive() -> None:
    """MetaDrive with about 50 vehicles, the agent's observation alone. Its renderer needs panda3d-simplepbr 0.10."""
    from metadrive import MetaDriveEnv

    config = {"map": "XXX", "traffic_density": 0.3, "traffic_mode": "respawn", "horizon": 100_000}
    env = MetaDriveEnv({**config, "decision_repeat": 5, "physics_world_step_size": 0.02})
    env.reset(force_seed=0)
    counts = []

    def step():
        *_, is_over, _ = env.step([0.0, 0.0])
        if is_over:
            env.reset(force_seed=0)
        counts.append(1 + len(env.engine.traffic_manager._traffic_vehicles))
        return counts[-1]

    steps = rate(step)
    row(f"MetaDrive 0.3.0.1, {sum(counts) / len(counts):.0f} vehicles, one world, a step of 0.1 s", f"{steps:,.0f} vehicle steps/s")
    env.close()
    seen = {"image_observation": True, "vehicle_config": {"image_source": "rgb_camera", "rgb_camera": (84, 84)}}
    env = MetaDriveEnv({**config, **seen})
    env.reset(force_seed=0)

    def picture():
        step()
        return 1

    row("the same, pictures of 84 x 84", f"{rate(picture):,.1f} pictures/s")


MEASURED = {"states": states, "pictures": pictures, "memory": memory, "resets": resets}
PEERS = {"highway-env": highway_env, "metadrive": metadrive}


def main() -> None:
    chosen = sys.argv[1:] or list(MEASURED)
    if len(chosen) == 1 and os.environ.get("CITY3D_BENCH_CHILD"):
        return {**MEASURED, **PEERS}[chosen[0]]()
    unknown = [name for name in chosen if name not in {**MEASURED, **PEERS}]
    if unknown:
        raise SystemExit(f"unknown: {unknown}; there are {[*MEASURED, *PEERS]}")
    print("| | |\n|---|---|", flush=True)
    failed = False
    for name in chosen:
        run = subprocess.run([sys.executable, __file__, name], env={**os.environ, "CITY3D_BENCH_CHILD": "1"})
        failed |= run.returncode != 0
    raise SystemExit(int(failed))


if __name__ == "__main__":
    main()
