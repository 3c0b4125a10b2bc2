"""Flies a policy that learn.py has saved, as the controller of a scenario and a process of its own.

    gerono run examples/learning/fly_policy.toml
"""

import sys
from pathlib import Path

import numpy as np

# The environment in which the policy has learned: its observations, and the limits of its actions.
LEARNED = Path(__file__).parent / "hover.toml"


def load(path):
    """Return the network in a file as a function of an observation, with tanh between its layers."""
    with np.load(path) as file:
        layers = [(file[f"weight{index}"], file[f"bias{index}"]) for index in range(len(file.files) // 2)]

    def act(seen):
        for index, (weight, bias) in enumerate(layers):
            seen = weight @ (np.tanh(seen) if index else seen) + bias
        return seen

    return act


if __name__ == "__main__":
    import gerono.external

    gerono.external.fly(gerono.Policy(LEARNED, load(sys.argv[1])))
