"""A small policy learns to drive in a queue before a roundabout, by the cross-entropy method (Rubinstein 1999), with numpy
alone.

The agent is the second of three cars that come to the west roundabout and have to yield there, in the testbed emulator with
its delays, noise and disturbances, which the seed draws. It sets its acceleration, and must not run into the car ahead. The
policy is linear in four features: action = w . (1, own speed over 10 m/s, gap to the car ahead over 10 m, how fast that gap
grows over 5 m/s). Each generation draws a population of policies from a normal distribution, drives each with a few seeds,
and fits the distribution to the best quarter. In the end the learned policy drives 20 seeds that it has not seen, as the
untrained one does, w = 0; a paired permutation test says how likely a difference as large is by chance.

    python learn_to_drive.py
"""

import argparse
import time

import numpy as np
from gymnasium.vector import AutoresetMode

from city3d.envs import CityVectorEnv

FEATURES = 4
#: From the middle of one vehicle to that of the other where nobody is ahead, metres.
FREE_M = 40.0
#: Half of the width of the strip in front in which a vehicle is ahead, metres.
STRIP_M = 2.5
#: Of the first distribution.
SPREAD = 2.0


def features(observations: np.ndarray) -> np.ndarray:
    """Features of observations of the environments: a row for each."""
    others = observations[:, 4:].reshape(len(observations), -1, 5)
    there, ahead_m, left_m = others[:, :, 0], 50.0 * others[:, :, 1], 50.0 * others[:, :, 2]
    is_ahead = (there > 0) & (ahead_m > 0) & (np.abs(left_m) < STRIP_M)
    gaps_m = np.where(is_ahead, np.minimum(ahead_m, FREE_M), FREE_M)
    rows, nearest = np.arange(len(observations)), gaps_m.argmin(axis=1)
    opening_mps = np.where(is_ahead[rows, nearest], 10.0 * others[rows, nearest, 3], 0.0)
    return np.stack([np.ones(len(rows)), observations[:, 0], gaps_m[rows, nearest] / 10.0, opening_mps / 5.0], axis=1)


def returns(env: CityVectorEnv, policies: np.ndarray, seeds: list[int]) -> np.ndarray:
    """Return of an episode of each policy (row) with each seed (column). A world that has ended takes the next episode."""
    jobs = [(policy, seed) for policy in range(len(policies)) for seed in range(len(seeds))]
    found = np.zeros((len(policies), len(seeds)))
    waiting = iter(jobs)
    doing: list[tuple[int, int] | None] = [None] * env.num_envs
    ended = np.ones(env.num_envs, dtype=bool)
    driven = np.zeros((env.num_envs, FEATURES))
    while True:
        for world in np.flatnonzero(ended):
            doing[world] = next(waiting, None)
        begins = ended & np.array([job is not None for job in doing])
        if begins.any():
            begun = [seeds[job[1]] if job is not None else None for job in doing]
            observations, _ = env.reset(seed=begun, options={"reset_mask": begins})
            for place, job in enumerate(doing):
                if begins[place] and job is not None:
                    driven[place] = policies[job[0]]
        if all(job is None for job in doing):
            return found
        actions = np.clip((features(observations) * driven).sum(axis=1), -1.0, 1.0)
        observations, rewards, terminated, truncated, _ = env.step(actions[:, None].astype(np.float32))
        for job, reward in zip(doing, rewards, strict=True):
            if job is not None:
                found[job] += reward
        ended = terminated | truncated


def learn(env: CityVectorEnv, generations: int, population: int, seeds_each: int, random: np.random.Generator) -> np.ndarray:
    """The mean of the distribution after the last generation."""
    mean, spread = np.zeros(FEATURES), np.full(FEATURES, SPREAD)
    best = max(2, population // 4)
    for generation in range(generations):
        policies = mean + spread * random.standard_normal((population, FEATURES))
        seeds = random.integers(1_000_000, size=seeds_each).tolist()
        scores = returns(env, policies, seeds).mean(axis=1)
        elite = policies[np.argsort(scores)[-best:]]
        mean, spread = elite.mean(axis=0), elite.std(axis=0) + 0.3 / (1 + generation)
        print(f"generation {generation + 1}: mean return {scores.mean():7.1f}, best {scores.max():7.1f}", flush=True)
    return mean


def permutation_test(differences: np.ndarray) -> float:
    """One-sided paired permutation test, exact (Fisher 1935): the share of all ways to choose the signs of the differences
    whose sum is at least as large."""
    sums = np.zeros(1)
    for difference in differences:
        sums = np.concatenate([sums + difference, sums - difference])
    return float((sums >= differences.sum() - 1e-9).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description="A small policy learns to drive, and is compared with its untrained self.")
    parser.add_argument("--generations", type=int, default=10)
    parser.add_argument("--population", type=int, default=24)
    parser.add_argument("--seeds-each", type=int, default=2, help="seeds that each policy drives in a generation")
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated time of an episode")
    parser.add_argument("--worlds", type=int, default=8, help="worlds side by side")
    parser.add_argument("--unseen", type=int, default=20, help="seeds of the comparison in the end")
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn")
    options = parser.parse_args()
    began = time.perf_counter()
    env = CityVectorEnv(
        "roundabout", options.worlds, vehicle=2, environment="testbed", duration_s=options.seconds, autoreset_mode=AutoresetMode.DISABLED
    )
    random = np.random.default_rng(options.seed)
    learned = learn(env, options.generations, options.population, options.seeds_each, random)
    print("learned policy:", np.round(learned, 2).tolist(), f"after {time.perf_counter() - began:.0f} s")

    # Training draws seeds below a million.
    unseen = list(range(1_000_000, 1_000_000 + options.unseen))
    untrained, trained = returns(env, np.stack([np.zeros(FEATURES), learned]), unseen)
    difference = trained - untrained
    print(f"{options.unseen} unseen seeds: untrained {untrained.mean():.1f}, learned {trained.mean():.1f}")
    print(f"better in {int((difference > 0).sum())} of {options.unseen}, permutation test p = {permutation_test(difference):.2g}")
    print(f"{time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
