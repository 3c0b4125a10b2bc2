"""Prints how many vehicle steps a second crazyflow makes: first-principles dynamics, RK4 at 1 kHz, a constant force and torque, on
all cores, in batches of the size that is fastest on few cores."""

import time

import jax
import numpy as np
from crazyflow.control import Control
from crazyflow.dynamics import Dynamics
from crazyflow.sim import Sim
from crazyflow.sim.integration import Integrator

WORLDS, STEPS, ROUNDS = 256, 500, 10

sim = Sim(
    n_worlds=WORLDS,
    dynamics=Dynamics.first_principles,
    control=Control.force_torque,
    integrator=Integrator.rk4,
    freq=1000,
    force_torque_freq=1000,
)
sim.reset()
command = np.zeros((WORLDS, 1, 4))
command[..., 0] = 0.4  # N


def fly() -> None:
    sim.force_torque_control(command)
    sim.step(STEPS)
    jax.block_until_ready(sim.data)


fly()  # compiles
begun = time.perf_counter()
for _ in range(ROUNDS):
    fly()
print(WORLDS * STEPS * ROUNDS / (time.perf_counter() - begun))
