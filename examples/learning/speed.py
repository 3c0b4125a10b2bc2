"""Measures steps a second of the environments: the best of many short intervals, so that other load on the machine counts little.

    speed.py [SCENARIO]
"""

import sys
import time
from pathlib import Path

import numpy as np

import gerono.gym

SCENARIO = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "hover.toml"
ENVIRONMENTS, INTERVALS, INTERVAL = 64, 60, 0.05


def best(environments, actions):
    """Return the steps a second of the fastest interval."""
    environments.reset(seed=1)
    fastest = 0.0
    for _ in range(INTERVALS):
        began, calls = time.perf_counter(), 0
        while time.perf_counter() - began < INTERVAL:
            *_, terminations, truncations, _ = environments.step(actions)
            calls += 1
            if actions.ndim == 1 and (terminations or truncations):
                environments.reset()
        fastest = max(fastest, calls / (time.perf_counter() - began))
    return fastest * (len(actions) if actions.ndim > 1 else 1)


print(f"1 environment: {best(gerono.gym.Env(SCENARIO), np.zeros(4)):.0f} steps/s")
for threads in (1, 2, 8):
    environments = gerono.gym.VectorEnv(SCENARIO, ENVIRONMENTS, threads=threads)
    steps = best(environments, np.zeros((ENVIRONMENTS, 4)))
    print(f"{ENVIRONMENTS} environments, {threads} threads: {steps:.0f} steps/s")
